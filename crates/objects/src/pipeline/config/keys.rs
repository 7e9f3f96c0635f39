//! The keys of the pipeline and the values that each accepts.

use instgs_train::config::keys::Takes::{Flag, Real, RealAbove, RealBelow, Text, Whole, Word};
use instgs_train::config::keys::{Key, key};

/// Every key of the pipeline, in the order of `configs/instgs.toml`.
pub const KEYS: [Key; 20] = [
    key("groups", Text),
    key("masks", Text),
    key("boxes", Text),
    key("prompt", Text),
    key("models", Text),
    key("detect.box_threshold", Real(0.0, 1.0)),
    key("detect.text_threshold", Real(0.0, 1.0)),
    key("detect.overlap", Real(0.0, 1.0)),
    key("detect.provider", Word(&["cpu", "cuda", "tensorrt", "rocm", "coreml", "directml"])),
    key("segment.alpha", RealAbove(0.0, 100.0)),
    key("segment.fill_unseen", Flag),
    key("segment.drop_strays", Flag),
    key("template.source", Word(&["merge", "single", "max"])),
    key("template.sampling", Word(&["farthest", "voxel", "random"])),
    key("template.keep", Word(&["all", "position_and_colour"])),
    key("template.count_factor", RealAbove(0.0, 10.0)),
    key("template.settle_rounds", Whole(0, 100)),
    key("template.unmatched", Word(&["drop", "own"])),
    key("offsets.init", Word(&["difference", "zero"])),
    key("joint.prune_weight", RealBelow(0.0, 1.0)),
];
