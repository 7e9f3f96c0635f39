//! The figures of one evaluation, as they are written to JSON.

use serde::Serialize;

use crate::error::EvalError;
use crate::lpips::{Lpips, LpipsError};
use crate::pair::PicturePair;
use crate::psnr::psnr;
use crate::ssim::ssim;

/// How close one picture is to another, or the mean over several.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Metrics {
    /// dB, more is better; at most [`crate::MAX_PSNR_DB`]. A mean is of the views' dB.
    pub psnr: f64,
    /// At most 1, more is better.
    pub ssim: f64,
    /// At least 0, less is better; `None` (null in JSON) if not computed.
    pub lpips: Option<f64>,
}

/// The figures of one view.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ViewMetrics {
    /// The view's name.
    pub name: String,
    /// See [`Metrics::psnr`].
    pub psnr: f64,
    /// See [`Metrics::ssim`].
    pub ssim: f64,
    /// See [`Metrics::lpips`].
    pub lpips: Option<f64>,
}

/// All views and their mean. JSON: `{"views":[{"name","psnr","ssim","lpips"}],"mean":{"psnr","ssim","lpips"}}`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct EvalReport {
    /// In the dataset's order, at least one.
    pub views: Vec<ViewMetrics>,
    /// The mean of each figure over the views; LPIPS only if every view has it.
    pub mean: Metrics,
}

impl Metrics {
    /// All metrics of a pair; LPIPS if its network is given and the picture is large enough for it.
    ///
    /// # Errors
    /// A network that gives no number.
    pub fn of(pair: &PicturePair, lpips: Option<&Lpips>) -> Result<Self, LpipsError> {
        let lpips = match lpips.map(|lpips| lpips.distance(pair)).transpose() {
            Err(LpipsError::TooSmall { .. }) => None,
            other => other?,
        };
        Ok(Self { psnr: psnr(pair), ssim: ssim(pair), lpips })
    }

    /// The same figures with a name.
    pub fn named(self, name: impl Into<String>) -> ViewMetrics {
        ViewMetrics { name: name.into(), psnr: self.psnr, ssim: self.ssim, lpips: self.lpips }
    }
}

impl EvalReport {
    /// The report of these views, with their mean.
    ///
    /// # Errors
    /// No views.
    pub fn new(views: Vec<ViewMetrics>) -> Result<Self, EvalError> {
        if views.is_empty() {
            return Err(EvalError::NoViews);
        }
        let count = views.len() as f64;
        let mean = |of: fn(&ViewMetrics) -> f64| views.iter().map(of).sum::<f64>() / count;
        let lpips: Option<f64> = views.iter().map(|view| view.lpips).sum();
        let mean = Metrics { psnr: mean(|v| v.psnr), ssim: mean(|v| v.ssim), lpips: lpips.map(|sum| sum / count) };
        Ok(Self { views, mean })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_and_json() -> Result<(), Box<dyn std::error::Error>> {
        let view = |name: &str, psnr, lpips| Metrics { psnr, ssim: 0.5, lpips }.named(name);
        let report = EvalReport::new(vec![view("a", 20.0, Some(0.25)), view("b", 30.0, None)])?;
        let want = r#"{"views":[{"name":"a","psnr":20.0,"ssim":0.5,"lpips":0.25},{"name":"b","psnr":30.0,"ssim":0.5,"lpips":null}],"mean":{"psnr":25.0,"ssim":0.5,"lpips":null}}"#;
        assert_eq!(serde_json::to_string(&report)?, want);
        let full = EvalReport::new(vec![view("a", 20.0, Some(0.25)), view("b", 30.0, Some(0.5))])?;
        assert_eq!(full.mean.lpips, Some(0.375));
        assert!(matches!(EvalReport::new(Vec::new()), Err(EvalError::NoViews)));
        Ok(())
    }
}
