//! The compiled kernels. Scan and sort do not depend on the scene and are compiled once per variant.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::sync::Arc;

use super::scene_traits::SceneTraits;
use super::variant::Variant;
use super::*;
use crate::gpu::interface::Kernel;
use crate::gpu::interface::constants::LAYERS;
use crate::gpu::{Gpu, GpuError, Pipeline, PipelineCache};
use crate::scene::DevicePrecision;

/// The forward kernels, compiled for one variant (tile size included) and for the traits of a scene.
#[allow(missing_docs, reason = "each field is the pipeline of the kernel it is named after")]
pub struct Pipelines {
    pub variant: Variant,
    pub traits: SceneTraits,
    pub purpose: Purpose,
    pub cull_instances: Pipeline<cull_instances::CullInstances>,
    pub cull_chunks: Pipeline<cull_chunks::CullChunks>,
    pub emit_work_items: Pipeline<emit_work_items::EmitWorkItems>,
    pub expand: ExpandPipeline,
    pub compact_visible: Pipeline<compact_visible::CompactVisible>,
    pub plan_slab: Pipeline<plan_slab::PlanSlab>,
    pub emit_intersections: Pipeline<emit_intersections::EmitIntersections>,
    pub tile_ranges: Pipeline<tile_ranges::TileRanges>,
    pub tile_blend: Pipeline<tile_blend::TileBlend>,
    /// For frames in depth layers.
    pub layers: Option<LayerPipelines>,
}

/// What the forward kernels are for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// Pictures whose splats are all expanded before the first is blended.
    Whole,
    /// Pictures in depth layers, which leave out what is hidden.
    Layered,
    /// Training: they keep what the backward pass needs.
    Training,
}

impl Purpose {
    /// Index of a frame's rearmost depth layer: 0 for one in a single piece.
    pub fn last_layer(self) -> u32 {
        match self {
            Self::Layered => LAYERS - 1,
            Self::Whole | Self::Training => 0,
        }
    }
}

/// The kernels that frames in depth layers have besides.
#[allow(missing_docs, reason = "each field is the pipeline of the kernel it is named after")]
pub struct LayerPipelines {
    pub layer_histogram: Pipeline<layer_histogram::LayerHistogram>,
    pub plan_layers: Pipeline<plan_layers::PlanLayers>,
    pub close_tiles: Pipeline<close_tiles::CloseTiles>,
    pub next_layer: Pipeline<next_layer::NextLayer>,
}

/// The kernel that expands instances, for scenes as they are or packed.
pub enum ExpandPipeline {
    /// For scenes in f32.
    Full(Pipeline<preprocess_instance_expand::PreprocessInstanceExpand>),
    /// For packed scenes.
    Packed(Pipeline<preprocess_instance_expand_packed::PreprocessInstanceExpandPacked>),
}

/// The kernels of a training step besides the forward kernels.
#[allow(missing_docs, reason = "each field is the pipeline of the kernel it is named after")]
pub struct BackwardPipelines {
    /// True if gradients by the poses of instances are computed.
    pub poses: bool,
    pub image_loss_rows: Pipeline<image_loss_rows::ImageLossRows>,
    pub image_loss_columns: Pipeline<image_loss_columns::ImageLossColumns>,
    pub image_loss_backward_rows: Pipeline<image_loss_backward_rows::ImageLossBackwardRows>,
    pub image_loss_backward_columns: Pipeline<image_loss_backward_columns::ImageLossBackwardColumns>,
    pub train_status: Pipeline<train_status::TrainStatus>,
    pub tile_blend_backward: Pipeline<tile_blend_backward::TileBlendBackward>,
    pub preprocess_instance_expand_backward:
        Pipeline<preprocess_instance_expand_backward::PreprocessInstanceExpandBackward>,
    /// The same for steps in which poses and colour matrices do not learn; `None` for scenes that have neither.
    pub preprocess_instance_expand_backward_but_instances:
        Option<Pipeline<preprocess_instance_expand_backward::PreprocessInstanceExpandBackward>>,
    pub gather_gradients: Pipeline<gather_gradients::GatherGradients>,
    /// The same for steps in which offsets of SH bands above 0 do not learn; `None` for scenes without such offsets.
    pub gather_gradients_but_sh_offsets: Option<Pipeline<gather_gradients::GatherGradients>>,
    /// The same for Gaussians that no more than one row shows: the background and instances' own.
    pub gather_gradients_of_one: Pipeline<gather_gradients::GatherGradients>,
    /// In scenes with colour matrices.
    pub gather_color_gradients: Option<Pipeline<gather_color_gradients::GatherColorGradients>>,
    pub gather_pose_gradients: Pipeline<gather_pose_gradients::GatherPoseGradients>,
    pub refine_poses: Pipeline<refine_poses::RefinePoses>,
    pub adam: Pipeline<adam::Adam>,
}

