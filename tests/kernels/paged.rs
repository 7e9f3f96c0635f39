//! Backgrounds in pages: the pictures are those of the scene in one piece, whatever came and went before, and a page that is
//! not there leaves no hole.

use std::sync::Arc;

use glam::{DMat3, DVec3};
use instgs_vk::gpu::Gpu;
use instgs_vk::math::rng::Rng;
use instgs_vk::math::similarity::Similarity;
use instgs_vk::render::{PagedScene, RenderOptions, Renderer};
use instgs_vk::scene::lod::pages::PagedBackground;
use instgs_vk::scene::{Camera, DevicePrecision, Gaussians, Instance, InstancedScene, Offsets, SourceRange};

use crate::common::gpu::{alpha, assert_silent, gpu_with_small_chunks, with_bindings_of};
use crate::common::random_scene::rare_case;

/// What is on the ground.
#[derive(Clone, Copy, PartialEq)]
enum Posed {
    Nothing,
    /// The instances of a random scene; with an even or an odd number of Gaussians of their own and of templates.
    Instances {
        odd: bool,
    },
}

/// A wide ground of small splats of an SH degree, and what is on it.
fn scene(seed: u64, posed: Posed, sh_degree: u32) -> InstancedScene {
    let mut rng = Rng::new(seed);
    let mut out = rare_case(seed).scene;
    let mut ground = Gaussians::with_capacity(sh_degree, 30_000);
    for _ in 0..30_000 {
        let (x, y) = (rng.range(-40.0, 40.0), rng.range(-40.0, 40.0));
        ground.means.push([x as f32, (0.3 * (x + y).sin() + 2.0) as f32, y as f32]);
        ground.quats.push([0; 4].map(|_| rng.normal() as f32));
        ground.log_scales.push([0; 3].map(|_| rng.range(-2.6, -1.6) as f32));
        ground.opacity_logits.push(rng.range(-1.0, 3.0) as f32);
        (0..(sh_degree + 1).pow(2)).for_each(|_| ground.sh.push([0; 3].map(|_| rng.range(-0.4, 0.6) as f32)));
    }
    out.background = ground;
    if posed == Posed::Nothing {
        let Gaussians { sh_degree, .. } = out.templates;
        out.templates = Gaussians { sh_degree, ..Gaussians::default() };
        (out.own, out.offsets) = (out.templates.clone(), Default::default());
        (out.instances, out.own_ranges, out.template_ranges) = Default::default();
        out.color_from_template.clear();
        out.fitted_levels.clear();
    }
    if let Posed::Instances { odd } = posed
        && (out.templates.len() + out.own.len()) % 2 != usize::from(odd)
    {
        // A Gaussian that no template has.
        let last = out.templates.range(SourceRange { first: 0, count: 1 });
        out.templates.append(&last);
    }
    out.groups.clear();
    out.validate().unwrap();
    out
}

/// A ground with two instances of a splat and one of another, which is drawn 19.6 units from where its offset says.
///
/// Offsets of 8 bits share their limits with other records: those of the first two, 5,000 units to either side, make the steps
/// between values 39.2 units wide. The first of [`cameras`] sees the third splat where it is drawn, and not where it would be.
fn moved_into_view_by_its_packing() -> InstancedScene {
    let mut out = scene(5, Posed::Nothing, 1);
    let sh_degree = out.templates.sh_degree;
    out.templates = Gaussians {
        means: vec![[0.0; 3]; 2],
        quats: vec![[1.0, 0.0, 0.0, 0.0]; 2],
        log_scales: vec![[-0.7; 3]; 2],
        opacity_logits: vec![4.0; 2],
        sh: vec![[0.5; 3]; 2 * (sh_degree as usize + 1).pow(2)],
        sh_degree,
    };
    out.template_ranges = [0, 1].map(|first| SourceRange { first, count: 1 }).to_vec();
    out.own_ranges = vec![SourceRange { first: 0, count: 0 }; 3];
    let instance = |template, first_offset, x| Instance {
        template,
        world_from_template: Similarity::from_parts(DMat3::IDENTITY, 1.0, DVec3::new(x, 0.0, 10.0)),
        first_offset: Some(first_offset),
    };
    out.instances = vec![instance(0, 0, 0.0), instance(0, 1, 0.0), instance(1, 2, -19.6)];
    let means = [-5e3, 5e3, 1.0].map(|x| [x, 0.0, 0.0]).to_vec();
    out.offsets = Offsets { means, sh_dc: vec![[0.0; 3]; 3], opacity_logits: vec![0.0; 3], ..Offsets::default() };
    out.validate().unwrap();
    out
}

