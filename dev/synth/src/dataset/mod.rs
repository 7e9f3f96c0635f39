//! `instgs-vk synth`: data sets with repeated objects and known truth. Ray-traced photos of a procedural scene, with
//! cameras, masks, depth, points, groups and poses.
//!
//! A scene ([`scenes`]) places meshes ([`models`]) with a [`scene_builder`]; a [`world`] traces rays through two levels of
//! [`bvh`]. The sun is sampled per pixel ([`frame`]); sky and bounced light come from a cache ([`irradiance`]), so
//! pictures are almost free of noise and consistent between views. The output is deterministic for a given name,
//! options and build, with any number of threads.

pub mod bvh;
mod files;
pub mod frame;
pub mod irradiance;
pub mod light;
pub mod look;
pub mod mesh;
pub mod models;
pub mod noise;
mod points;
pub mod scene_builder;
pub mod scenes;
pub mod truth;
pub mod views;
pub mod world;

use std::path::Path;

pub use scenes::{ObjectCount, RECIPES, Recipe};
pub use truth::PoseNoise;

use instgs_io::groups::write_groups;
use instgs_io::{IoError, atomic_write, write_points};
use instgs_vk::scene::camera::MAX_IMAGE_SIDE;
use instgs_vk::scene::{Camera, PosedGroup};
use irradiance::Irradiance;
use scene_builder::Scene;

/// Largest number of views of a data set.
pub const MAX_VIEWS: u32 = 10_000;

/// Smallest distance of a flight, metres: nearer cameras are inside objects.
pub const MIN_FLIGHT: f64 = 0.5;
/// Largest distance of a flight, metres: farther away a scene covers a few pixels.
pub const MAX_FLIGHT: f64 = 1000.0;

/// Options of a data set.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Number of views, 2..=[`MAX_VIEWS`]: at least one is for training and one for test.
    pub views: u32,
    /// Width and height of the photos, pixels.
    pub size: (u32, u32),
    /// Seed of all random draws.
    pub seed: u64,
    /// Number of objects, `None` = the scene's default; see [`Recipe::instances`].
    pub instances: Option<u32>,
    /// Part of the differences between objects of a kind that is shown, 0..=1: at 0 all look like the first one, and
    /// from 0.5 on each has its own parts. Sizes do not change.
    pub differences: f64,
    /// Cameras on a line to the target instead of on rings, from the first distance to the second, metres.
    pub flight: Option<(f64, f64)>,
    /// Also writes `groups_noisy.json` with poses disturbed by this much.
    pub pose_noise: Option<PoseNoise>,
}

impl Default for Options {
    fn default() -> Self {
        Self { views: 48, size: (320, 180), seed: 1, instances: None, differences: 1.0, flight: None, pose_noise: None }
    }
}

/// Result of [`write()`].
#[derive(Clone, Debug, PartialEq)]
pub struct Truth {
    /// All cameras in order of their names.
    pub cameras: Vec<Camera>,
    /// True groups with their poses.
    pub groups: Vec<PosedGroup>,
    /// Groups with disturbed poses, if [`Options::pose_noise`] is given.
    pub disturbed: Option<Vec<PosedGroup>>,
    /// Number of points in `points3d.ply`.
    pub points: usize,
    /// Number of triangles, each mesh counted once.
    pub triangles: usize,
}

