//! Computes buffer lengths from counts and capacities, without Vulkan.

use crate::gpu::interface::constants::{BLOCK_SIZE, RADIX_BITS, RADIX_SIZE};
use crate::gpu::interface::types;

/// Device memory of a splat slot besides what training adds, bytes: splat, footprint, tile count, two buffers of depth keys and
/// slots, scanned offset.
pub const SLOT_BYTES: u64 = (size_of::<types::Splat>() + size_of::<types::Footprint>() + 4 + 16 + 4) as u64;
/// Device memory of a (splat, tile) pair besides what training adds, bytes: two buffers of tile keys and slots.
pub const PAIR_BYTES: u64 = 16;

/// Capacities of the growing buffers, in elements.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Capacities {
    /// (instance, chunk) pairs of visible instances.
    pub candidates: u32,
    /// Visible (instance, chunk) pairs; each reserves one work-group of splat slots.
    pub work_items: u32,
    /// (splat, tile) pairs of one slab.
    pub intersections: u32,
}

/// Initial capacities; frames grow them. 2^16 candidates take 1 MiB, 512 work items of 256 slots 12 MiB, 2^19
/// intersections 8 MiB.
pub const INITIAL: Capacities = Capacities { candidates: 1 << 16, work_items: 512, intersections: 1 << 19 };

/// Lengths of a frame's buffers for one image size and scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FramePlan {
    /// Image width and height, pixels.
    pub size_px: [u32; 2],
    /// Numbers of tile columns and rows.
    pub tiles: [u32; 2],
    /// Rows of the instance table: instances, their own ranges, levels of detail, and the background.
    pub instances: u32,
    /// Capacities of the growing buffers.
    pub capacities: Capacities,
    /// Splat slots: work items times work-group size.
    pub slots: u32,
    /// True if the buffers that the backward pass reads are included.
    pub training: bool,
    /// True if the buffers of depth layers are included.
    pub layered: bool,
    /// True if the buffers of pose gradients are included.
    pub poses: bool,
    /// With those for gradients by colour matrices of instances.
    pub color_matrices: bool,
}

impl FramePlan {
    /// Plans an image of `size_px` with square tiles.
    pub fn new(size_px: [u32; 2], tile_size: u32, instances: u32, capacities: Capacities, workgroup_size: u32) -> Self {
        let tiles = size_px.map(|s| s.div_ceil(tile_size));
        // A slab must hold at least one splat, which touches at most all tiles.
        let intersections = capacities.intersections.max(tiles[0] * tiles[1]);
        let capacities = Capacities { intersections, ..capacities };
        let slots = capacities.work_items * workgroup_size;
        let (training, layered, poses, color_matrices) = (false, false, false, false);
        Self { size_px, tiles, instances, capacities, slots, training, layered, poses, color_matrices }
    }

    /// Number of pixels of the image.
    pub fn pixels(&self) -> u32 {
        self.size_px[0] * self.size_px[1]
    }

    /// Number of tiles of the image.
    pub fn tile_count(&self) -> u32 {
        self.tiles[0] * self.tiles[1]
    }

    /// Radix passes for tile keys 0..=tile_count (the last is the sentinel for "outside the image").
    pub fn tile_sort_passes(&self) -> u32 {
        radix_passes(self.tile_count())
    }

    /// Length of the radix histogram; sufficient for both sorts.
    pub fn histogram_len(&self) -> u32 {
        self.slots.max(self.capacities.intersections).div_ceil(BLOCK_SIZE) * RADIX_SIZE
    }

    /// Length of the block sums; sufficient for every scan.
    pub fn block_sums_len(&self) -> u32 {
        let longest = [self.instances, self.capacities.candidates, self.slots];
        longest.into_iter().max().unwrap_or(0).div_ceil(BLOCK_SIZE).max(1)
    }
}

/// Number of radix passes for keys up to `max_key`.
pub fn radix_passes(max_key: u32) -> u32 {
    (u32::BITS - max_key.leading_zeros()).div_ceil(RADIX_BITS).max(1)
}

/// A grown capacity: a quarter more than needed, so that a moving camera does not grow it every frame.
pub fn grown(needed: u32, limit: u32) -> u32 {
    needed.saturating_add(needed / 4).min(limit)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn radix_passes_cover_the_largest_key() {
        for (max_key, passes) in [(0, 1), (255, 1), (256, 2), (65535, 2), (65536, 3), (u32::MAX, 4)] {
            assert_eq!(radix_passes(max_key), passes, "max key {max_key}");
        }
    }

    #[test]
    fn a_slab_always_holds_one_splat() {
        let tiny = Capacities { candidates: 1, work_items: 1, intersections: 1 };
        let plan = FramePlan::new([801, 449], 8, 1, tiny, 256);
        assert_eq!(plan.tiles, [101, 57]);
        assert_eq!(plan.capacities.intersections, 101 * 57);
    }

    #[test]
    fn growth_leaves_room_and_respects_the_limit() {
        assert_eq!(grown(1000, 5000), 1250);
        assert_eq!(grown(u32::MAX, 7), 7);
    }
}
