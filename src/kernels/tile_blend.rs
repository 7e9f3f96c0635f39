//! Blends each tile's splats front to back: colour, alpha, expected depth. See `glsl/tile_blend.comp`.
//!
//! One subgroup owns an 8x8 block of pixels, `64 / SUBGROUP_SIZE` pixels a lane. Its lanes load one splat each, and the
//! subgroup walks them by shuffle: no work-group barrier, no shared memory. The walk is unrolled, so the shuffles have
//! constant lanes. Pixel rules (DESIGN section 3): alpha < 1/255 or sigma < 0 skipped, alpha clamped at 0.99, the splat that
//! would bring T below 1e-4 ends the pixel and is not blended.
//!
//! - Reads: 40 bytes a splat and 4 a list entry, once per 8x8 block; the tile's range; counters.
//! - Writes: 24 bytes a pixel. Between depth slabs they hold the exact fp32 state, so slabs do not change a bit.
//! - Grid: one subgroup per 8x8 block of every tile.
//! - Twin: `reference::tile_blend`; tests: `tests/kernels/forward.rs`, `overflow.rs`, `poison.rs`.
//!
//! # What was tried
//! garden.ply (111,785 Gaussians), 800x450, cameras 0 / 1 / 2, lavapipe (Mesa 22.3.6) on 2 cores with AVX-512,
//! 2026-11-21, medians of 6 frames, two runs; milliseconds of the blend, and of the frame. Sort and emission have become
//! faster since: the default now takes 98-109 ms a frame, 16x16 tiles 79-94.
//!
//! | blend | blend, ms | frame, ms |
//! |---|---|---|
//! | **subgroup blend, 8x8 tiles, 256-bit vectors** (the default on lavapipe) | 40-46 / 37-40 / 32-35 | 113-127 / 106-115 / 106-115 |
//! | subgroup blend, 16x16 tiles | 56-59 / 60-61 / 45-48 | 97-109 / 106-122 / 88-90 |
//! | subgroup blend, 32x32 tiles | 112 / 100-151 / 78-82 | 146-162 / 131-196 / 111-119 |
//! | subgroup blend, 8x8 tiles, 512-bit vectors (subgroups of 16) | 57 / 47-56 / 41-48 | 297-333 / 271-295 / 315-318 |
//! | subgroup blend, 8x8 tiles, 128-bit vectors (subgroups of 4) | 67-68 / 62-66 / 53 | 148-155 / 142-156 / 135-136 |
//! | shared memory, 16x16 tiles, one pixel a thread, batches of 256, barriers | 842 / 813 / 656 | 916 / 875 / 714 |
//! | 16x16 tiles with an 8x8 cull, a loop over the ballot of hits (other work ran beside) | 119 | 201 |
//! | 8x8 tiles, the same loop instead of the unrolled walk (likewise) | 115 | 262 |
//! | 8x8 tiles, separate live flag and T, a branch for sigma < 0 (likewise; 45 as it is now) | 80 | 217 |
//!
//! Why: Mesa's gallivm has no branches, only masks. A loop applies its mask to every register it writes, so a walk of one
//! splat an iteration pays for 64 pixels' state each time; unrolled over a subgroup it pays once per subgroup of splats.
//! Loads from buffers and shared memory are loops over lanes: one load per lane and a shuffle beats 256 loads of the same
//! address. 512-bit vectors lose in all the passes that load and store (sort, expand), not in the blend.
//!
//! 16x16 tiles win on large splats (15 tiles a splat here), 8x8 on small ones: a million Gaussians at 1920x1080 (3.5 tiles
//! a splat) take 652-678 ms with 8x8 tiles and 770-791 ms with 16x16 (medians of 3 frames, three runs). The picture is the same bit for bit.
//! No GPU was at hand: nothing here says what is best on one.

pub use crate::gpu::interface::tile_blend::{Bindings, Params, TileBlend};
