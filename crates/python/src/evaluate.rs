//! `instgs.eval`: a scene's pictures beside a data set's photos, as the command line's `eval`.

use std::path::PathBuf;

use instgs_eval::lpips::weights::user_weights_path;
use instgs_eval::{EvalError, EvalReport, Extras, InputRange, Lpips, Net, evaluate};
use instgs_io::View;
use instgs_io::dataset::{MissingPhotos, leave_out_missing};
use instgs_vk::render::{self, RenderOptions};
use pyo3::prelude::*;

use crate::device::{DeviceName, check_validation, open_device};
use crate::error::{OrRaise, raised, warn};
use crate::json::to_python;
use crate::look::Look;
use crate::scene::Scene;
use crate::views::views_of;

/// Why an evaluation ended early.
enum Stopped {
    /// The user's callback, or Ctrl-C.
    Python(PyErr),
    /// A photo or a picture.
    Failed(EvalError),
}

impl From<EvalError> for Stopped {
    fn from(error: EvalError) -> Self {
        Self::Failed(error)
    }
}

/// Renders a data set's views and compares them with the photos: PSNR in dB, SSIM, and LPIPS if its weights are there.
///
/// split: "test", "train" or "all"; width: the photos are downscaled to it; exposures: also PSNR up to the photo's exposure;
/// lpips: "alex", "vgg" or "squeeze", with weights in lpips_weights or in the user's data folder; on_view: called with (name,
/// figures) after each view; the rest is as for Renderer.render. Returns {"views": [{"name", "psnr", "ssim", "lpips"}], "mean"}.
/// Raises Error, or what on_view raises.
#[pyfunction]
#[pyo3(signature = (
    scene, data, *, split = "test", width = None, background = None, near = None, antialias = None, dilation = None,
    exposures = false, lpips = "alex", lpips_weights = None, skip_missing = false, device = None, on_view = None
))]
#[expect(clippy::too_many_arguments, reason = "they are keywords in Python")]
pub(crate) fn eval<'py>(
    py: Python<'py>,
    scene: &Scene,
    data: PathBuf,
    split: &str,
    width: Option<u32>,
    background: Option<[f32; 3]>,
    near: Option<f32>,
    antialias: Option<bool>,
    dilation: Option<f32>,
    exposures: bool,
    lpips: &str,
    lpips_weights: Option<PathBuf>,
    skip_missing: bool,
    device: Option<DeviceName>,
    on_view: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyAny>> {
    let scene = scene.scene.clone();
    let options = Look { background, near, antialias, dilation, lod: None }.options(&scene);
    let network = network(py, lpips, lpips_weights)?;
    let views = views(py, data, split, skip_missing)?;
    let gpu = open_device(py, device)?;
    let run = || -> Result<EvalReport, Stopped> {
        let failed = |error| EvalError::Render { view: "the scene".into(), error };
        let mut renderer = render::Renderer::new(&gpu).map_err(failed)?;
        let on_device = renderer.upload(&scene).map_err(failed)?;
        let extras = Extras { lpips: network.as_ref(), exposures };
        compare(&mut renderer, &on_device, &views, width, &options, extras, on_view.as_ref())
    };
    let report = py.detach(run).map_err(|stopped| match stopped {
        Stopped::Python(error) => error,
        Stopped::Failed(error) => raised(error),
    })?;
    check_validation(&gpu)?;
    to_python(py, &report)
}

/// The views to compare, with photos. Remarks are warnings.
fn views(py: Python<'_>, data: PathBuf, split: &str, skip_missing: bool) -> PyResult<Vec<View>> {
    let mut views = views_of(py, &data, split)?;
    let may_be_missing = if skip_missing { MissingPhotos::Skip } else { MissingPhotos::Few };
    leave_out_missing(&mut views, may_be_missing).or_raise()?.iter().try_for_each(|note| warn(py, note))?;
    Ok(views)
}

/// The network of LPIPS, if it has weights: those given, or the user's.
fn network(py: Python<'_>, name: &str, weights: Option<PathBuf>) -> PyResult<Option<Lpips>> {
    let nets = [Net::Alex, Net::Vgg, Net::Squeeze];
    let Some(net) = nets.into_iter().find(|net| net.name() == name) else {
        return Err(raised(format_args!("lpips \"{name}\" is none of alex, vgg and squeeze")));
    };
    let weights = weights.or_else(|| user_weights_path(net).filter(|path| path.exists()));
    let Some(path) = weights else { return Ok(None) };
    py.detach(|| Lpips::load(net, InputRange::MinusOneToOne, &path)).map(Some).or_raise()
}

fn compare(
    renderer: &mut render::Renderer,
    scene: &render::DeviceScene,
    views: &[View],
    width: Option<u32>,
    options: &RenderOptions,
    extras: Extras<'_>,
    on_view: Option<&Py<PyAny>>,
) -> Result<EvalReport, Stopped> {
    evaluate(renderer, scene, views, width, options, extras, |view| {
        let told = Python::attach(|py| {
            py.check_signals()?;
            match on_view {
                Some(on_view) => on_view.call1(py, (view.name, to_python(py, &view.metrics)?)).map(drop),
                None => Ok(()),
            }
        });
        told.map_err(Stopped::Python)
    })
}
