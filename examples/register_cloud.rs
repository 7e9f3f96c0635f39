//! Registers the objects of a trained run and compares the poses with true ones:
//! `cargo run --release --example register_cloud -- RUN DATA [groups.json] [--render] [--photos]`.
//!
//! RUN holds `point_cloud.ply` and `labels.safetensors`, DATA the views, the masks' categories and the true groups. With
//! `--render`, poses are told apart by pictures of the Gaussians; with `--photos`, by the photos inside of the masks.

#![allow(clippy::print_stdout, reason = "an example prints")]

use std::error::Error;
use std::path::Path;
use std::time::Instant;

use instgs_vk::gpu::{Gpu, GpuOptions};
use instgs_vk::io::checkpoint::Checkpoint;
use instgs_vk::io::view_image::load_view;
use instgs_vk::io::{MaskFolder, Split, View, load_scene, read_groups, read_views};
use instgs_vk::math::similarity::Similarity;
use instgs_vk::register::{PoseCheck, RegisterInput, RegisterOptions, RenderCheck, register};
use instgs_vk::render::RenderOptions;
use instgs_vk::scene::{Camera, PosedGroup};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let flag = |name: &str| arguments.iter().any(|a| a == name);
    let paths: Vec<&Path> = arguments.iter().filter(|a| !a.starts_with("--")).map(Path::new).collect();
    let (run, data) = (paths[0], paths[1]);
    let truth = read_groups(paths.get(2).copied().unwrap_or(&data.join("groups.json")))?;
    let cloud = load_scene(&run.join("point_cloud.ply"))?.scene.background;
    let labels_path = run.join("labels.safetensors");
    let labels: Vec<u32> = Checkpoint::read(&labels_path)?.take("instance_of_gaussian", &[], &labels_path)?;
    let views: Vec<View> = read_views(data)?.split(Split::Train).cloned().collect();
    let cameras: Vec<Camera> = views.iter().map(|v| v.camera.clone()).collect();
    let masks = MaskFolder::open(&data.join("masks"))?;
    let none = std::collections::BTreeMap::new();
    let categories = if flag("--no-categories") { &none } else { &masks.categories };
    let input = RegisterInput { cloud: &cloud, instance_of_gaussian: &labels, categories, cameras: &cameras };
    let gpu;
    let mut check = None;
    if flag("--render") || flag("--photos") {
        gpu = Gpu::open(&GpuOptions::default())?;
        let photo_of_view = |i: usize| {
            let view: &View = &views[i];
            let mask = masks.of_view(view).ok().flatten();
            Ok(load_view(view, None).ok().map(|loaded| loaded.image).zip(mask))
        };
        let photos: Option<Box<_>> = if flag("--photos") { Some(Box::new(photo_of_view)) } else { None };
        let photos = photos.map(|p| p as Box<instgs_vk::register::PhotoOfView<'_>>);
        check = Some(RenderCheck::new(&gpu, &cloud, &labels, &cameras, RenderOptions::default(), photos)?);
    }
    let started = Instant::now();
    let found = register(&input, check.as_mut().map(|c| c as &mut dyn PoseCheck), &RegisterOptions::default())?;
    println!("{:.2} s", started.elapsed().as_secs_f64());
    for instance in &found.instances {
        let error = found.groups.iter().find_map(|group| pose_error(&truth, group, instance.instance));
        let (degrees, part) = error.unwrap_or((f64::NAN, f64::NAN));
        println!(
            "{:>3} {:<6} {:>5} Gaussians, inliers {:.3}, rmse {:.4} ({:.2} %), photometric {:.4}: {degrees:6.2} degrees, {:5.2} % {:?} {}",
            instance.instance,
            instance.name.as_deref().unwrap_or("-"),
            instance.gaussians,
            instance.inliers,
            instance.rmse,
            100.0 * instance.relative_rmse,
            instance.photometric.unwrap_or(f64::NAN),
            100.0 * part,
            instance.verdict,
            instance.note
        );
    }
    Ok(())
}

/// Angle in degrees and distance (as a part of a metre) between the found and the true pose of an object, both relative to
/// the found group's reference.
fn pose_error(truth: &[PosedGroup], group: &PosedGroup, id: u32) -> Option<(f64, f64)> {
    let own = |group: &PosedGroup, id: u32| -> Option<Similarity> {
        group.instances.iter().find(|i| i.id == id).map(|i| i.world_from_template)
    };
    let reference = group.instances.first()?;
    let found = own(group, id)?;
    let true_group = truth.iter().find(|g| own(g, id).is_some() && own(g, reference.id).is_some())?;
    let (to, from) = (own(true_group, id)?, own(true_group, reference.id)?);
    // The found pose maps the reference's place in the world; so does the true one.
    let linear = to.linear() * from.linear().inverse();
    let middle = reference.world_from_template.translation();
    let want = linear * (middle - from.translation()) + to.translation();
    let turn = found.rotation().transpose() * (linear * (1.0 / linear.determinant().cbrt()));
    let trace = turn.x_axis.x + turn.y_axis.y + turn.z_axis.z;
    let degrees = (0.5 * (trace - 1.0)).clamp(-1.0, 1.0).acos().to_degrees();
    Some((degrees, want.distance(found.translation())))
}
