//! The sizes that kernels are compiled for on a device.

use std::sync::Arc;

use crate::gpu::interface::constants::{BLOCK_SIZE, RADIX_SIZE};
use crate::gpu::{DeviceCaps, Gpu, GpuError, GpuOptions, Tuning};

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
    /// The sort orders blocks of keys in shared memory before it writes them.
    pub stage_keys: bool,
    /// Threads of the blend; a whole number of subgroups, each of which owns an 8x8 block of pixels.
    pub blend_workgroup_size: u32,
    /// Tile side in pixels: 8 or a larger multiple of 8.
    pub tile_size: u32,
    /// The backward blend sums a subgroup of splats over lanes at once, instead of each splat alone.
    pub transpose_moments: bool,
    /// The blends hand the splats of a subgroup to its lanes through shared memory instead of shuffles.
    pub stage_splats: bool,
    /// Splats whose code the forward blend repeats; a power of two up to `subgroup_size`, which is all of them.
    pub splats_unrolled: u32,
    /// The same of the backward blend where it sums each splat alone.
    pub backward_splats_unrolled: u32,
    /// Lanes per subgroup of `preprocess_instance_expand_backward`, which needs the most registers a lane.
    pub expand_backward_subgroup_size: u32,
}

/// Pixels along a side of the blocks that subgroups own (`BLOCK_SIDE` in `glsl/include/blend.glsl`).
pub(crate) const BLOCK_SIDE: u32 = 8;

/// Largest tile that can be asked for: beyond, a block would walk the splats of 64 others to find its own.
const MOST_TILE_SIZE: u32 = 64;

/// Keys that a lane of the sort may keep: with more, the registers of a group of 256 would not leave room for other groups.
const MOST_STAGED_KEYS: u32 = 8;

/// Subgroups that `glsl/include/workgroup_scan.glsl` has room for.
const MOST_SUBGROUPS: u32 = 64;

/// What `glsl/include/staging.glsl` keeps of a splat.
const STAGED_SPLAT_BYTES: u32 = 40;

/// Shared memory of `gather_color_gradients` and `refine_exposure`, bytes a thread: the most among kernels with
/// [`Variant::workgroup_size`] threads.
const GROUP_BYTES: u32 = 48;

/// `recentre_exposures` has a thread for each of the 12 numbers of an exposure.
const LEAST_GROUP: u32 = 16;

/// Largest work-group with a required subgroup size.
fn most_threads(caps: &DeviceCaps, subgroup_size: u32) -> u32 {
    caps.max_workgroup_invocations.min(caps.max_workgroup_subgroups.saturating_mul(subgroup_size))
}

/// Shared memory of `radix_sort_scatter`: a table of digits per subgroup or, with `stage_keys`, at least the keys of a block;
/// the digits' places; the sums of a work-group scan.
fn sort_shared_bytes(radix_workgroup_size: u32, subgroup_size: u32, stage_keys: bool) -> u32 {
    let tables = radix_workgroup_size / subgroup_size * RADIX_SIZE;
    4 * (tables.max(if stage_keys { BLOCK_SIZE } else { 0 }) + RADIX_SIZE + MOST_SUBGROUPS)
}

/// Opens a device with the tuning of the environment.
///
/// # Errors
/// As [`Gpu::open`]; [`GpuError::Tuning`] if `INSTGS_TUNING` cannot be read, or as [`Variant::tuned`].
pub fn open_tuned(options: GpuOptions) -> Result<Arc<Gpu>, GpuError> {
    let gpu = Gpu::open(&GpuOptions { tuning: Tuning::of_environment()?, ..options })?;
    Variant::tuned(gpu.caps())?;
    Ok(gpu)
}

impl Variant {
    /// The variant for a device: subgroups of 32 if available, of 16 on Intel's, else the largest size; changed by
    /// `caps.tuning` if that fits the device ([`Variant::tuned`] says why it does not).
    pub fn for_device(caps: &DeviceCaps) -> Self {
        Self::tuned(caps).unwrap_or_else(|_| Self::picked_for(caps))
    }

    /// The variant for training: as [`Variant::for_device`] with tiles of one block. A step writes and reads sums for every
    /// block of the tiles that a splat touches, also for those blocks that it does not reach.
    pub fn for_training(caps: &DeviceCaps) -> Self {
        Self { tile_size: BLOCK_SIDE, ..Self::for_device(caps) }
    }

