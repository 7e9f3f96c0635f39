//! All kernels at once, for tools that look at what a driver makes of them.

use std::sync::Arc;

use super::variant::BLOCK_SIDE;
use super::*;
use crate::gpu::interface::constants::{SHOW_COLOR, SHOW_NOTHING};
use crate::gpu::{Gpu, GpuError, PipelineCache};
use crate::scene::DevicePrecision;

/// Compiles every kernel for a variant, as renderers and trainers do. Those that depend on the scene are compiled for the
/// plainest one, for SH of degree 3 and for a scene that has everything; [`Gpu::compiled_pipelines`] lists them.
///
/// # Errors
/// As [`Pipeline::new`](crate::gpu::Pipeline::new).
pub fn compile_every_pipeline(gpu: &Arc<Gpu>, cache: &PipelineCache, variant: Variant) -> Result<(), GpuError> {
    const SH_DEGREE: u32 = 3;
    let (plain, full) = (SceneTraits::plain(SH_DEGREE), everything(SH_DEGREE));
    Primitives::new(gpu, cache, &variant)?;
    // Levels are drawn and never trained; only training lets instances get Gaussians of their own.
    for traits in [SceneTraits::plain(0), plain, SceneTraits { own_may_grow: false, ..full }] {
        Pipelines::new(gpu, cache, variant, traits, Purpose::Whole)?;
    }
    Pipelines::new(gpu, cache, variant, SceneTraits { own_may_grow: false, ..full }, Purpose::Layered)?;
    for precision in [DevicePrecision::F16, DevicePrecision::Q8] {
        let traits = SceneTraits { own_may_grow: false, precision, ..full };
        for purpose in [Purpose::Whole, Purpose::Layered] {
            Pipelines::new(gpu, cache, variant, traits, purpose)?;
        }
    }
    for (traits, poses) in [(SceneTraits::plain(0), false), (plain, false), (full, true)] {
        let traits = SceneTraits { levels: false, ..traits };
        // As `Variant::for_training`.
        let variant = Variant { tile_size: BLOCK_SIDE, ..variant };
        Pipelines::new(gpu, cache, variant, traits, Purpose::Training)?;
        BackwardPipelines::new(gpu, cache, variant, traits, poses)?;
    }
    DensifyPipelines::new(gpu, cache, &variant, SH_DEGREE)?;
    McmcStepPipelines::new(gpu, cache, &variant)?;
    ExposurePipelines::new(gpu, cache, &variant)?;
    SegmentPipelines::new(gpu, cache, variant)?;
    SurfacePipelines::new(gpu, cache, variant)?;
    MarkPipelines::new(gpu, cache, variant)?;
    let mut present = PresentPipelines::default();
    for show in SHOW_COLOR..=SHOW_NOTHING {
        present.get(
            gpu,
            cache,
            &variant,
            PresentVariant { show, outline: true, scaled: true, precision: DevicePrecision::Q8 },
        )?;
    }
    Ok(())
}

/// Traits of a scene that uses all there is.
fn everything(sh_degree: u32) -> SceneTraits {
    SceneTraits {
        sh_degree,
        offset_sh_rest: 15,
        offset_log_scales: true,
        offset_quats: true,
        color_matrices: true,
        own_may_grow: true,
        levels: true,
        windowed: true,
        precision: DevicePrecision::F32,
    }
}
