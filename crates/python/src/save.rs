//! Writing a scene, as the command line's `export` does.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use glam::DVec3;
use instgs_io::small::{SmallOptions, SmallPlan};
use instgs_io::{
    ExportFormat, ExportedScene, Pack, PageOptions, RunFolder, export_scene, write_page, write_planned_scene_file,
};
use instgs_objects::pipeline::config::ConfigBuilder;
use instgs_train::config::TrainConfig;
use instgs_train::{
    FinishJob, Finished, TrainError, USUAL_PICTURE_PSNR_DB, finish, measure_sensitivity, sensitivity_cameras,
};
use instgs_vk::scene::InstancedScene;
use instgs_vk::scene::trajectory::Orbit;
use pyo3::prelude::*;

use crate::device::{DeviceName, check_validation, open_device};
use crate::error::{OrRaise, Stopped, look_for_ctrl_c, raised, warn};

/// As many steps as `export --finish` takes.
const MOST_STEPS: u64 = 100_000;

/// How a scene is written.
pub(crate) struct How {
    /// Number format of an `.instgs` file.
    pub(crate) pack: Option<Pack>,
    /// Data set whose views say how precise a small file must be.
    pub(crate) data: Option<PathBuf>,
    /// Closeness of its pictures, dB.
    pub(crate) picture_psnr: Option<f64>,
    /// Number of training steps through the rounding of a small file.
    pub(crate) finish: i64,
    /// Folder of the scene's run, which says how photos are taken for these steps.
    pub(crate) run: Option<PathBuf>,
    /// Direction that becomes +y.
    pub(crate) up: Option<DVec3>,
}

/// The pack of that name.
pub(crate) fn parse_pack(name: &str) -> PyResult<Pack> {
    match name {
        "f32" => Ok(Pack::F32),
        "f16" => Ok(Pack::F16),
        "q8" => Ok(Pack::Q8),
        "small" => Ok(Pack::Small),
        other => Err(raised(format_args!("pack \"{other}\" is none of f32, f16, q8 and small"))),
    }
}

/// Remarks on values that the format, or what else is given, has no use for.
fn unused(how: &How, format: ExportFormat, device: bool) -> Vec<&'static str> {
    let up = "up is for .glb, .usda, .usdc and .html: other formats keep the scene's axes";
    let of_device = "device is for data: without it nothing is drawn";
    let found = [(how.up.is_some() && !format.has_up(), up), (device && how.data.is_none(), of_device)];
    found.into_iter().filter(|(is_unused, _)| *is_unused).map(|(_, text)| text).collect()
}

/// How photos are taken for `finish`: as the scene's run took them, by default at full size, on black, without masks.
fn config_of(how: &How) -> PyResult<TrainConfig> {
    match &how.run {
        None => Ok(TrainConfig::default()),
        Some(_) if how.finish == 0 => Err(raised("run says how finish takes photos: give finish, too")),
        Some(run) => {
            let builder = ConfigBuilder::new().run_file(&RunFolder::new(run).config());
            Ok(builder.and_then(ConfigBuilder::finish).or_raise()?.train)
        }
    }
}

/// Writes the scene in the format of the path's ending.
pub(crate) fn save(
    py: Python<'_>,
    scene: &InstancedScene,
    to: &Path,
    how: How,
    device: Option<DeviceName>,
) -> PyResult<()> {
    let format = ExportFormat::of(to, how.pack).or_raise()?;
    unused(&how, format, device.is_some()).into_iter().try_for_each(|text| warn(py, text))?;
    format.create_folder(to).or_raise()?;
    if let Some(data) = &how.data {
        if !matches!(format, ExportFormat::Instgs(Pack::Small) | ExportFormat::Page(Pack::Small)) {
            return Err(raised("data is for pack=\"small\": other formats keep one precision everywhere"));
        }
        let psnr = how.picture_psnr.unwrap_or(USUAL_PICTURE_PSNR_DB);
        if !(10.0..=120.0).contains(&psnr) {
            return Err(raised(format_args!("picture_psnr is {psnr}: must be from 10 to 120 dB")));
        }
        let steps = u64::try_from(how.finish).ok().filter(|&steps| steps <= MOST_STEPS);
        let Some(steps) = steps else {
            return Err(raised(format_args!("finish is {}: must be from 0 to {MOST_STEPS} steps", how.finish)));
        };
        let config = config_of(&how)?;
        let gpu = open_device(py, device)?;
        let write = || -> Result<Vec<String>, Stopped<TrainError>> {
            let cameras = sensitivity_cameras(data).map_err(TrainError::from)?;
            let sensitivity = &measure_sensitivity(&gpu, scene, &cameras, look_for_ctrl_c)?;
            let (scene, plan, warnings) = if steps > 0 {
                let job = FinishJob { scene, sensitivity, picture_psnr_db: psnr, data, config: &config, to, steps };
                let Finished { scene, plan, warnings } = finish(&gpu, &job, look_for_ctrl_c)?;
                (Cow::Owned(scene), plan, warnings)
            } else {
                let small = SmallOptions { sensitivity, picture_psnr_db: psnr };
                let plan = SmallPlan::new(scene, &small, to).map_err(TrainError::from)?;
                (Cow::Borrowed(scene), plan, Vec::new())
            };
            // The last chance: the file is written in one piece.
            look_for_ctrl_c()?;
            let written = match format {
                ExportFormat::Page(pack) => {
                    let usual = PageOptions::of_views(&scene, pack, &cameras);
                    let up = how.up.unwrap_or(usual.up);
                    write_page(to, &scene, &PageOptions { small: Some(&plan), up, ..usual })
                }
                _ => write_planned_scene_file(to, &scene, &plan),
            };
            written.map_err(TrainError::from)?;
            Ok(warnings)
        };
        let mut notes = py.detach(write)?;
        check_validation(&gpu)?;
        notes.extend(ExportedScene::default().notes(to, scene, format));
        return notes.into_iter().try_for_each(|note| warn(py, note));
    }
    if how.picture_psnr.is_some() {
        return Err(raised("picture_psnr is that of a data set's views: give its folder as data"));
    }
    if how.finish != 0 || how.run.is_some() {
        return Err(raised("finish and run are for the photos of a data set: give its folder as data"));
    }
    let exported = py.detach(|| export_scene(to, scene, format, Orbit::around(scene, how.up).up)).or_raise()?;
    exported.notes(to, scene, format).into_iter().try_for_each(|note| warn(py, note))
}
