//! Buffers that are too small change nothing but the time.

use instgs_vk::kernels::Variant;
use instgs_vk::render::plan::Capacities;
use instgs_vk::render::{RenderOptions, Renderer};
use instgs_vk::scene::{Camera, Gaussians, InstancedScene};

use crate::common::gpu::{assert_silent, device_options, gpu, render_picture};
use crate::common::gpu_gradients::GradientRunner;
use crate::common::random_scene::random_case;

/// With the intersection buffer limited to a tenth of the need the picture has the same bytes: the blend state between
/// slabs is kept in fp32.
#[test]
fn a_tenth_of_the_intersection_buffer_gives_the_same_bytes() {
    let Some(gpu) = gpu() else { return };
    let mut renderer = Renderer::new(&gpu).unwrap();
    let mut most_slabs = 0;
    for seed in 0..30 {
        let case = random_case(seed);
        let options = device_options(&case.options);
        let scene = renderer.upload(&case.scene).unwrap();
        let free = renderer.render(&scene, &case.camera, &options).unwrap();
        let want = renderer.download().unwrap();
        let limited = RenderOptions { max_intersections: Some((free.intersections / 10) as u32), ..options };
        let stats = renderer.render(&scene, &case.camera, &limited).unwrap();
        let got = renderer.download().unwrap();
        assert_eq!(stats.intersections, free.intersections, "seed {seed}: every pair is blended once");
        assert!(got == want, "seed {seed}: {} slabs", stats.slabs);
        most_slabs = most_slabs.max(stats.slabs);
    }
    assert!(most_slabs >= 5, "the limit forces slabs, at most {most_slabs} were seen");
    assert_silent(&gpu);
}

/// Starting from one candidate, one work item and one intersection, frames are redone until they fit.
#[test]
fn tiny_buffers_grow() {
    let Some(gpu) = gpu() else { return };
    let case = random_case(8);
    let options = device_options(&case.options);
    let want = render_picture(&mut Renderer::new(&gpu).unwrap(), &case.scene, &case.camera, &options);
    let mut renderer = Renderer::new(&gpu).unwrap();
    renderer.set_capacities(Capacities { candidates: 1, work_items: 1, intersections: 1 });
    let scene = renderer.upload(&case.scene).unwrap();
    let stats = renderer.render(&scene, &case.camera, &options).unwrap();
    assert!(stats.redone >= 2, "redone {} times", stats.redone);
    assert!(renderer.download().unwrap() == want);
    let again = renderer.render(&scene, &case.camera, &options).unwrap();
    assert_eq!((again.redone, again.slabs), (0, 1), "the second frame fits");
    assert_silent(&gpu);
}

/// More splats on one tile than a tile's list may hold on a driver with a loop limit.
#[test]
fn a_deep_pile_is_blended_to_the_end() {
    let Some(gpu) = gpu() else { return };
    // More than a slab takes on a driver with a loop limit (15/16 of it, times the lanes), else just many.
    let lanes = Variant::for_device(gpu.caps()).subgroup_size;
    let deep = gpu.caps().loop_iteration_limit.map_or(600_000, |most| most * lanes) as usize;
    // Faint splats that never reach the last one's corner: that pixel's T stays 1 until the last, opaque splat.
    let mut cloud = Gaussians::with_capacity(0, deep + 1);
    for i in 0..=deep {
        // So is the middle one, and in its own corner.
        let (middle, last) = (i == deep / 2, i == deep || i == deep / 2);
        let place = [if last { 0.35 } else { -0.35 }, if middle { 0.4 } else { 0.0 }];
        cloud.means.push([place[0], place[1], 1.0 + 0.6 * i as f32 / deep as f32]);
        cloud.quats.push([1.0, 0.0, 0.0, 0.0]);
        cloud.log_scales.push([0.02f32.ln(); 3]);
        cloud.opacity_logits.push(if last { 4.0 } else { -5.4 });
        cloud.sh.push([if last { 1.0 } else { -1.0 }; 3]);
    }
    let camera = Camera {
        name: "deep".into(),
        width: 8,
        height: 8,
        fx: 8.0,
        fy: 8.0,
        cx: 4.0,
        cy: 4.0,
        view_from_world: [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]],
    };
    let mut renderer = Renderer::new(&gpu).unwrap();
    // The intersections fit one slab; the list's length alone forces more.
    renderer.set_capacities(Capacities { candidates: 1 << 16, work_items: 8192, intersections: 1 << 21 });
    let scene = renderer.upload(&InstancedScene::from_cloud(cloud)).unwrap();
    let stats = renderer.render(&scene, &camera, &RenderOptions::default()).unwrap();
    // The last splat's centre is at x = 4 + 8 * 0.35 / 1.6 = 5.75, y = 4.
    let right = renderer.download().unwrap().colors[3 * 8 + 5];
    assert!(right[3] > 0.3, "the last splat of {deep} is there: {right:?}");
    // That of the middle one is at x = 4 + 8 * 0.35 / 1.3 = 6.15, y = 4 + 8 * 0.4 / 1.3 = 6.46.
    let below = renderer.download().unwrap().colors[6 * 8 + 6];
    assert!(below[3] > 0.3, "the splat in the middle of {deep} is there: {below:?}");
    assert!(gpu.caps().loop_iteration_limit.is_none() || stats.slabs > 1, "{} slabs", stats.slabs);
    assert_silent(&gpu);
}