/// Cameras above the ground that look along it, one after the other round a circle.
fn cameras() -> Vec<Camera> {
    let look = |k: u32| {
        let (sin, cos) = (f64::from(k) * 0.9).sin_cos();
        let view_from_world =
            [[cos, 0.0, sin, 3.0 * sin], [0.0, 1.0, 0.0, 0.2], [-sin, 0.0, cos, 4.0 * cos], [0.0, 0.0, 0.0, 1.0]];
        Camera { name: String::new(), width: 96, height: 54, fx: 80.0, fy: 80.0, cx: 48.0, cy: 27.0, view_from_world }
    };
    (0..7).map(look).collect()
}

/// The rows of a page as a file has them.
fn rows_of(paged: &PagedBackground, scene: &PagedScene, page: u32) -> Gaussians {
    let page = &scene.pages()[page as usize];
    let mut rows = paged.full.range(page.full);
    rows.append(&paged.fine.range(page.fine));
    rows
}

#[test]
fn pictures_are_those_of_one_piece_whatever_was_there_before() {
    let Some(gpu) = gpu_with_small_chunks() else { return };
    let (even, odd) = (Posed::Instances { odd: false }, Posed::Instances { odd: true });
    let mut evicted = 0;
    for (seed, posed, sh_degree, precision) in [
        (1, even, 2, DevicePrecision::F32),
        (2, odd, 3, DevicePrecision::F16),
        (3, Posed::Nothing, 1, DevicePrecision::F16),
        (4, odd, 0, DevicePrecision::Q8),
    ] {
        evicted += compare(&gpu, &scene(seed, posed, sh_degree), precision);
    }
    assert!(evicted > 20, "{evicted} pages came");
    // Arrays that are larger than a binding.
    let small = with_bindings_of(&gpu, 2 << 20);
    for precision in [DevicePrecision::F32, DevicePrecision::F16] {
        compare(&small, &scene(7, odd, 3), precision);
    }
    assert_silent(&gpu);
    assert_silent(&small);
}

/// Compares pictures of a scene with levels in one piece, and in pages of which three have room. Returns the number of pages that
/// came.
fn compare(gpu: &Arc<Gpu>, scene: &InstancedScene, precision: DevicePrecision) -> usize {
    let mut renderer = Renderer::new(gpu).unwrap();
    let paged = PagedBackground::of(&scene.background);
    let chunk = renderer.variant().workgroup_size;
    let standing = InstancedScene { background: paged.stand_ins.clone(), ..scene.clone() };
    let options = RenderOptions { device_precision: precision, lod_error_px: 2.0, ..RenderOptions::default() };
    let mut whole = renderer.upload_for(scene, &options).unwrap();
    let slots = 3;
    let mut in_pages = PagedScene::new(gpu, &standing, paged.table.clone(), slots, chunk, precision).unwrap();
    assert!(in_pages.pages().len() > slots as usize, "{}", in_pages.pages().len());
    assert_eq!(in_pages.device().expanded_len, whole.expanded_len);
    let (mut complete, mut came) = (0, 0);
    for (k, camera) in cameras().iter().enumerate() {
        // Some instance is hidden, with all its levels.
        if let Some(hidden) = k.checked_rem(scene.instances.len()) {
            let shown: Vec<_> = (0..scene.instances.len()).map(|k| (k, k != hidden)).collect();
            whole.show_instances(&shown).unwrap();
            in_pages.device_mut().show_instances(&shown).unwrap();
        }
        for lod_error_px in [30.0, 8.0, 4.0] {
            let options = RenderOptions { lod_error_px, ..options };
            let view = in_pages.in_view(camera, &options);
            for &page in &view.missing {
                assert!(in_pages.place(page, &rows_of(&paged, &in_pages, page)).unwrap());
                came += 1;
            }
            assert!(in_pages.in_view(camera, &options).missing.is_empty());
            renderer.render(&whole, camera, &options).unwrap();
            let want = renderer.download().unwrap();
            renderer.render(in_pages.device(), camera, &options).unwrap();
            let got = renderer.download().unwrap();
            if view.without_room == 0 {
                complete += 1;
                assert!(got == want, "camera {k}, {lod_error_px} px");
            } else {
                assert!(got != want, "camera {k}: what has no room is coarser");
            }
        }
    }
    assert!(complete > 5 && complete < 21, "{complete} of 21 views had room");
    came
}