    /// What to try if this variant, that of the device, fails the self-test: the other subgroup sizes with the same tiles, as a
    /// driver may compile one size wrongly. None for a device that is tuned, where another variant would not be what is measured.
    pub fn fallbacks(&self, caps: &DeviceCaps) -> Vec<Self> {
        if !caps.tuning.is_empty() {
            return Vec::new();
        }
        let others = caps.subgroup_sizes().into_iter().filter(|&size| size != self.subgroup_size);
        others.map(|size| Self { tile_size: self.tile_size, ..Self::for_subgroup_size(caps, size) }).collect()
    }

    /// The variant for a device, changed by `caps.tuning`: its names are those of the fields, and 0 and 1 are no and yes.
    ///
    /// # Errors
    /// [`GpuError::Tuning`], which names what is wrong: a name that is no field, a number that is no power of two or beyond the
    /// device's limits, or more shared memory than a work-group has.
    pub fn tuned(caps: &DeviceCaps) -> Result<Self, GpuError> {
        let subgroup_size = caps.tuning.numbers().find(|(name, _)| *name == "subgroup_size").map(|(_, size)| size);
        let mut variant = match subgroup_size {
            Some(size) if caps.subgroup_sizes().contains(&size) => Self::for_subgroup_size(caps, size),
            Some(size) => return Err(GpuError::Tuning(format!("{} has no subgroups of {size}", caps.name))),
            None => Self::picked_for(caps),
        };
        let subgroup_size = variant.subgroup_size;
        let most = most_threads(caps, subgroup_size).min(BLOCK_SIZE).min(MOST_SUBGROUPS * subgroup_size);
        for (name, number) in caps.tuning.numbers() {
            let (threads, splats) = (subgroup_size..=most, 1..=subgroup_size);
            let (field, allowed) = match name {
                "subgroup_size" => continue,
                "workgroup_size" => (&mut variant.workgroup_size, subgroup_size.max(LEAST_GROUP)..=most),
                "radix_workgroup_size" => (&mut variant.radix_workgroup_size, threads),
                "blend_workgroup_size" => (&mut variant.blend_workgroup_size, threads),
                "tile_size" => (&mut variant.tile_size, BLOCK_SIDE..=MOST_TILE_SIZE),
                "splats_unrolled" => (&mut variant.splats_unrolled, splats),
                "backward_splats_unrolled" => (&mut variant.backward_splats_unrolled, splats),
                "expand_backward_subgroup_size" => (&mut variant.expand_backward_subgroup_size, splats),
                _ => {
                    *variant.flag(name).ok_or_else(|| GpuError::Tuning(format!("there is no {name:?}")))? = number != 0;
                    continue;
                }
            };
            // Groups divide blocks of scan and sort, and blocks of pixels divide tiles.
            if !allowed.contains(&number) || !number.is_power_of_two() {
                return Err(GpuError::Tuning(format!("{name} cannot be {number} on {}", caps.name)));
            }
            *field = number;
        }
        let Self { radix_workgroup_size, stage_keys, blend_workgroup_size, stage_splats, .. } = variant;
        let sort_bytes = sort_shared_bytes(radix_workgroup_size, subgroup_size, stage_keys);
        let blend_bytes = if stage_splats { STAGED_SPLAT_BYTES * blend_workgroup_size } else { 0 };
        let group_bytes = GROUP_BYTES * variant.workgroup_size;
        for (what, bytes) in [("the sort", sort_bytes), ("the blend", blend_bytes), ("a work-group", group_bytes)] {
            if bytes > caps.shared_memory_bytes {
                let (device, most) = (&caps.name, caps.shared_memory_bytes);
                return Err(GpuError::Tuning(format!(
                    "{what} takes {bytes} bytes of shared memory, {device} has {most}"
                )));
            }
        }
        let lanes = variant.expand_backward_subgroup_size;
        if !caps.subgroup_sizes().contains(&lanes) || most_threads(caps, lanes) < variant.workgroup_size {
            return Err(GpuError::Tuning(format!(
                "{} has no groups of {} threads with subgroups of {lanes} (expand_backward_subgroup_size)",
                caps.name, variant.workgroup_size
            )));
        }
        if stage_keys && radix_workgroup_size == subgroup_size {
            return Err(GpuError::Tuning("stage_keys wants more than one subgroup in radix_workgroup_size".into()));
        }
        Ok(variant)
    }

    /// The field of a name that says yes or no.
    fn flag(&mut self, name: &str) -> Option<&mut bool> {
        match name {
            "match_by_ballot" => Some(&mut self.match_by_ballot),
            "stage_keys" => Some(&mut self.stage_keys),
            "transpose_moments" => Some(&mut self.transpose_moments),
            "stage_splats" => Some(&mut self.stage_splats),
            _ => None,
        }
    }