/// The kernels that change the number of Gaussians between steps.
#[allow(missing_docs, reason = "each field is the pipeline of the kernel it is named after")]
pub struct DensifyPipelines {
    pub source_use: Pipeline<source_use::SourceUse>,
    pub densify_mark: Pipeline<densify_mark::DensifyMark>,
    pub densify_select: Pipeline<densify_select::DensifySelect>,
    pub densify_place: Pipeline<densify_place::DensifyPlace>,
    pub densify_place_offsets: Pipeline<densify_place_offsets::DensifyPlaceOffsets>,
    pub densify_own_need: Pipeline<densify_own_need::DensifyOwnNeed>,
    pub densify_own_select: Pipeline<densify_own_select::DensifyOwnSelect>,
    pub densify_place_own: Pipeline<densify_place_own::DensifyPlaceOwn>,
    pub densify_own: Pipeline<densify_own::DensifyOwn>,
    pub densify_split: Pipeline<densify_split::DensifySplit>,
    pub densify_split_offsets: Pipeline<densify_split_offsets::DensifySplitOffsets>,
    pub densify_cost: Pipeline<densify_cost::DensifyCost>,
    pub densify_retire: Pipeline<densify_retire::DensifyRetire>,
    pub mcmc_weigh: Pipeline<mcmc_weigh::McmcWeigh>,
    pub mcmc_pick: Pipeline<mcmc_pick::McmcPick>,
    pub mcmc_gather_copies: Pipeline<mcmc_gather_copies::McmcGatherCopies>,
    pub mcmc_share: Pipeline<mcmc_share::McmcShare>,
    pub move_gaussians: Pipeline<move_gaussians::MoveGaussians>,
    pub reset_opacity: Pipeline<reset_opacity::ResetOpacity>,
    pub decay_opacity: Pipeline<decay_opacity::DecayOpacity>,
}

/// The kernels that strategy `mcmc` adds to every step.
#[allow(missing_docs, reason = "each field is the pipeline of the kernel it is named after")]
pub struct McmcStepPipelines {
    pub mcmc_regularise: Pipeline<mcmc_regularise::McmcRegularise>,
    pub mcmc_noise: Pipeline<mcmc_noise::McmcNoise>,
}

/// The kernels of the exposures of photos.
#[allow(missing_docs, reason = "each field is the pipeline of the kernel it is named after")]
pub struct ExposurePipelines {
    pub apply_exposure: Pipeline<apply_exposure::ApplyExposure>,
    pub exposure_backward: Pipeline<exposure_backward::ExposureBackward>,
    pub refine_exposure: Pipeline<refine_exposure::RefineExposure>,
    pub recentre_exposures: Pipeline<recentre_exposures::RecentreExposures>,
}

/// The kernel of segmentation: contributions to masks.
#[allow(missing_docs, reason = "each field is the pipeline of the kernel it is named after")]
pub struct SegmentPipelines {
    pub variant: Variant,
    pub mask_contribution: Pipeline<mask_contribution::MaskContribution>,
}

/// The kernel of the id buffer.
#[allow(missing_docs, reason = "each field is the pipeline of the kernel it is named after")]
pub struct SurfacePipelines {
    pub variant: Variant,
    pub tile_surface: Pipeline<tile_surface::TileSurface>,
}

