//! The sizes that kernels are compiled for on a device.

use crate::gpu::DeviceCaps;

/// Work-group shapes and tile size; a plain value that benchmarks and tests may change.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Variant {
    /// Lanes per subgroup: 4, 8, 16, 32 or 64.
    pub subgroup_size: u32,
    /// Threads of the element-wise kernels; also the number of Gaussians per chunk.
    pub workgroup_size: u32,
    /// Threads of the radix sort kernels.
    pub radix_workgroup_size: u32,
    /// The sort ranks equal digits by ballots instead of shuffles.
    pub match_by_ballot: bool,
    /// Threads of the blend; a whole number of subgroups, each of which owns an 8x8 block of pixels.
    pub blend_workgroup_size: u32,
    /// Tile side in pixels: 8 or a larger multiple of 8.
    pub tile_size: u32,
    /// The backward blend sums a subgroup of splats over lanes at once, instead of each splat alone.
    pub transpose_moments: bool,
}

impl Variant {
    /// The variant for a device: subgroups of 32 if available, of 16 on Intel's, else the largest size.
    pub fn for_device(caps: &DeviceCaps) -> Self {
        let preferred = preferred_subgroup_size(&caps.subgroup_sizes(), caps.is_intel);
        Self::for_subgroup_size(caps, preferred.unwrap_or(caps.max_subgroup_size))
    }

    /// The variant for one of `caps.subgroup_sizes()`.
    pub fn for_subgroup_size(caps: &DeviceCaps, subgroup_size: u32) -> Self {
        let most = caps.max_workgroup_invocations.min(caps.max_workgroup_subgroups.saturating_mul(subgroup_size));
        // Powers of two, so that work-groups divide the blocks of scan and sort.
        let largest = |want: u32| 1 << want.min(most).max(subgroup_size).ilog2();
        // A CPU driver runs one subgroup at a time: more than one per work-group only adds barriers.
        let radix_subgroups = if caps.is_llvmpipe { 1 } else { 8 };
        // The same, and chunks that fit templates: of a group of 256, most lanes idle where an instance has 100 Gaussians. A
        // training step of shelf_1 takes 58 ms with 256, 60 with 64, 49 with 32 and 56 with 16 (plain 3DGS: 71, 67, 63, 68).
        let threads = if caps.is_llvmpipe { 32 } else { 256 };
        Self {
            subgroup_size,
            workgroup_size: largest(threads),
            radix_workgroup_size: largest(radix_subgroups * subgroup_size),
            match_by_ballot: subgroup_size > 16,
            blend_workgroup_size: if caps.is_llvmpipe { subgroup_size } else { largest(128) },
            tile_size: 8,
            // The sums of a whole subgroup of splats do not fit the registers of GPUs, and at 32 lanes of nothing.
            transpose_moments: caps.is_llvmpipe && subgroup_size <= 16,
        }
    }
}

/// The size to use among ascending `sizes`; `None` if there are none. On Intel's, a value of 32 lanes takes two or four of a
/// thread's 128 registers, and the driver spills thousands of values of the larger kernels.
fn preferred_subgroup_size(sizes: &[u32], is_intel: bool) -> Option<u32> {
    let wanted = if is_intel { 16 } else { 32 };
    if sizes.contains(&wanted) { Some(wanted) } else { sizes.last().copied() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intel_gets_16_lanes_and_others_32_where_they_have_them() {
        assert_eq!(preferred_subgroup_size(&[8, 16, 32], true), Some(16));
        assert_eq!(preferred_subgroup_size(&[16, 32], true), Some(16));
        assert_eq!(preferred_subgroup_size(&[8, 16, 32], false), Some(32));
        assert_eq!(preferred_subgroup_size(&[32, 64], false), Some(32));
        assert_eq!(preferred_subgroup_size(&[64], false), Some(64));
        assert_eq!(preferred_subgroup_size(&[4, 8], true), Some(8));
        assert_eq!(preferred_subgroup_size(&[], true), None);
    }
}
