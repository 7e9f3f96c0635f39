//! `.html`: a page that holds a scene and draws it, in one file that a browser opens without a server.
//!
//! The scene lies in the page as the `.instgs` file that it is, deflated and as text (`base85.rs`); instances stay instances. The
//! program that unpacks and draws it is in `crates/io/web`, JavaScript modules that `linked` turns into two plain scripts, since
//! browsers load no modules from files: one for the page, one for its worker. `docs/page.md` describes the page for users.
//!
//! Whatever comes from the scene or its file name is data: the title is escaped, cameras are JSON without `<`, and the names of
//! groups are within the packed scene, which the program sets as text.

mod base85;
mod limits;

use std::collections::BTreeSet;
use std::io::Write;
use std::path::Path;

use flate2::Compression;
use flate2::write::DeflateEncoder;
use glam::DVec3;

use crate::scene_pack::Pack;
use crate::scene_write::{packed_scene_file_bytes, planned_scene_file_bytes};
use crate::small::SmallPlan;
use crate::{IoError, RunFolder, atomic_write, read_cameras};
pub(crate) use limits::too_large_note;

use base85::base85;
use instgs_vk::scene::camera::Camera;
use instgs_vk::scene::instanced_scene::InstancedScene;
use instgs_vk::scene::trajectory::Orbit;
use instgs_vk::scene::up::UpAxes;

/// The page, with `{{NAME}}` where something goes.
const TEMPLATE: &str = include_str!("../../web/page.html");

/// A file of `crates/io/web` in this program.
macro_rules! web {
    ($name:literal) => {
        include_str!(concat!("../../web/", $name))
    };
}

/// Modules of the worker, each after those that it uses.
const WORKER: [&str; 10] = [
    web!("base85.js"),
    web!("safetensors.js"),
    web!("coded.js"),
    web!("shapes.js"),
    web!("scene.js"),
    web!("layout.js"),
    web!("textures.js"),
    web!("order.js"),
    web!("pick.js"),
    web!("worker.js"),
];

/// Modules of the page.
const MAIN: [&str; 9] = [
    web!("linear.js"),
    web!("camera.js"),
    web!("layout.js"),
    web!("renderer.js"),
    web!("gpu_renderer.js"),
    web!("viewer.js"),
    web!("panel.js"),
    web!("controls.js"),
    web!("main.js"),
];

/// What a page is to be, besides its scene.
#[derive(Clone, Copy, Debug)]
pub struct PageOptions<'a> {
    /// Number format of the scene in the page.
    pub pack: Pack,
    /// How [`Pack::Small`] rounds; not for other formats.
    pub small: Option<&'a SmallPlan>,
    /// The first view; the scene as a whole if there is none.
    pub camera: Option<&'a Camera>,
    /// Unit vector that points up in the picture, world frame.
    pub up: DVec3,
}

/// The training cameras of the run folder that a scene lies in, the first of which its page begins with; none if there is no file of
/// them.
///
/// # Errors
/// The file cannot be read.
pub fn cameras_beside(scene: &Path) -> Result<Vec<Camera>, IoError> {
    let file = RunFolder::new(scene.parent().unwrap_or(Path::new("."))).cameras();
    if file.is_file() { read_cameras(&file) } else { Ok(Vec::new()) }
}

/// The up axis of the training cameras beside a scene; `None` without them, and if they look straight at the scene's background: it
/// may then be the north of a flight, and the scene itself tells more.
pub fn up_beside(path: &Path, scene: &InstancedScene) -> Option<DVec3> {
    up_of_run(&cameras_beside(path).unwrap_or_default(), scene)
}

/// The same for cameras that are read already.
pub fn up_of_run(cameras: &[Camera], scene: &InstancedScene) -> Option<DVec3> {
    let axes = UpAxes::of(cameras, scene.background.means.iter().copied());
    axes.level.filter(|_| axes.straight.is_none())
}

impl<'a> PageOptions<'a> {
    /// Begins at the first of the views that a scene was trained on, with up as [`up_of_run`] has it. Without views it begins at the
    /// whole scene, and up is a guess.
    pub fn of_views(scene: &InstancedScene, pack: Pack, views: &'a [Camera]) -> Self {
        let up = Orbit::around(scene, up_of_run(views, scene)).up;
        Self { pack, small: None, camera: views.first(), up }
    }
}

/// Writes a scene as a page. The same scene and options give the same bytes. Its title is the file's name.
///
/// # Errors
/// The scene is inconsistent, the plan of `small` is of another one, or the file cannot be written.
pub fn write_page(path: &Path, scene: &InstancedScene, options: &PageOptions<'_>) -> Result<(), IoError> {
    let title = path.file_stem().map_or_else(|| "scene".into(), |stem| stem.to_string_lossy().into_owned());
    let page = page_text(&title, scene, options, path)?;
    atomic_write(path, |out| out.write_all(page.as_bytes()))
}

