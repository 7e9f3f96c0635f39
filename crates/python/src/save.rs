//! Writing a scene, as the command line's `export` does.

use std::path::{Path, PathBuf};

use glam::DVec3;
use instgs_io::small::{SmallOptions, SmallPlan};
use instgs_io::{ExportFormat, ExportedScene, Pack, PageOptions, export_scene, write_page, write_planned_scene_file};
use instgs_train::{USUAL_PICTURE_PSNR_DB, measure_sensitivity, sensitivity_cameras};
use instgs_vk::scene::InstancedScene;
use instgs_vk::scene::trajectory::Orbit;
use pyo3::prelude::*;

use crate::device::{DeviceName, check_validation, open_device};
use crate::error::{OrRaise, raised, warn};

/// How a scene is written.
pub(crate) struct How {
    /// Number format of an `.instgs` file.
    pub(crate) pack: Option<Pack>,
    /// Data set whose views say how precise a small file must be.
    pub(crate) data: Option<PathBuf>,
    /// Closeness of its pictures, dB.
    pub(crate) picture_psnr: Option<f64>,
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
    if let Some(data) = &how.data {
        if !matches!(format, ExportFormat::Instgs(Pack::Small) | ExportFormat::Page(Pack::Small)) {
            return Err(raised("data is for pack=\"small\": other formats keep one precision everywhere"));
        }
        let psnr = how.picture_psnr.unwrap_or(USUAL_PICTURE_PSNR_DB);
        if !(10.0..=120.0).contains(&psnr) {
            return Err(raised(format_args!("picture_psnr is {psnr}: must be from 10 to 120 dB")));
        }
        let gpu = open_device(py, device)?;
        let write = || -> Result<(), instgs_train::TrainError> {
            let cameras = sensitivity_cameras(data)?;
            let sensitivity = measure_sensitivity(&gpu, scene, &cameras, || ())?;
            let small = SmallOptions { sensitivity: &sensitivity, picture_psnr_db: psnr };
            let plan = SmallPlan::new(scene, &small, to)?;
            match format {
                ExportFormat::Page(pack) => {
                    let usual = PageOptions::of_views(scene, pack, &cameras);
                    let up = how.up.unwrap_or(usual.up);
                    write_page(to, scene, &PageOptions { small: Some(&plan), up, ..usual })?;
                }
                _ => write_planned_scene_file(to, scene, &plan)?,
            }
            Ok(())
        };
        py.detach(write).or_raise()?;
        check_validation(&gpu)?;
        let notes = ExportedScene::default().notes(to, scene, format);
        return notes.into_iter().try_for_each(|note| warn(py, note));
    }
    if how.picture_psnr.is_some() {
        return Err(raised("picture_psnr is that of a data set's views: give its folder as data"));
    }
    let exported = py.detach(|| export_scene(to, scene, format, Orbit::around(scene, how.up).up)).or_raise()?;
    exported.notes(to, scene, format).into_iter().try_for_each(|note| warn(py, note))
}
