//! The metrics of one evaluation, as they are written to JSON.

use serde::{Deserialize, Serialize};

use crate::error::EvalError;
use crate::exposure::with_exposures;
use crate::lpips::{Lpips, LpipsError};
use crate::pair::PicturePair;
use crate::psnr::psnr;
use crate::ssim::ssim;
use instgs_io::json::null_is_nan;

/// Metrics of one picture pair, or their mean over several.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Metrics {
    /// Peak signal-to-noise ratio in dB, higher is better; at most [`crate::MAX_PSNR_DB`]. A mean is the mean of
    /// the dB values.
    #[serde(deserialize_with = "null_is_nan")]
    pub psnr: f64,
    /// Structural similarity, at most 1, higher is better.
    #[serde(deserialize_with = "null_is_nan")]
    pub ssim: f64,
    /// LPIPS distance, at least 0, lower is better; `None` (null in JSON) if not computed.
    pub lpips: Option<f64>,
    /// PSNR with the exposure of each half of the photo fitted on the other half (see [`with_exposures`]), dB; `None`, and
    /// not in JSON, if not computed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub psnr_exposed: Option<f64>,
}

/// What is computed besides PSNR and SSIM.
#[derive(Clone, Copy, Default)]
pub struct Extras<'a> {
    /// The network of LPIPS.
    pub lpips: Option<&'a Lpips>,
    /// Whether exposures are fitted.
    pub exposures: bool,
}

/// The metrics of one view.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ViewMetrics {
    /// Name of the view's camera.
    pub name: String,
    /// Metrics of the view.
    #[serde(flatten)]
    pub metrics: Metrics,
}

/// All views and their mean. JSON: `{"views":[{"name","psnr","ssim","lpips"}],"mean":{"psnr","ssim","lpips"}}`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct EvalReport {
    /// One entry per view in the dataset's order, at least one.
    pub views: Vec<ViewMetrics>,
    /// The mean of each metric over the views; LPIPS only if every view has it.
    pub mean: Metrics,
}

impl Metrics {
    /// The metrics of a pair; LPIPS if its network is given and the picture is large enough for it.
    ///
    /// # Errors
    /// LPIPS failed for another reason than the picture's size.
    pub fn of(pair: &PicturePair, extras: Extras<'_>) -> Result<Self, LpipsError> {
        let psnr_exposed = extras.exposures.then(|| psnr(&with_exposures(pair)));
        let lpips = match extras.lpips.map(|lpips| lpips.distance(pair)).transpose() {
            Err(LpipsError::TooSmall { .. }) => None,
            other => other?,
        };
        Ok(Self { psnr: psnr(pair), ssim: ssim(pair), lpips, psnr_exposed })
    }

    /// The same metrics with a view's name.
    pub fn named(self, name: impl Into<String>) -> ViewMetrics {
        ViewMetrics { name: name.into(), metrics: self }
    }
}

impl EvalReport {
    /// The report of these views, with their mean.
    ///
    /// # Errors
    /// `views` is empty.
    pub fn new(views: Vec<ViewMetrics>) -> Result<Self, EvalError> {
        if views.is_empty() {
            return Err(EvalError::NoViews);
        }
        let count = views.len() as f64;
        let mean = |of: fn(&Metrics) -> f64| views.iter().map(|view| of(&view.metrics)).sum::<f64>() / count;
        let lpips: Option<f64> = views.iter().map(|view| view.metrics.lpips).sum();
        let exposed: Option<f64> = views.iter().map(|view| view.metrics.psnr_exposed).sum();
        let mean = Metrics {
            psnr: mean(|m| m.psnr),
            ssim: mean(|m| m.ssim),
            lpips: lpips.map(|sum| sum / count),
            psnr_exposed: exposed.map(|sum| sum / count),
        };
        Ok(Self { views, mean })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_and_json() -> Result<(), Box<dyn std::error::Error>> {
        let view = |name: &str, psnr, lpips| Metrics { psnr, ssim: 0.5, lpips, psnr_exposed: None }.named(name);
        let report = EvalReport::new(vec![view("a", 20.0, Some(0.25)), view("b", 30.0, None)])?;
        let want = r#"{"views":[{"name":"a","psnr":20.0,"ssim":0.5,"lpips":0.25},{"name":"b","psnr":30.0,"ssim":0.5,"lpips":null}],"mean":{"psnr":25.0,"ssim":0.5,"lpips":null}}"#;
        assert_eq!(serde_json::to_string(&report)?, want);
        let full = EvalReport::new(vec![view("a", 20.0, Some(0.25)), view("b", 30.0, Some(0.5))])?;
        assert_eq!(full.mean.lpips, Some(0.375));
        assert!(matches!(EvalReport::new(Vec::new()), Err(EvalError::NoViews)));
        Ok(())
    }
}
