//! Uses of device memory in training, each with the unit that it grows with: of a run, and as far as they are known before.

use super::config::{Method, TrainConfig};
use super::device_state::DeviceState;
use super::facts::MemoryUse;
use super::step_runner::StepRunner;
use super::views::TrainViews;
use instgs_vk::gpu::interface::types;
use instgs_vk::render::plan;
use instgs_vk::scene::gaussians::sh_coefficients;

/// Fraction of the device's memory for training pictures if the user sets no limit.
const PICTURE_SHARE: f64 = 0.25;
/// Names of the uses that [`planned_uses`] knows, too.
const PARAMETERS: &str = "parameters";
const GRADIENTS: &str = "gradients and statistics";
const MOMENTS: &str = "Adam's moments";
const SLOTS: &str = "projected Gaussians and their gradients";
const PIXELS: &str = "picture, loss and its windows";
const PICTURES: &str = "training pictures";
const EXPOSURES: &str = "exposures";
/// f32 values of a Gaussian besides its SH coefficients: centre, quaternion, log scales, opacity logit.
const VALUES_WITHOUT_SH: u64 = 3 + 4 + 3 + 1;
/// Bytes of the statistics of densification for each Gaussian.
const STATISTICS_BYTES: u64 = 12;
/// Bytes of a slot: those of [`per_slot_bytes`], and the gradient of its source.
const SLOT_BYTES: u64 = 176;
/// Bytes of a slot more where instances have colour matrices: what their gradients are made of.
const COLOR_TERMS_BYTES: u64 = size_of::<types::ColorTerms>() as u64;
/// Bytes of a pixel of the picture that is compared: colours, depths, cotangents and the windows of SSIM.
const PIXEL_BYTES: u64 = 160;
/// Bytes of a pixel of the picture with a photo's exposure, and of a photo's exposure with its moments.
const EXPOSED_PIXEL_BYTES: u64 = 16;
const EXPOSURE_BYTES: u64 = 144;

/// Device memory that training pictures may take, bytes, on a device with `heap_bytes`.
pub fn picture_budget(config: &TrainConfig, heap_bytes: u64) -> u64 {
    match config.device_memory_mb {
        0 => (heap_bytes as f64 * PICTURE_SHARE) as u64,
        // Pictures get half of the budget.
        mb => u64::from(mb) << 19,
    }
}

/// The uses of device memory that are known before a run: those of as many Gaussians as it may draw and of the training pictures,
/// whose sizes are `pictures_px`. In the joint phase this is an upper bound, as the offsets of an instance's Gaussian take less than a
/// Gaussian; only scenes that are merged above their bound need more, until they have come down to it. The (splat, tile) pairs, which
/// depend on the views, and small buffers come on top. In a run, `heap_bytes` is the memory of the device.
pub fn planned_uses(config: &TrainConfig, pictures_px: &[[u32; 2]], heap_bytes: u64) -> Vec<MemoryUse> {
    let instanced = config.method == Method::Instanced;
    let expanded = if instanced { config.joint.max_expanded.max(1.0) } else { 1.0 };
    let gaussians = (f64::from(config.max_gaussians) * expanded) as u64;
    let values = VALUES_WITHOUT_SH + 3 * sh_coefficients(config.sh_degree) as u64;
    let color_terms = if instanced && config.joint.color_matrix_rate > 0.0 { COLOR_TERMS_BYTES } else { 0 };
    // Buffers are as wide as the widest picture and as high as the highest.
    let [widest, highest] = [0, 1].map(|axis| pictures_px.iter().map(|size| u64::from(size[axis])).max().unwrap_or(0));
    let bytes_of_all =
        4 * pictures_px.iter().map(|[width, height]| u64::from(*width) * u64::from(*height)).sum::<u64>();
    let uses = [
        (PARAMETERS, "Gaussian", gaussians, 4 * values),
        (GRADIENTS, "Gaussian", gaussians, 4 * values + STATISTICS_BYTES),
        (MOMENTS, "Gaussian", gaussians, 8 * values),
        (SLOTS, "Gaussian", gaussians, SLOT_BYTES + color_terms),
        (PIXELS, "pixel", widest * highest, PIXEL_BYTES),
    ];
    let of = |(name, per, count, each): (&str, &str, u64, u64)| MemoryUse {
        name: name.into(),
        bytes: count * each,
        per: per.into(),
        count,
        bytes_each: each as f64,
    };
    let pictures = pictures_px.len() as u64;
    let bytes = bytes_of_all.min(picture_budget(config, heap_bytes));
    let each = bytes_of_all as f64 / pictures.max(1) as f64;
    let pictures = MemoryUse { name: PICTURES.into(), bytes, per: "picture".into(), count: pictures, bytes_each: each };
    let exposures = (config.exposure.rate > 0.0).then(|| {
        let bytes = EXPOSED_PIXEL_BYTES * widest * highest + EXPOSURE_BYTES * pictures.count;
        let each = bytes as f64 / pictures.count.max(1) as f64;
        MemoryUse { name: EXPOSURES.into(), bytes, per: "picture".into(), count: pictures.count, bytes_each: each }
    });
    uses.into_iter().map(of).chain(exposures).chain([pictures]).collect()
}