/// With room for everything, an error of 0 is full quality; before any page came, nothing is a hole.
#[test]
fn stand_ins_leave_no_hole_and_all_pages_are_full_quality() {
    let Some(gpu) = gpu_with_small_chunks() else { return };
    let mut renderer = Renderer::new(&gpu).unwrap();
    let scene = scene(5, Posed::Instances { odd: false }, 2);
    let paged = PagedBackground::of(&scene.background);
    let (chunk, precision) = (renderer.variant().workgroup_size, DevicePrecision::F32);
    let standing = InstancedScene { background: paged.stand_ins.clone(), ..scene.clone() };
    let options = RenderOptions::default();
    let plain = renderer.upload(&scene).unwrap();
    let mut in_pages = PagedScene::new(&gpu, &standing, paged.table.clone(), 1000, chunk, precision).unwrap();
    for camera in &cameras() {
        renderer.render(&plain, camera, &options).unwrap();
        let want = renderer.download().unwrap();
        renderer.render(in_pages.device(), camera, &options).unwrap();
        let coarse = renderer.download().unwrap();
        let [got, all] = [&coarse, &want].map(alpha);
        let solid = all.iter().filter(|a| a[0] > 0.9).count();
        let holes = got.iter().zip(&all).filter(|(got, all)| all[0] > 0.9 && got[0] < 0.4).count();
        assert!(solid > 500 && holes * 20 < solid, "{holes} holes in {solid} pixels");
        assert!(coarse != want);
    }
    for camera in &cameras() {
        let view = in_pages.in_view(camera, &options);
        assert_eq!(view.without_room, 0);
        for &page in &view.missing {
            assert!(in_pages.place(page, &rows_of(&paged, &in_pages, page)).unwrap());
            assert!(!in_pages.place(page, &rows_of(&paged, &in_pages, page)).unwrap());
        }
        renderer.render(&plain, camera, &options).unwrap();
        let want = renderer.download().unwrap();
        renderer.render(in_pages.device(), camera, &options).unwrap();
        assert!(renderer.download().unwrap() == want);
    }
    assert_silent(&gpu);
}

/// Bounds are those of what is drawn, not of offsets before they were packed.
#[test]
fn a_splat_that_its_packing_moved_into_view_is_drawn() {
    let Some(gpu) = gpu_with_small_chunks() else { return };
    let mut renderer = Renderer::new(&gpu).unwrap();
    let options = RenderOptions { device_precision: DevicePrecision::Q8, ..RenderOptions::default() };
    let camera = &cameras()[0];
    let scene = moved_into_view_by_its_packing();
    let mut whole = renderer.upload_for(&scene, &options).unwrap();
    renderer.render(&whole, camera, &options).unwrap();
    let want = renderer.download().unwrap();
    whole.show_instances(&[(2, false)]).unwrap();
    renderer.render(&whole, camera, &options).unwrap();
    assert!(renderer.download().unwrap() != want, "the splat is not in view");

    let paged = PagedBackground::of(&scene.background);
    let chunk = renderer.variant().workgroup_size;
    let standing = InstancedScene { background: paged.stand_ins.clone(), ..scene };
    let mut in_pages =
        PagedScene::new(&gpu, &standing, paged.table.clone(), 1000, chunk, options.device_precision).unwrap();
    let view = in_pages.in_view(camera, &options);
    assert_eq!(view.without_room, 0);
    for &page in &view.missing {
        assert!(in_pages.place(page, &rows_of(&paged, &in_pages, page)).unwrap());
    }
    renderer.render(in_pages.device(), camera, &options).unwrap();
    assert!(renderer.download().unwrap() == want);
    assert_silent(&gpu);
}

#[test]
fn pages_that_do_not_fit_are_refused() {
    let Some(gpu) = gpu_with_small_chunks() else { return };
    let renderer = Renderer::new(&gpu).unwrap();
    let scene = InstancedScene {
        template_ranges: vec![SourceRange { first: 0, count: 1 }],
        instances: vec![Instance { template: 0, world_from_template: Similarity::IDENTITY, first_offset: None }],
        ..scene(6, Posed::Nothing, 2)
    };
    let paged = PagedBackground::of(&scene.background);
    let mut templates = Gaussians { sh_degree: 1, ..Gaussians::default() };
    templates.set_sh_degree(paged.full.sh_degree);
    templates.append(&paged.full.range(SourceRange { first: 0, count: 1 }));
    let standing = InstancedScene { background: paged.stand_ins.clone(), templates, ..scene };
    let chunk = renderer.variant().workgroup_size;
    let open = |scene: &InstancedScene, table| PagedScene::new(&gpu, scene, table, 2, chunk, DevicePrecision::F16);
    let mut in_pages = open(&standing, paged.table.clone()).unwrap();
    let camera = &cameras()[0];
    in_pages.in_view(camera, &RenderOptions::default());
    let good = rows_of(&paged, &in_pages, 0);
    let mut bad = good.clone();
    bad.means[3][1] = f32::NAN;
    let message = in_pages.place(0, &bad).unwrap_err().to_string();
    assert!(message.contains("not finite in row 3"), "{message}");
    let fewer = good.range(SourceRange { first: 0, count: 5 });
    assert!(in_pages.place(0, &fewer).unwrap_err().to_string().contains("has 5 Gaussians"));
    assert!(in_pages.place(10_000, &good).unwrap_err().to_string().contains("is none of"));
    let mut table = paged.table.clone();
    table.levels.pop();
    assert!(open(&standing, table).is_err());
    let fewer = InstancedScene { background: paged.fine.clone(), ..standing };
    assert!(open(&fewer, paged.table).is_err());
}
