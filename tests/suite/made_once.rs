//! What several tests begin with and takes seconds to make: it is made once in a run of the tests, and copied for each.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, OnceLock};

use crate::common::dataset::{photograph, write_points};
use crate::common::program::program;
use crate::paddock::embedded_scene;
use instgs_vk::scene::trajectory::Orbit;

/// The files of a folder: their paths within it, and their bytes.
type Files = Vec<(PathBuf, Vec<u8>)>;

/// What was made so far, by name.
static MADE: Mutex<BTreeMap<String, Arc<OnceLock<Files>>>> = Mutex::new(BTreeMap::new());

/// Has `to` hold what `make` puts into an empty folder, and leaves `make` out where it was called for `name` before.
pub(super) fn once(name: &str, to: &Path, make: impl FnOnce(&Path)) {
    let made = MADE.lock().unwrap().entry(name.into()).or_default().clone();
    let files = made.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        make(folder.path());
        let mut files = Files::new();
        read_files(folder.path(), Path::new(""), &mut files);
        files
    });
    for (path, bytes) in files {
        let path = to.join(path);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, bytes).unwrap();
    }
}

/// Of the car park's Gaussians, every so many is a point to start from.
const POINT_STRIDE: usize = 20;

/// Has `to` be the data set that `synth` makes of these arguments.
pub(super) fn synth(arguments: &[&str], to: &Path) {
    once(&arguments.join(" "), to, |folder| {
        program().arg("synth").args(arguments).arg("--out").arg(folder).assert().success();
    });
}

/// Has `to` be a data set of three cars in 16 photos, as small as registration allows, and of poses that are off.
pub(super) fn three_cars(to: &Path) {
    synth(&["cars", "--views", "16", "--size", "96x54", "--instances", "3", "--pose-noise", "2:0.02"], to);
}

/// Has `at/data` be so many photos of the embedded car park, every eighth of them for test, and points; `size_px` is (width,
/// height). The scene and its cameras are beside it.
pub(super) fn car_park(views: u32, size_px: (u32, u32), at: &Path) {
    let (width, height) = size_px;
    once(&format!("the car park in {views} photos of {width}x{height}"), at, |folder| {
        let scene = embedded_scene();
        photograph(program(), &scene, &Orbit::around(&scene, None).cameras(views, size_px), folder);
        write_points(&scene.flatten(), POINT_STRIDE, &folder.join("data/points3d.ply"));
    });
}

fn read_files(folder: &Path, within: &Path, files: &mut Files) {
    for entry in fs::read_dir(folder.join(within)).unwrap().map(|entry| entry.unwrap()) {
        let path = within.join(entry.file_name());
        match entry.file_type().unwrap().is_dir() {
            true => read_files(folder, &path, files),
            false => files.push((path.clone(), fs::read(folder.join(&path)).unwrap())),
        }
    }
}