/// The kernel that marks single splats.
#[allow(missing_docs, reason = "each field is the pipeline of the kernel it is named after")]
pub struct MarkPipelines {
    pub variant: Variant,
    pub tile_marks: Pipeline<tile_marks::TileMarks>,
}

/// The kernel that shows pictures in windows.
#[derive(Default)]
pub struct PresentPipelines {
    present: HashMap<PresentVariant, Pipeline<present::Present>>,
}

/// The specialisation of kernel `present`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct PresentVariant {
    /// Code of the view, `SHOW_*`.
    pub show: u32,
    /// True if selected instances are outlined.
    pub outline: bool,
    /// True if picture and window differ in size.
    pub scaled: bool,
    /// How the device holds the scene.
    pub precision: DevicePrecision,
}

/// The three scan passes; `*_gather` read their values through an index list.
#[allow(missing_docs, reason = "each field is the pipeline of the kernel it is named after")]
pub struct ScanPipelines {
    pub reduce: Pipeline<scan_reduce::ScanReduce>,
    pub reduce_gather: Pipeline<scan_reduce::ScanReduce>,
    pub spine: Pipeline<scan_spine::ScanSpine>,
    pub downsweep: Pipeline<scan_downsweep::ScanDownsweep>,
    pub downsweep_gather: Pipeline<scan_downsweep::ScanDownsweep>,
}

/// The three passes of a radix sort step.
#[allow(missing_docs, reason = "each field is the pipeline of the kernel it is named after")]
pub struct SortPipelines {
    pub count: Pipeline<radix_sort_count::RadixSortCount>,
    pub scan: Pipeline<radix_sort_scan::RadixSortScan>,
    pub scatter: Pipeline<radix_sort_scatter::RadixSortScatter>,
}

/// Scan and sort, compiled for one variant.
pub struct Primitives {
    /// Pipelines of the exclusive scan.
    pub scan: ScanPipelines,
    /// Pipelines of the stable radix sort.
    pub sort: SortPipelines,
}

impl Primitives {
    /// Compiles scan and sort for a variant.
    pub fn new(gpu: &Arc<Gpu>, cache: &PipelineCache, variant: &Variant) -> Result<Self, GpuError> {
        Ok(Self { scan: ScanPipelines::new(gpu, cache, variant)?, sort: SortPipelines::new(gpu, cache, variant)? })
    }
}

/// Compiles kernels for one subgroup size.
#[derive(Clone, Copy)]
struct Compiler<'a> {
    gpu: &'a Arc<Gpu>,
    cache: &'a PipelineCache,
    subgroup_size: u32,
}

impl Compiler<'_> {
    fn compile<K: Kernel>(&self, workgroup_size: u32, more: &[(&str, u32)]) -> Result<Pipeline<K>, GpuError> {
        let mut constants = vec![("SUBGROUP_SIZE", self.subgroup_size), ("WORKGROUP_SIZE", workgroup_size)];
        // A kernel without subgroup operations does not declare the subgroup size.
        constants.retain(|(name, _)| K::SHADER.spec_constants.iter().any(|c| c.name == *name));
        constants.extend_from_slice(more);
        Pipeline::new(self.gpu, self.cache, self.subgroup_size, &constants)
    }
}

impl ScanPipelines {
    /// Compiles the scan for a variant.
    pub fn new(gpu: &Arc<Gpu>, cache: &PipelineCache, variant: &Variant) -> Result<Self, GpuError> {
        let compiler = Compiler { gpu, cache, subgroup_size: variant.subgroup_size };
        let size = variant.workgroup_size;
        Ok(Self {
            reduce: compiler.compile(size, &[("GATHER", 0)])?,
            reduce_gather: compiler.compile(size, &[("GATHER", 1)])?,
            spine: compiler.compile(size, &[])?,
            downsweep: compiler.compile(size, &[("GATHER", 0)])?,
            downsweep_gather: compiler.compile(size, &[("GATHER", 1)])?,
        })
    }
}