/// Errors of making a data set.
#[derive(Debug, thiserror::Error)]
pub enum SynthError {
    /// A file or folder cannot be used.
    #[error(transparent)]
    Io(#[from] IoError),
    /// No scene has this name.
    #[error("there is no scene {0}; there are {names}", names = names())]
    UnknownName(String),
    /// An option is out of range.
    #[error("{option}: {what}")]
    Option {
        /// Name of the option that is wrong.
        option: &'static str,
        /// What is wrong with its value.
        what: String,
    },
}

fn names() -> String {
    RECIPES.map(|recipe| recipe.name).join(", ")
}

/// Builds the scene with the given name.
///
/// # Errors
/// No such scene; a number of objects that it cannot have; an option out of range.
pub fn build(name: &str, options: &Options) -> Result<Scene, SynthError> {
    let recipe = RECIPES.iter().find(|r| r.name == name).ok_or_else(|| SynthError::UnknownName(name.into()))?;
    let ObjectCount { usual: own, least, most } = recipe.instances;
    let count = options.instances.unwrap_or(own);
    if !(least..=most).contains(&count) {
        let range = if least == most { least.to_string() } else { format!("{least} to {most}") };
        return Err(SynthError::Option {
            option: "instances",
            what: format!("{name} has {range} objects, not {count}"),
        });
    }
    check(options)?;
    Ok((recipe.build)(options.seed, count).with_differences(options.differences as f32))
}

fn check(options: &Options) -> Result<(), SynthError> {
    let fail = |option, what: String| Err(SynthError::Option { option, what });
    let (w, h) = options.size;
    if !(1..=MAX_IMAGE_SIDE).contains(&w) || !(1..=MAX_IMAGE_SIDE).contains(&h) {
        return fail("size", format!("{w}x{h} is not within 1 to {MAX_IMAGE_SIDE} pixels"));
    }
    if !(2..=MAX_VIEWS).contains(&options.views) {
        return fail("views", format!("{} is not within 2 to {MAX_VIEWS}", options.views));
    }
    if !(0.0..=1.0).contains(&options.differences) {
        return fail("differences", format!("{} is not within 0 to 1", options.differences));
    }
    let distance = |d: f64| (MIN_FLIGHT..=MAX_FLIGHT).contains(&d);
    if options.flight.is_some_and(|(from, to)| !distance(from) || !distance(to)) {
        return fail("flight", format!("distances must be within {MIN_FLIGHT} to {MAX_FLIGHT} metres"));
    }
    let sound = |n: PoseNoise| (0.0..=180.0).contains(&n.degrees) && (0.0..=1.0).contains(&n.part);
    if options.pose_noise.is_some_and(|n| !sound(n)) {
        return fail("pose-noise", "needs an angle of 0 to 180 degrees and a part of 0 to 1".into());
    }
    Ok(())
}

/// Writes the data set `name` to the folder `out`: `images/`, `masks/` (with `categories.json`), `depth/` (`.ktx2`,
/// view-space z, 0 = sky), `transforms.json` and the pair with the split, `points3d.ply`, `groups.json`, and
/// `groups_noisy.json` on request. `on_view` receives the number of views that are done, starting with 0; `E` is the caller's
/// error type, with which it can stop: what is written until then stays.
///
/// # Errors
/// An unknown name; an option out of range; a folder with other content; a file that cannot be written; or what `on_view` returns.
pub fn write<E: From<SynthError>>(
    name: &str,
    out: &Path,
    options: &Options,
    on_view: &mut dyn FnMut(u32) -> Result<(), E>,
) -> Result<Truth, E> {
    let scene = build(name, options)?;
    let cameras = match options.flight {
        Some(distances) => scene.rig.flight(options.views, options.size, distances),
        None => scene.rig.cameras(options.views, options.size, options.seed),
    };
    let groups = truth::groups(&scene);
    let disturbed = options.pose_noise.map(|noise| truth::disturbed_groups(&scene, noise, options.seed));
    begin(name, out, options, &groups, disturbed.as_deref()).map_err(SynthError::from)?;
    on_view(0)?;
    let light = light_of(&scene, &cameras, options.seed);
    let cloud = points::cloud(&scene, &light, &cameras, options.seed);
    write_points(&out.join("points3d.ply"), &cloud).map_err(SynthError::from)?;
    for (i, camera) in cameras.iter().enumerate() {
        let frame = frame::take(&scene, &light, camera, options.seed, i as u64);
        files::write_view(out, camera, frame).map_err(SynthError::from)?;
        on_view(i as u32 + 1)?;
    }
    files::write_cameras(out, &cameras).map_err(SynthError::from)?;
    let triangles = scene.world.triangles();
    Ok(Truth { cameras, groups, disturbed, points: cloud.len(), triangles })
}

/// Makes the folder, and writes what is known before a view is drawn.
fn begin(
    name: &str,
    out: &Path,
    options: &Options,
    groups: &[PosedGroup],
    disturbed: Option<&[PosedGroup]>,
) -> Result<(), IoError> {
    files::prepare(out)?;
    write_mark(name, out, options)?;
    write_groups(&out.join("groups.json"), groups)?;
    files::write_names(out, groups)?;
    write_disturbed(out, disturbed)
}

/// Computes the indirect light of the surfaces that the cameras see.
pub fn light_of(scene: &Scene, cameras: &[Camera], seed: u64) -> Irradiance {
    Irradiance::light(scene, points::seen(scene, cameras), seed)
}

fn write_mark(name: &str, out: &Path, options: &Options) -> Result<(), IoError> {
    let noise = options.pose_noise.map(|n| [n.degrees, n.part]);
    let mark = serde_json::json!({ "name": name, "views": options.views, "size": options.size, "seed": options.seed,
        "instances": options.instances, "differences": options.differences, "flight": options.flight, "pose_noise": noise, "version": env!("CARGO_PKG_VERSION") });
    let text = format!("{mark:#}\n");
    atomic_write(&out.join(files::MARK), |file| file.write_all(text.as_bytes()))
}

/// Writes `groups_noisy.json`, or removes that of an earlier data set.
fn write_disturbed(out: &Path, groups: Option<&[PosedGroup]>) -> Result<(), IoError> {
    let path = out.join("groups_noisy.json");
    match groups {
        Some(groups) => write_groups(&path, groups),
        None if path.is_file() => {
            std::fs::remove_file(&path).map_err(|e| IoError::new(&path, format!("cannot remove it: {e}")))
        }
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests;