/// In training, a view may have any number of Gaussians, but a tile no more than the loops of the driver have iterations for.
#[test]
fn training_views_may_be_crowded_and_tiles_may_not() {
    let Some(gpu) = gpu() else { return };
    if gpu.caps().loop_iteration_limit.is_none() {
        return;
    }
    let mut runner = GradientRunner::new(&gpu, Variant::for_training(gpu.caps()));
    let count = runner.longest_list() as usize / 4 * 5;
    runner.set_intersections(5 * count as u32);
    let mut crowd = |width: u32| {
        let mut cloud = Gaussians::with_capacity(0, count);
        for i in 0..count {
            // At depth 2 a unit is as wide as the picture; half of the Gaussians are in its middle.
            let x = if i % 2 == 0 { 0.01 } else { i as f32 / count as f32 - 0.5 };
            cloud.means.push([x * f32::from(width as u16) / 8.0, 0.01, 2.0]);
            cloud.quats.push([1.0, 0.0, 0.0, 0.0]);
            cloud.log_scales.push([0.005f32.ln(); 3]);
            cloud.opacity_logits.push(-5.0);
            cloud.sh.push([0.5; 3]);
        }
        let view_from_world = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];
        let (cx, cy) = (f64::from(width) / 2.0, 4.0);
        let camera = Camera { name: "crowd".into(), width, height: 8, fx: 16.0, fy: 16.0, cx, cy, view_from_world };
        let options = instgs_reference::RenderOptions::default();
        let cotangents = vec![[1.0; 4]; width as usize * 8];
        runner.try_run(&InstancedScene::from_cloud(cloud), &camera, &options, &cotangents)
    };
    let spread = crowd(64).unwrap();
    assert_eq!(spread.redone, 0);
    let learns = |i: usize| spread.screen_statistics[i][1] > 0.0 && spread.gradient.background.opacity_logits[i] != 0.0;
    // Odd ones go from left to right.
    for eighth in 0..8 {
        let here = count / 8 * eighth..count / 8 * (eighth + 1);
        let learning = here.filter(|&i| i % 2 == 1 && learns(i)).count();
        assert!(learning > 10, "{learning} in the part {eighth} of 8");
    }
    let error = crowd(8).err().unwrap().to_string();
    assert!(
        error.contains("Gaussians on one tile of a training view") && error.contains(&count.to_string()),
        "{error}"
    );
    assert_silent(&gpu);
}

/// One opaque splat over an image of 90,000 8x8 tiles: more than a driver with a loop limit emits in one loop.
#[test]
fn a_splat_over_a_large_image_is_whole() {
    let Some(gpu) = gpu() else { return };
    let mut cloud = Gaussians::with_capacity(0, 1);
    cloud.means.push([0.0, 0.0, 2.0]);
    cloud.quats.push([1.0, 0.0, 0.0, 0.0]);
    cloud.log_scales.push([3.0; 3]);
    cloud.opacity_logits.push(5.0);
    cloud.sh.push([1.0; 3]);
    let camera = Camera::look_at("large", glam::DVec3::ZERO, glam::DVec3::Z, glam::DVec3::NEG_Y, 0.9, (3000, 1920));
    let mut renderer = Renderer::new(&gpu).unwrap();
    let scene = InstancedScene::from_cloud(cloud);
    let picture = render_picture(&mut renderer, &scene, &camera, &RenderOptions::default());
    let least = picture.colors.iter().map(|c| c[3]).fold(1.0, f32::min);
    assert!(least > 0.9, "alpha {least} somewhere");
    assert_silent(&gpu);
}