impl SortPipelines {
    /// Compiles the sort for a variant.
    pub fn new(gpu: &Arc<Gpu>, cache: &PipelineCache, variant: &Variant) -> Result<Self, GpuError> {
        let compiler = Compiler { gpu, cache, subgroup_size: variant.subgroup_size };
        let size = variant.radix_workgroup_size;
        let matching = ("MATCH_BY_BALLOT", u32::from(variant.match_by_ballot));
        Ok(Self {
            count: compiler.compile(size, &[matching])?,
            scan: compiler.compile(size, &[])?,
            scatter: compiler.compile(size, &[matching, ("STAGE_KEYS", u32::from(variant.stage_keys))])?,
        })
    }
}

impl Pipelines {
    /// Compiles all forward kernels for a purpose.
    pub fn new(
        gpu: &Arc<Gpu>,
        cache: &PipelineCache,
        variant: Variant,
        traits: SceneTraits,
        purpose: Purpose,
    ) -> Result<Self, GpuError> {
        let compiler = Compiler { gpu, cache, subgroup_size: variant.subgroup_size };
        let size = variant.workgroup_size;
        let tile = ("TILE_SIZE", variant.tile_size);
        let levels = ("LEVELS", u32::from(traits.levels));
        let colors = traits.color_matrices_constant();
        let training = ("TRAINING", u32::from(purpose == Purpose::Training));
        let layered = ("LAYERED", u32::from(purpose == Purpose::Layered));
        let mut expand =
            [&[tile, levels, layered, colors, traits.windowed_constant()][..], &traits.constants()].concat();
        Ok(Self {
            variant,
            traits,
            purpose,
            cull_instances: compiler.compile(size, &[levels])?,
            cull_chunks: compiler.compile(size, &[tile, layered])?,
            emit_work_items: compiler.compile(size, &[])?,
            expand: match traits.precision {
                DevicePrecision::F32 => ExpandPipeline::Full(compiler.compile(size, &expand)?),
                packed => {
                    expand.push(("OFFSET_BITS", packed.offset_bits()));
                    ExpandPipeline::Packed(compiler.compile(size, &expand)?)
                }
            },
            compact_visible: compiler.compile(size, &[])?,
            plan_slab: compiler.compile(size, &[])?,
            emit_intersections: compiler.compile(size, &[tile, training, layered])?,
            tile_ranges: compiler.compile(size, &[])?,
            tile_blend: compiler.compile(
                variant.blend_workgroup_size,
                &[
                    tile,
                    columns_per_lane(&variant),
                    training,
                    stage_splats(&variant),
                    ("SPLATS_UNROLLED", variant.splats_unrolled),
                ],
            )?,
            layers: match purpose {
                Purpose::Layered => Some(LayerPipelines {
                    layer_histogram: compiler.compile(size, &[])?,
                    plan_layers: compiler.compile(size, &[])?,
                    close_tiles: compiler.compile(size, &[tile])?,
                    next_layer: compiler.compile(size, &[])?,
                }),
                Purpose::Whole | Purpose::Training => None,
            },
        })
    }
}

/// At subgroup size 4, a row of 8 pixels has more pixels than the subgroup has lanes.
fn columns_per_lane(variant: &Variant) -> (&'static str, u32) {
    ("COLUMNS_PER_LANE", (8 / variant.subgroup_size).max(1))
}

/// Shared memory takes the place of shuffles.
fn stage_splats(variant: &Variant) -> (&'static str, u32) {
    ("STAGE_SPLATS", u32::from(variant.stage_splats))
}

