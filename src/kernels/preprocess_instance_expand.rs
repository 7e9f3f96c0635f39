//! Expands one chunk of one instance into screen-space splats (DESIGN section 2, Eq. 6; section 3, pass 2).
//!
//! First half, every Gaussian: `mean_world = A (mean_t + d_mean) + t`, opacity = sigmoid of the logit plus its offset,
//! EWA projection (Zwicker et al. 2001) `cov_px = J W A cov_t A^T W^T J^T + dilation` with the slopes of J clamped, the
//! extent of alpha >= 1/255, and the number of tiles it touches. Second half, survivors only: SH in direction
//! `R^T (mean_world - camera)`, normalised.
//!
//! In scenes with levels of detail (LEVELS), a level that is not alone has opacity `1 - (1 - opacity)^weight`: the weights
//! of the two that are shown add up to 1, so together they take the light that one would (`lod.glsl`).
//!
//! Offsets of SH bands above 0 and of shape exist for ablations; scenes without have kernels without their code.
//!
//! - Reads `work_items` (by work item), `instances` (by instance), source arrays `means` .. `sh0` (by
//!   `first_source` + local index), SH bands `sh1` .. `sh3` (by `first_in_band` + local index; 3, 5, 7 coefficients), offsets (by `first_offset` + local index),
//!   `counters`.
//! - Writes `splats`, `footprints`, `tile_counts` (by slot = `work item * WORKGROUP_SIZE + rank`), `survivor_counts`
//!   (by work item). Slots from the last survivor to the end of a work item are not written.
//! - Grid: one work-group per work item, indirect (`FAMILY_WORK_ITEMS`, `ARGS_ITEMS`); one thread per Gaussian.
//! - Bytes per Gaussian: 44 read, 16 more with offsets. Per survivor: 12 + 12 (degree + 1)^2 read, 24 more with
//!   offsets; 72 written (splat 40, footprint 28, tile count 4). Per work item: 132 read, 4 written.
//! - Guarantees: ranks come from ballots and a count per subgroup, so slots follow flat order and no atomic is used.
//!   Guards (depth > near, opacity >= 1/255, finite sizes) are phrased so that NaN fails them. A splat whose colour is
//!   not finite keeps its tiles with opacity 0: it blends nothing. Every survivor touches at least one tile and has
//!   opacity >= 1/255, that poisoned case apart.
//! - Constants: Jacobian slopes are clamped 15 % of the image beyond its borders; 2.5e-5 = 0.005^2 is the floor of the
//!   antialias compensation; the extent is enlarged (`1.001 ln(255 opacity) + 0.01`) for drivers' `log`; determinants
//!   below 1e30, variances, centres and depths below 1e15 keep later products finite.
//!
//! Twin: `reference::preprocess_instance_expand`, `reference::lod`. Tests:
//! `tests/kernels/preprocess_instance_expand.rs` (splat by splat), `lod.rs`, `forward.rs`, `intersections.rs`, `poison.rs`.

pub use crate::gpu::interface::preprocess_instance_expand::{Bindings, Params, PreprocessInstanceExpand};