/// Bytes of a slot of a frame in training, which has the range of its emissions too.
const fn per_slot_bytes() -> u64 {
    plan::SLOT_BYTES + size_of::<types::EmissionRange>() as u64
}

/// The uses that make up nearly all of the device's memory; each is `count` times `bytes_each`.
pub fn memory_uses(state: &DeviceState, runner: &StepRunner, views: &TrainViews) -> Vec<MemoryUse> {
    let gaussians = state.source_count() as u64;
    let mut out = Vec::new();
    let mut push = |name: &str, per: &str, bytes: u64, count: u64| {
        let bytes_each = if count > 0 { bytes as f64 / count as f64 } else { 0.0 };
        out.push(MemoryUse { name: name.into(), bytes, per: per.into(), count, bytes_each });
    };
    push(PARAMETERS, "Gaussian", state.scene.bytes(), gaussians);
    push(GRADIENTS, "Gaussian", state.gradients.bytes(), gaussians);
    push(MOMENTS, "Gaussian", state.moments.bytes(), gaussians);
    if let Some((frame, backward)) = runner.frame().buffers() {
        let slots = u64::from(frame.plan.slots);
        push(
            SLOTS,
            "Gaussian",
            slots * per_slot_bytes()
                + backward.shape_gradients.bytes()
                + backward.look_gradients.bytes()
                + backward.color_terms.bytes()
                + backward.pose_sums.bytes(),
            slots,
        );
        let intersections = u64::from(frame.plan.capacities.intersections);
        // With the slot by emission.
        push(
            "(splat, tile) pairs and their moments",
            "intersection",
            (plan::PAIR_BYTES + 4) * intersections + backward.isect_moments.bytes(),
            intersections,
        );
        let pixels = frame.colors.len() as u64;
        let loss = backward.cotangents.bytes()
            + backward.row_moments.bytes()
            + backward.ssim_gradients.bytes()
            + backward.row_gradients.bytes();
        push(PIXELS, "pixel", frame.colors.bytes() + frame.depths.bytes() + loss, pixels);
    }
    if let Some(exposures) = &state.exposures {
        push(EXPOSURES, "picture", exposures.bytes(), exposures.views() as u64);
    }
    push(PICTURES, "picture", views.bytes(), views.resident() as u64);
    out
}

/// What a step had and needed when memory ran out.
#[derive(Clone, Copy, Debug)]
pub(super) struct Needs {
    /// Bytes that were missing.
    pub(super) missing: u64,
    /// Number of Gaussians in training.
    pub(super) gaussians: u64,
    /// Bytes of their parameters, gradients and moments.
    pub(super) gaussian_bytes: u64,
    /// Bytes of the training pictures on the device.
    pub(super) picture_bytes: u64,
    /// The budget, MiB; 0 = none but the device's memory.
    pub(super) budget_mb: u32,
}

