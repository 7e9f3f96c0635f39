//! Uses of device memory in training, each with the unit that it grows with.

use super::device_state::DeviceState;
use super::facts::MemoryUse;
use super::step_runner::StepRunner;
use super::views::TrainViews;
use instgs_vk::gpu::interface::types;

/// The uses that make up nearly all of the device's memory; each is `count` times `bytes_each`.
pub fn memory_uses(state: &DeviceState, runner: &StepRunner, views: &TrainViews) -> Vec<MemoryUse> {
    let gaussians = state.source_count() as u64;
    let mut out = Vec::new();
    let mut push = |name: &str, per: &str, bytes: u64, count: u64| {
        let bytes_each = if count > 0 { bytes as f64 / count as f64 } else { 0.0 };
        out.push(MemoryUse { name: name.into(), bytes, per: per.into(), count, bytes_each });
    };
    push("parameters", "Gaussian", state.scene.bytes(), gaussians);
    push("gradients and statistics", "Gaussian", state.gradients.bytes(), gaussians);
    push("Adam's moments", "Gaussian", state.moments.bytes(), gaussians);
    if let Some((frame, backward)) = runner.frame().buffers() {
        let slots = u64::from(frame.plan.slots);
        // Splat, footprint, tile count, first emission, two buffers of depth keys and slots, scanned offset.
        let per_slot = (size_of::<types::Splat>() + size_of::<types::Footprint>() + 4 + 4 + 16 + 4) as u64;
        push(
            "projected Gaussians and their gradients",
            "Gaussian",
            slots * per_slot + backward.source_gradients.bytes(),
            slots,
        );
        let intersections = u64::from(frame.plan.capacities.intersections);
        // Two buffers of tile keys and emission indices, slot by emission.
        push(
            "(splat, tile) pairs and their moments",
            "intersection",
            20 * intersections + backward.isect_moments.bytes(),
            intersections,
        );
        let pixels = frame.colors.len() as u64;
        let loss = backward.cotangents.bytes()
            + backward.row_moments.bytes()
            + backward.ssim_gradients.bytes()
            + backward.row_gradients.bytes();
        push("picture, loss and its windows", "pixel", frame.colors.bytes() + frame.depths.bytes() + loss, pixels);
    }
    if let Some(exposures) = &state.exposures {
        push("exposures", "picture", exposures.bytes(), exposures.views() as u64);
    }
    push("training pictures", "picture", views.bytes(), views.resident() as u64);
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
