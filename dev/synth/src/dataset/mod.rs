//! Data sets with repeated objects whose truth is known: photos of a procedural scene, ray-traced, with cameras, masks,
//! depth, points, groups and poses. `instgs-vk synth`.
//!
//! A scene ([`scenes`]) places meshes ([`models`]) on a [`stage`]; a [`world`] answers rays through two levels of [`bvh`].
//! The sun is sampled per pixel ([`frame`]); sky and bounced light are computed once per place ([`irradiance`]), so
//! pictures are almost free of noise and all views agree. Everything follows from name, options and build: the same
//! bytes each time, whatever the number of threads.

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
pub mod scenes;
pub mod stage;
pub mod truth;
pub mod views;
pub mod world;

use std::path::Path;

pub use scenes::{RECIPES, Recipe};
pub use truth::PoseNoise;

use crate::io::groups::write_groups;
use crate::io::{IoError, atomic_write, write_points};
use crate::scene::camera::MAX_IMAGE_SIDE;
use crate::scene::{Camera, PosedGroup};
use irradiance::Irradiance;
use stage::Scene;

/// Most views of a data set.
pub const MAX_VIEWS: u32 = 10_000;

/// Distances of a flight, metres: nearer, cameras are inside objects; farther, a scene is a few pixels.
pub const MIN_FLIGHT: f64 = 0.5;
/// See [`MIN_FLIGHT`].
pub const MAX_FLIGHT: f64 = 1000.0;

/// What a data set is made with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Number of views, 2..=[`MAX_VIEWS`]: one at least is for training, and one for test.
    pub views: u32,
    /// Width and height in pixels.
    pub size: (u32, u32),
    /// Seed of everything that is drawn.
    pub seed: u64,
    /// Number of objects, `None` = the scene's own; see [`Recipe::instances`].
    pub instances: Option<u32>,
    /// How much of what objects of a kind differ by is shown, 0..=1: at 0 all look as the first of them, and from 0.5 on
    /// each has its own parts. Sizes stay.
    pub differences: f64,
    /// Cameras on a line to the target, from the first distance to the second, metres, instead of on rings.
    pub flight: Option<(f64, f64)>,
    /// Also writes `groups_noisy.json`, with poses that are off by this much.
    pub pose_noise: Option<PoseNoise>,
}

impl Default for Options {
    fn default() -> Self {
        Self { views: 48, size: (320, 180), seed: 1, instances: None, differences: 1.0, flight: None, pose_noise: None }
    }
}

/// What was written.
#[derive(Clone, Debug, PartialEq)]
pub struct Truth {
    /// All cameras, in order of their names.
    pub cameras: Vec<Camera>,
    /// True groups and poses.
    pub groups: Vec<PosedGroup>,
    /// Poses that are off, if asked for.
    pub disturbed: Option<Vec<PosedGroup>>,
    /// Points in `points3d.ply`.
    pub points: usize,
    /// Triangles of all meshes, each counted once.
    pub triangles: usize,
}

/// Why there is no data set.
#[derive(Debug, thiserror::Error)]
pub enum SynthError {
    /// A file.
    #[error(transparent)]
    Io(#[from] IoError),
    /// A name that no scene has.
    #[error("there is no scene {0}; there are {names}", names = names())]
    UnknownName(String),
    /// An option beyond its bounds.
    #[error("{option}: {what}")]
    Option {
        /// Which.
        option: &'static str,
        /// What is wrong.
        what: String,
    },
}

fn names() -> String {
    RECIPES.map(|recipe| recipe.name).join(", ")
}

/// The scene of this name.
///
/// # Errors
/// There is none, or it cannot have so many objects.
pub fn build(name: &str, options: &Options) -> Result<Scene, SynthError> {
    let recipe = RECIPES.iter().find(|r| r.name == name).ok_or_else(|| SynthError::UnknownName(name.into()))?;
    let (own, least, most) = recipe.instances;
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
        return fail("flight", format!("want distances of {MIN_FLIGHT} to {MAX_FLIGHT} metres"));
    }
    let sound = |n: PoseNoise| (0.0..=180.0).contains(&n.degrees) && (0.0..=1.0).contains(&n.part);
    if options.pose_noise.is_some_and(|n| !sound(n)) {
        return fail("pose-noise", "want an angle of 0 to 180 degrees and a part of 0 to 1".into());
    }
    Ok(())
}

/// Makes the data set `name` in the folder `out`: `images/`, `masks/` (with `categories.json`), `depth/` (`.ktx2`, view-space
/// z, 0 = sky), `transforms.json` and the pair with the split, `points3d.ply`, `groups.json`, and `groups_noisy.json` if
/// asked for. `on_view` is told the number of views that are done, from 0 on.
///
/// # Errors
/// An unknown name, an option beyond its bounds, a folder that holds something else, a file that cannot be written.
pub fn write(name: &str, out: &Path, options: &Options, on_view: &mut dyn FnMut(u32)) -> Result<Truth, SynthError> {
    let scene = build(name, options)?;
    let cameras = match options.flight {
        Some(distances) => scene.rig.flight(options.views, options.size, distances),
        None => scene.rig.cameras(options.views, options.size, options.seed),
    };
    files::prepare(out)?;
    write_mark(name, out, options)?;
    let groups = truth::groups(&scene);
    write_groups(&out.join("groups.json"), &groups)?;
    files::write_names(out, &groups)?;
    let disturbed = options.pose_noise.map(|noise| truth::disturbed_groups(&scene, noise, options.seed));
    write_disturbed(out, disturbed.as_deref())?;
    on_view(0);
    let light = light_of(&scene, &cameras, options.seed);
    let cloud = points::cloud(&scene, &light, &cameras, options.seed);
    write_points(&out.join("points3d.ply"), &cloud)?;
    for (i, camera) in cameras.iter().enumerate() {
        let frame = frame::take(&scene, &light, camera, options.seed, i as u64);
        files::write_view(out, camera, frame)?;
        on_view(i as u32 + 1);
    }
    files::write_cameras(out, &cameras)?;
    let triangles = scene.world.triangles();
    Ok(Truth { cameras, groups, disturbed, points: cloud.len(), triangles })
}

/// Lights what the cameras see.
pub fn light_of(scene: &Scene, cameras: &[Camera], seed: u64) -> Irradiance {
    Irradiance::light(scene, points::seen(scene, cameras), seed)
}

fn write_mark(name: &str, out: &Path, options: &Options) -> Result<(), IoError> {
    let noise = options.pose_noise.map(|n| [n.degrees, n.part]);
    let mark = serde_json::json!({ "name": name, "views": options.views, "size": options.size, "seed": options.seed,
        "instances": options.instances, "flight": options.flight, "pose_noise": noise, "version": env!("CARGO_PKG_VERSION") });
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