/// The page of a scene as text, for a page that holds it as a frame; `path` is for messages.
///
/// # Errors
/// The scene is inconsistent, or the plan of `small` is of another one.
pub fn page_text(
    title: &str,
    scene: &InstancedScene,
    options: &PageOptions<'_>,
    path: &Path,
) -> Result<String, IoError> {
    // A page draws at full detail.
    let without_levels =
        (!scene.fitted_levels.is_empty()).then(|| InstancedScene { fitted_levels: Vec::new(), ..scene.clone() });
    let scene = without_levels.as_ref().unwrap_or(scene);
    let file = match options.small.filter(|_| options.pack == Pack::Small) {
        Some(plan) => planned_scene_file_bytes(scene, plan, path)?,
        None => packed_scene_file_bytes(scene, options.pack, path)?,
    };
    let start = start_json(scene, options).map_err(|e| IoError::new(path, format!("cannot write: {e}")))?;
    let packed = deflated(&file).map_err(|e| IoError::os(path, "cannot write", &e))?;
    let values: [(&str, &str); 14] = [
        ("TITLE", &escaped(title)),
        ("STYLE", web!("page.css")),
        ("PROJECT_FRAG", web!("project.frag")),
        ("QUAD_VERT", web!("quad.vert")),
        ("QUAD_FRAG", web!("quad.frag")),
        ("SCREEN_VERT", web!("screen.vert")),
        ("SCREEN_FRAG", web!("screen.frag")),
        ("PROJECT_WGSL", web!("project.wgsl")),
        ("SORT_WGSL", web!("sort.wgsl")),
        ("SPLATS_WGSL", web!("splats.wgsl")),
        ("WORKER", &linked(&WORKER)),
        ("MAIN", &linked(&MAIN)),
        ("START", &start),
        ("SCENE", &base85(&packed)),
    ];
    filled(TEMPLATE, &values).map_err(|what| {
        IoError::new(path, format!("cannot write: {what}")).advise("this is a fault of the program: please report it")
    })
}

/// Where the page begins, as `camera.js` reads it (its `Start`): JSON that may stand in a script element.
fn start_json(scene: &InstancedScene, options: &PageOptions<'_>) -> serde_json::Result<String> {
    let orbit = Orbit::around(scene, Some(options.up));
    let start = serde_json::json!({
        "camera": options.camera,
        "center": orbit.center.to_array(),
        "distance": orbit.distance,
        "up": orbit.up.to_array(),
    });
    // The only character that could end the element; JSON has it only within strings.
    Ok(serde_json::to_string(&start)?.replace('<', "\\u003c"))
}

fn deflated(bytes: &[u8]) -> std::io::Result<Vec<u8>> {
    let mut encoder = DeflateEncoder::new(Vec::new(), Compression::best());
    encoder.write_all(bytes)?;
    encoder.finish()
}

/// Text as HTML, for elements and attributes.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;").replace('\'', "&#39;")
}

/// One plain script of modules: without their imports and exports, names in a scope of their own. Imports take one line each,
/// and modules that go together have no top-level name twice.
fn linked(modules: &[&str]) -> String {
    let mut out = String::from("\"use strict\";\n(() => {\n");
    for line in modules.iter().flat_map(|module| module.lines()).filter(|line| !line.starts_with("import ")) {
        out.push_str(line.strip_prefix("export ").unwrap_or(line));
        out.push('\n');
    }
    out.push_str("})();\n");
    out
}

/// The template with values in place of their names; values are not looked through again.
///
/// # Errors
/// A name without a value, a value without a place, or a name without an end; the text says which.
fn filled(template: &str, values: &[(&str, &str)]) -> Result<String, String> {
    let mut out = String::with_capacity(template.len() + values.iter().map(|(_, value)| value.len()).sum::<usize>());
    let mut unused: BTreeSet<&str> = values.iter().map(|(name, _)| *name).collect();
    let mut rest = template;
    while let Some((before, after)) = rest.split_once("{{") {
        out.push_str(before);
        let (name, after) = after.split_once("}}").ok_or("a name in the page's template has no end")?;
        let value = values.iter().find(|(other, _)| *other == name);
        let (_, value) = value.ok_or_else(|| format!("the page's template has {name}, which has no value"))?;
        unused.remove(name);
        out.push_str(value);
        rest = after;
    }
    out.push_str(rest);
    match unused.first() {
        Some(name) => Err(format!("the page's template has no place for {name}")),
        None => Ok(out),
    }
}

#[cfg(test)]
mod tests;