    /// Number of 8x8 blocks of pixels in a tile.
    pub fn blocks_per_tile(&self) -> u32 {
        (self.tile_size / BLOCK_SIDE) * (self.tile_size / BLOCK_SIDE)
    }

    /// Loop iterations that the blends take for each subgroup of splats in a tile's list, forward or backward.
    pub(crate) fn iterations_per_subgroup_of_splats(&self) -> u32 {
        let inner = |unrolled: u32| self.subgroup_size / unrolled;
        let forward = match !self.stage_splats && self.splats_unrolled == self.subgroup_size {
            true => 0,
            false => inner(self.splats_unrolled),
        };
        let backward = if self.transpose_moments { 0 } else { inner(self.backward_splats_unrolled) };
        1 + forward.max(backward)
    }

    fn picked_for(caps: &DeviceCaps) -> Self {
        let preferred = preferred_subgroup_size(&caps.subgroup_sizes(), caps.is_intel);
        Self::for_subgroup_size(caps, preferred.unwrap_or(caps.max_subgroup_size))
    }

    /// The variant for one of `caps.subgroup_sizes()`.
    pub fn for_subgroup_size(caps: &DeviceCaps, subgroup_size: u32) -> Self {
        let most = most_threads(caps, subgroup_size);
        // Powers of two, so that work-groups divide the blocks of scan and sort.
        let largest = |want: u32| 1 << want.min(most).max(subgroup_size).ilog2();
        // A CPU driver runs one subgroup at a time: more than one per work-group only adds barriers.
        let mut radix_subgroups = if caps.is_llvmpipe { 1 } else { 8 };
        // Twice as many at 16 lanes, so that a lane's keys fit its registers, where shared memory has room for the tables.
        if radix_subgroups > 1 && subgroup_size == 16 && sort_shared_bytes(256, 16, true) <= caps.shared_memory_bytes {
            radix_subgroups = 16;
        }
        let radix_workgroup_size = largest(radix_subgroups * subgroup_size);
        let staged_keys_fit = BLOCK_SIZE / radix_workgroup_size <= MOST_STAGED_KEYS
            && sort_shared_bytes(radix_workgroup_size, subgroup_size, true) <= caps.shared_memory_bytes;
        // The same, and chunks that fit templates: of a group of 256, most lanes idle where an instance has 100 Gaussians. A
        // training step of shelf_1 takes 58 ms with 256, 60 with 64, 49 with 32 and 56 with 16 (plain 3DGS: 71, 67, 63, 68).
        let workgroup_size = largest(if caps.is_llvmpipe { 32 } else { 256 });
        // Intel's GPUs that have 8 lanes keep a value of 16 in two of a thread's 128 registers: a backward blend of several splats
        // at once then spills 12 values and more, and the backward pass of the expansion 23 to 93 (docs/gpu.md).
        let narrow = caps.is_intel && subgroup_size == 16 && caps.subgroup_sizes().contains(&8);
        Self {
            subgroup_size,
            workgroup_size,
            radix_workgroup_size,
            match_by_ballot: subgroup_size > 16,
            stage_keys: !caps.is_llvmpipe && staged_keys_fit,
            blend_workgroup_size: if caps.is_llvmpipe { subgroup_size } else { largest(128) },
            // Larger tiles have fewer pairs to make and to sort: garden at 1080p 1.4 million instead of 4.5. Blocks pick theirs
            // from the tile's list where splats are staged.
            tile_size: if caps.is_llvmpipe { BLOCK_SIDE } else { 2 * BLOCK_SIDE },
            // The sums of a whole subgroup of splats do not fit the registers of GPUs, and at 32 lanes of nothing.
            transpose_moments: caps.is_llvmpipe && subgroup_size <= 16,
            stage_splats: !caps.is_llvmpipe,
            // All of them with shuffles, so that these have constant lanes; some of them where code has to fit a cache.
            splats_unrolled: match (caps.is_llvmpipe, narrow) {
                (true, _) => subgroup_size,
                (false, true) => 2,
                (false, false) => 4,
            },
            backward_splats_unrolled: match subgroup_size {
                _ if narrow => 1,
                ..32 => 4,
                _ => 8,
            },
            expand_backward_subgroup_size: match narrow && most_threads(caps, 8) >= workgroup_size {
                true => 8,
                false => subgroup_size,
            },
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

    /// A GPU with subgroups of 32.
    fn caps(tuning: &str) -> DeviceCaps {
        DeviceCaps {
            name: "a GPU".into(),
            driver: String::new(),
            api_version: "1.3.0".into(),
            device_type: "discrete",
            min_subgroup_size: 32,
            max_subgroup_size: 32,
            default_subgroup_size: 32,
            can_require_subgroup_size: true,
            max_workgroup_subgroups: 32,
            max_workgroup_invocations: 1024,
            shared_memory_bytes: 32 << 10,
            max_storage_bytes: 1 << 32,
            max_buffer_bytes: 1 << 40,
            max_workgroup_count: 65535,
            max_storage_buffers: 64,
            timestamp_period_ns: 1.0,
            is_intel: false,
            is_llvmpipe: false,
            loop_iteration_limit: None,
            tuning: tuning.parse().unwrap(),
        }
    }

    #[test]
    fn tuning_changes_what_it_names_and_says_what_does_not_fit() {
        let picked = Variant::for_device(&caps(""));
        assert!(picked.stage_keys && picked.stage_splats && picked.tile_size == 16, "{picked:?}");
        assert_eq!(Variant::for_training(&caps("")), Variant { tile_size: 8, ..picked });
        let tuned = Variant::tuned(&caps("tile_size=32,stage_keys=0,radix_workgroup_size=512")).unwrap();
        assert_eq!(tuned, Variant { tile_size: 32, stage_keys: false, radix_workgroup_size: 512, ..picked });
        // 32 KiB of tables and more; one subgroup.
        let sorts = ["radix_workgroup_size=1024", "radix_workgroup_size=32"];
        // 48 KiB of sums.
        let others = [
            "workgroup_size=1024",
            "tile_size=24",
            "tile_size=4",
            "subgroup_size=8",
            "blend_workgroup_size=2048",
            "colour=1",
        ];
        for wrong in sorts.into_iter().chain(others) {
            assert!(Variant::tuned(&caps(wrong)).is_err(), "{wrong}");
            assert_eq!(Variant::for_device(&caps(wrong)), picked);
        }
        let narrow = |tuning| DeviceCaps { min_subgroup_size: 4, ..caps(tuning) };
        assert!(Variant::tuned(&narrow("subgroup_size=4,workgroup_size=16")).is_ok());
        assert!(Variant::tuned(&narrow("subgroup_size=4,workgroup_size=8")).is_err());
    }

    #[test]
    fn keys_are_staged_where_registers_and_shared_memory_hold_them() {
        let staged = |size, shared_memory_bytes| {
            let sizes = DeviceCaps { min_subgroup_size: size, max_subgroup_size: size, ..caps("") };
            Variant::for_device(&DeviceCaps { shared_memory_bytes, ..sizes }).stage_keys
        };
        assert!(staged(64, 16 << 10) && staged(32, 16 << 10) && staged(16, 32 << 10));
        // 17 KiB of tables; 16 keys a lane.
        assert!(!staged(16, 16 << 10) && !staged(8, 64 << 10));
        let small =
            DeviceCaps { min_subgroup_size: 16, max_subgroup_size: 16, shared_memory_bytes: 16 << 10, ..caps("") };
        let Variant { radix_workgroup_size, .. } = Variant::for_device(&small);
        assert!(sort_shared_bytes(radix_workgroup_size, 16, false) <= 16 << 10);
    }

    #[test]
    fn other_sizes_stand_in_but_for_a_tuned_device() {
        let sizes = |tuning| DeviceCaps { min_subgroup_size: 8, max_subgroup_size: 64, ..caps(tuning) };
        let training = Variant::for_training(&sizes(""));
        let others = training.fallbacks(&sizes(""));
        assert_eq!(others.iter().map(|other| other.subgroup_size).collect::<Vec<_>>(), [8, 16, 64]);
        assert!(others.iter().all(|other| (other.tile_size, other.workgroup_size) == (8, training.workgroup_size)));
        assert!(training.fallbacks(&sizes("subgroup_size=32")).is_empty());
    }

    #[test]
    fn what_needs_most_registers_is_narrower_where_intel_has_8_lanes() {
        let intel = |least| DeviceCaps { min_subgroup_size: least, max_subgroup_size: 32, is_intel: true, ..caps("") };
        let alchemist = Variant::for_device(&intel(8));
        assert_eq!((alchemist.subgroup_size, alchemist.expand_backward_subgroup_size), (16, 8));
        assert_eq!((alchemist.splats_unrolled, alchemist.backward_splats_unrolled), (2, 1));
        let battlemage = Variant::for_device(&intel(16));
        assert_eq!((battlemage.subgroup_size, battlemage.expand_backward_subgroup_size), (16, 16));
        // Its group of 256 threads is 32 subgroups of 8.
        let few = DeviceCaps { max_workgroup_subgroups: 16, ..intel(8) };
        assert_eq!(Variant::for_device(&few).expand_backward_subgroup_size, 16);
    }

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
