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