/// Part of the Gaussians, or of the pictures' bytes, that a run may be advised to go without.
const MOST_TO_LEAVE: f64 = 0.75;

impl Needs {
    /// Words on what would fit.
    pub(super) fn what_fits(self) -> String {
        let (missing, all) = (self.missing as f64, self.gaussians as f64);
        let fewer = missing / (self.gaussian_bytes as f64 / all.max(1.0)).max(1.0);
        let mut ways = Vec::new();
        if fewer <= MOST_TO_LEAVE * all {
            let fitting = self.gaussians - fewer.ceil() as u64;
            ways.push(format!(
                "about {fitting} of the {} Gaussians would fit (--max-gaussians, in a new run)",
                self.gaussians
            ));
        }
        if missing <= MOST_TO_LEAVE * self.picture_bytes as f64 {
            let percent = (100.0 * (1.0 - missing / self.picture_bytes as f64).sqrt()).floor();
            ways.push(format!("pictures of {percent:.0} % of their width would fit (--width)"));
        }
        if self.budget_mb > 0 {
            let least = u64::from(self.budget_mb) + self.missing.div_ceil(1 << 20);
            ways.push(format!("at least {least} MiB are needed as it is (--set device_memory_mb={least})"));
        }
        if ways.is_empty() {
            ways.push(
                "neither fewer Gaussians nor smaller pictures alone would fit: use a device with more memory".into(),
            );
        }
        ways.join(", or ")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{ConfigBuilder, ConfigError};

    #[test]
    fn plans_are_for_all_that_may_be_drawn_and_for_pictures_of_every_shape() -> Result<(), ConfigError> {
        let planned = |sets: &[&str]| {
            let start = ConfigBuilder::new().set("max_gaussians=1000")?;
            let config = sets.iter().try_fold(start, |builder, set| builder.set(set))?.finish()?;
            let uses = planned_uses(&config, &[[40, 30], [30, 40]], 1 << 30);
            let of = |name| uses.iter().find(|u| u.name == name).map(|u| (u.count, u.bytes_each));
            Ok::<_, ConfigError>([PARAMETERS, SLOTS, PIXELS, EXPOSURES].map(|name| of(name).unwrap_or_default()))
        };
        assert_eq!(planned(&[])?, [(1000, 236.0), (1000, 176.0), (1600, 160.0), (0, 0.0)]);
        let more = ["method=instgs", "joint.max_expanded=1.5", "joint.color_matrix_rate=1e-3", "exposure.rate=1e-3"];
        assert_eq!(planned(&more)?, [(1500, 236.0), (1500, 200.0), (1600, 160.0), (2, 12_944.0)]);
        Ok(())
    }

    #[test]
    fn what_fits_depends_on_what_takes_the_memory() {
        let mib = |n: u64| n << 20;
        let needs =
            Needs { missing: mib(3), gaussians: 10_000, gaussian_bytes: mib(10), picture_bytes: mib(2), budget_mb: 0 };
        let text = |needs: Needs| needs.what_fits();
        assert_eq!(text(needs), "about 7000 of the 10000 Gaussians would fit (--max-gaussians, in a new run)");
        let pictures = text(Needs { gaussian_bytes: mib(1), picture_bytes: mib(4), ..needs });
        assert_eq!(pictures, "pictures of 50 % of their width would fit (--width)");
        let budget = text(Needs { missing: mib(9) + 1, budget_mb: 64, ..needs });
        assert_eq!(budget, "at least 74 MiB are needed as it is (--set device_memory_mb=74)");
        assert!(text(Needs { missing: mib(9), gaussians: 0, gaussian_bytes: 0, ..needs }).contains("more memory"));
    }
}
