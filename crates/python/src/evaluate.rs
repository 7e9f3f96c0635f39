//! `instgs.eval`: a scene's pictures beside a data set's photos, as the command line's `eval`.

use std::path::PathBuf;

use instgs_eval::lpips::weights::{conversion_command, user_weights_path};
use instgs_eval::{EvalError, EvalReport, Extras, InputRange, Lpips, Net, evaluate};
use instgs_io::View;
use instgs_io::dataset::{MissingPhotos, leave_out_missing};
use instgs_train::leave_out_masked;
use instgs_vk::render::{self, RenderOptions};
use pyo3::prelude::*;

use crate::device::{DeviceName, check_validation, open_device};
use crate::error::{OrRaise, Stopped, raised, warn};
use crate::json::to_python;
use crate::look::Look;
use crate::scene::Scene;
use crate::views::views_of;

/// Renders a data set's views and compares them with the photos: PSNR in dB, SSIM, and LPIPS if its weights are there.
///
/// split: "test", "train" or "all"; width: the photos are downscaled to it; exposures: also PSNR up to the photo's exposure,
/// "psnr_exposed"; lpips: "alex" (the default), "vgg" or "squeeze", with weights in lpips_weights or in the user's data folder; a
/// network that is named and has none there is left out with a warning. lpips_range: range of the network's input, "11" = -1..1,
/// as it was trained, or "01" = 0..1: lpips="vgg", lpips_range="01" is what the 3DGS paper's metrics.py computes. on_view: called
/// with (name, figures) after each view; the rest is as for Renderer.render. Returns {"views": [{"name", "psnr", "ssim", "lpips"}],
/// "mean"}. Raises Error, or what on_view raises.
#[pyfunction]
#[pyo3(signature = (
    scene, data, *, split = "test", width = None, background = None, near = None, antialias = None, dilation = None,
    exposures = false, lpips = None, lpips_weights = None, lpips_range = "11", skip_missing = false, device = None,
    on_view = None
))]
#[expect(clippy::too_many_arguments, reason = "they are keywords in Python")]
pub(crate) fn eval<'py>(
    py: Python<'py>,
    scene: &Scene,
    data: PathBuf,
    split: &str,
    width: Option<i64>,
    background: Option<[f32; 3]>,
    near: Option<f32>,
    antialias: Option<bool>,
    dilation: Option<f32>,
    exposures: bool,
    lpips: Option<&str>,
    lpips_weights: Option<PathBuf>,
    lpips_range: &str,
    skip_missing: bool,
    device: Option<DeviceName>,
    on_view: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyAny>> {
    let checked = |width: i64| u32::try_from(width).ok().filter(|&width| width > 0).ok_or(width);
    let width = width.map(checked).transpose();
    let width = width.map_err(|w| raised(format_args!("width is {w}: want 1 or more, or leave it out")))?;
    let scene = scene.snapshot(py);
    let options = Look { background, near, antialias, dilation, lod: None }.options(&scene);
    let (network, left_out) = network(py, lpips, lpips_range, lpips_weights)?;
    let views = views(py, data, split, skip_missing, width)?;
    let gpu = open_device(py, device)?;
    let run = || -> Result<(EvalReport, u64), Stopped<EvalError>> {
        let failed = |error| EvalError::Render { view: "the scene".into(), error };
        let mut renderer = render::Renderer::new(&gpu).map_err(failed)?;
        let on_device = renderer.upload_for(&scene, &options).map_err(failed)?;
        let extras = Extras { lpips: network.as_ref(), exposures };
        compare(&mut renderer, &on_device, &views, width, &options, extras, on_view.as_ref())
    };
    let (report, visible) = py.detach(run)?;
    check_validation(&gpu)?;
    if visible == 0 && scene.expanded_len() > 0 {
        warn(py, format_args!("nothing is visible from these views (near is {}; see near=)", options.near))?;
    }
    left_out.map_or(Ok(()), |text| warn(py, text))?;
    if let Some(lpips) = network.filter(|_| report.mean.lpips.is_none()) {
        warn(py, format_args!("LPIPS has no mean: some pictures are too small for {}", lpips.net().name()))?;
    }
    to_python(py, &report)
}

/// The views to compare: with photos, of which some pixel counts at the width of the comparison. Remarks are warnings.
fn views(py: Python<'_>, data: PathBuf, split: &str, skip_missing: bool, width: Option<u32>) -> PyResult<Vec<View>> {
    let mut views = views_of(py, &data, split)?;
    let may_be_missing = if skip_missing { MissingPhotos::Skip } else { MissingPhotos::Few };
    leave_out_missing(&mut views, may_be_missing).or_raise()?.iter().try_for_each(|note| warn(py, note))?;
    // Photos are decoded for this, so only where there are masks.
    if views.iter().any(|view| view.mask_path.is_some()) {
        let masked = py.detach(|| leave_out_masked(&mut views, width, &mut || Ok(()))).or_raise()?;
        masked.iter().try_for_each(|note| warn(py, note))?;
    }
    Ok(views)
}

/// The network of LPIPS, if it has weights: those given, or the user's. If it was asked for by name and has none, a remark.
fn network(
    py: Python<'_>,
    name: Option<&str>,
    range: &str,
    weights: Option<PathBuf>,
) -> PyResult<(Option<Lpips>, Option<String>)> {
    let wanted = name.unwrap_or(Net::Alex.name());
    let Some(net) = Net::ALL.into_iter().find(|net| net.name() == wanted) else {
        return Err(raised(format_args!("lpips \"{wanted}\" is none of alex, vgg and squeeze")));
    };
    let range = match range {
        "11" => InputRange::MinusOneToOne,
        "01" => InputRange::ZeroToOne,
        other => return Err(raised(format_args!("lpips_range \"{other}\" is neither 11 nor 01"))),
    };
    let path = match weights.map_or_else(|| users_weights(net), Ok) {
        Ok(path) => path,
        Err(reason) => return Ok((None, name.map(|_| format!("LPIPS is left out: {reason}")))),
    };
    let network = py.detach(|| Lpips::load(net, range, &path)).or_raise()?;
    Ok((Some(network), None))
}

/// The file of weights in the user's data folder, or why there is none.
fn users_weights(net: Net) -> Result<PathBuf, String> {
    let path = user_weights_path(net).ok_or("the system names no user's data folder; see lpips_weights=")?;
    match path.exists() {
        true => Ok(path),
        false => Err(format!("{} does not exist; make it with: {}", path.display(), conversion_command(net, &path))),
    }
}

/// The figures, and the number of Gaussians that the views show, each counted in every view.
fn compare(
    renderer: &mut render::Renderer,
    scene: &render::DeviceScene,
    views: &[View],
    width: Option<u32>,
    options: &RenderOptions,
    extras: Extras<'_>,
    on_view: Option<&Py<PyAny>>,
) -> Result<(EvalReport, u64), Stopped<EvalError>> {
    let mut visible = 0;
    let report = evaluate(renderer, scene, views, width, options, extras, |view| {
        visible += view.visible;
        let told = Python::attach(|py| {
            py.check_signals()?;
            match on_view {
                Some(on_view) => on_view.call1(py, (view.name, to_python(py, &view.metrics)?)).map(drop),
                None => Ok(()),
            }
        });
        told.map_err(Stopped::Python)
    })?;
    Ok((report, visible))
}