impl BackwardPipelines {
    /// Compiles all backward kernels for the traits of a scene and the variant's tile size; `poses` adds gradients by
    /// the poses of instances.
    pub fn new(
        gpu: &Arc<Gpu>,
        cache: &PipelineCache,
        variant: Variant,
        traits: SceneTraits,
        poses: bool,
    ) -> Result<Self, GpuError> {
        let compiler = Compiler { gpu, cache, subgroup_size: variant.subgroup_size };
        let size = variant.workgroup_size;
        let tile = ("TILE_SIZE", variant.tile_size);
        let transpose = ("TRANSPOSE", u32::from(variant.transpose_moments));
        // Gradients by poses are written by subgroup and read by `gather_pose_gradients`.
        let expand_compiler = Compiler { subgroup_size: variant.expand_backward_subgroup_size, ..compiler };
        let expand_backward = |poses: bool, color_terms: bool| {
            let own = [
                ("POSES", u32::from(poses)),
                ("COLOR_TERMS", u32::from(color_terms)),
                traits.color_matrices_constant(),
                traits.windowed_constant(),
            ];
            expand_compiler.compile(size, &[&own[..], &traits.constants()].concat())
        };
        let gather = |traits: SceneTraits, one: bool| {
            let constants = [
                ("SH_DEGREE", traits.sh_degree),
                ("OFFSET_SH_REST", traits.offset_sh_rest),
                ("OWN_MAY_GROW", u32::from(traits.own_may_grow)),
                ("ONE_INSTANCE", u32::from(one)),
                traits.windowed_constant(),
            ];
            compiler.compile(size, &constants)
        };
        Ok(Self {
            poses,
            image_loss_rows: compiler.compile(size, &[])?,
            image_loss_columns: compiler.compile(size, &[])?,
            image_loss_backward_rows: compiler.compile(size, &[])?,
            image_loss_backward_columns: compiler.compile(size, &[])?,
            train_status: compiler.compile(size, &[])?,
            tile_blend_backward: compiler.compile(
                variant.blend_workgroup_size,
                &[
                    tile,
                    columns_per_lane(&variant),
                    transpose,
                    stage_splats(&variant),
                    ("SPLATS_UNROLLED", variant.backward_splats_unrolled),
                ],
            )?,
            preprocess_instance_expand_backward: expand_backward(poses, traits.color_matrices)?,
            preprocess_instance_expand_backward_but_instances: match poses || traits.color_matrices {
                true => Some(expand_backward(false, false)?),
                false => None,
            },
            gather_gradients: gather(traits, false)?,
            gather_gradients_of_one: gather(traits, true)?,
            gather_gradients_but_sh_offsets: match traits.offset_sh_rest {
                0 => None,
                _ => Some(gather(SceneTraits { offset_sh_rest: 0, ..traits }, false)?),
            },
            gather_color_gradients: match traits.color_matrices {
                true => Some(compiler.compile(size, &[])?),
                false => None,
            },
            gather_pose_gradients: expand_compiler.compile(size, &[])?,
            refine_poses: compiler.compile(size, &[])?,
            adam: compiler.compile(size, &[])?,
        })
    }
}

impl DensifyPipelines {
    /// Compiles all kernels for clouds of SH degree `sh_degree`.
    pub fn new(gpu: &Arc<Gpu>, cache: &PipelineCache, variant: &Variant, sh_degree: u32) -> Result<Self, GpuError> {
        let compiler = Compiler { gpu, cache, subgroup_size: variant.subgroup_size };
        let size = variant.workgroup_size;
        Ok(Self {
            source_use: compiler.compile(size, &[])?,
            densify_mark: compiler.compile(size, &[("SH_DEGREE", sh_degree)])?,
            densify_select: compiler.compile(size, &[])?,
            densify_place: compiler.compile(size, &[])?,
            densify_place_offsets: compiler.compile(size, &[])?,
            densify_own_need: compiler.compile(size, &[])?,
            densify_own_select: compiler.compile(size, &[])?,
            densify_place_own: compiler.compile(size, &[])?,
            densify_own: compiler.compile(size, &[("SH_DEGREE", sh_degree)])?,
            densify_split: compiler.compile(size, &[])?,
            densify_split_offsets: compiler.compile(size, &[])?,
            densify_cost: compiler.compile(size, &[])?,
            densify_retire: compiler.compile(size, &[])?,
            mcmc_weigh: compiler.compile(size, &[("SH_DEGREE", sh_degree)])?,
            mcmc_pick: compiler.compile(size, &[])?,
            mcmc_gather_copies: compiler.compile(size, &[])?,
            mcmc_share: compiler.compile(size, &[])?,
            move_gaussians: compiler.compile(size, &[])?,
            reset_opacity: compiler.compile(size, &[])?,
            decay_opacity: compiler.compile(size, &[])?,
        })
    }
}

impl ExposurePipelines {
    /// Compiles the kernels for a variant.
    pub fn new(gpu: &Arc<Gpu>, cache: &PipelineCache, variant: &Variant) -> Result<Self, GpuError> {
        let compiler = Compiler { gpu, cache, subgroup_size: variant.subgroup_size };
        let size = variant.workgroup_size;
        Ok(Self {
            apply_exposure: compiler.compile(size, &[])?,
            exposure_backward: compiler.compile(size, &[])?,
            refine_exposure: compiler.compile(size, &[])?,
            recentre_exposures: compiler.compile(size, &[])?,
        })
    }
}

impl SegmentPipelines {
    /// Compiles the kernel for the variant's tile size.
    pub fn new(gpu: &Arc<Gpu>, cache: &PipelineCache, variant: Variant) -> Result<Self, GpuError> {
        let compiler = Compiler { gpu, cache, subgroup_size: variant.subgroup_size };
        let sizes = [("TILE_SIZE", variant.tile_size), columns_per_lane(&variant)];
        Ok(Self { variant, mask_contribution: compiler.compile(variant.blend_workgroup_size, &sizes)? })
    }
}

impl SurfacePipelines {
    /// Compiles the kernel for the variant's tile size.
    pub fn new(gpu: &Arc<Gpu>, cache: &PipelineCache, variant: Variant) -> Result<Self, GpuError> {
        let compiler = Compiler { gpu, cache, subgroup_size: variant.subgroup_size };
        let sizes = [("TILE_SIZE", variant.tile_size), columns_per_lane(&variant)];
        Ok(Self { variant, tile_surface: compiler.compile(variant.blend_workgroup_size, &sizes)? })
    }
}

impl MarkPipelines {
    /// Compiles the kernel for the variant's tile size.
    pub fn new(gpu: &Arc<Gpu>, cache: &PipelineCache, variant: Variant) -> Result<Self, GpuError> {
        let compiler = Compiler { gpu, cache, subgroup_size: variant.subgroup_size };
        let sizes = [("TILE_SIZE", variant.tile_size), columns_per_lane(&variant)];
        Ok(Self { variant, tile_marks: compiler.compile(variant.blend_workgroup_size, &sizes)? })
    }
}

impl PresentPipelines {
    /// The kernel for a specialisation; compiled on first use.
    pub fn get(
        &mut self,
        gpu: &Arc<Gpu>,
        cache: &PipelineCache,
        variant: &Variant,
        present: PresentVariant,
    ) -> Result<&Pipeline<present::Present>, GpuError> {
        Ok(match self.present.entry(present) {
            Entry::Occupied(there) => there.into_mut(),
            Entry::Vacant(new) => {
                let PresentVariant { show, outline, scaled, precision } = present;
                let constants = [
                    ("SHOW", show),
                    ("OUTLINE", u32::from(outline)),
                    ("SCALED", u32::from(scaled)),
                    ("OFFSET_BITS", precision.offset_bits()),
                ];
                let compiler = Compiler { gpu, cache, subgroup_size: variant.subgroup_size };
                new.insert(compiler.compile(variant.workgroup_size, &constants)?)
            }
        })
    }
}

impl McmcStepPipelines {
    /// Compiles both kernels for a variant.
    pub fn new(gpu: &Arc<Gpu>, cache: &PipelineCache, variant: &Variant) -> Result<Self, GpuError> {
        let compiler = Compiler { gpu, cache, subgroup_size: variant.subgroup_size };
        let size = variant.workgroup_size;
        Ok(Self { mcmc_regularise: compiler.compile(size, &[])?, mcmc_noise: compiler.compile(size, &[])? })
    }
}
