//! Files. Readers check every count against the actual length of the file before allocating, never panic on input,
//! and report one-line errors ([`IoError`]). Writers replace files atomically and write the same bytes for the same
//! data.
//!
//! Scenes: [`load_scene`] and [`save_scene`] (`.instgs`, `.ply`, `.spz`, `.sog`, `.splat`,
//! `.glb`); [`export_scene`], also as a page for browsers ([`write_page`]). Views:
//! [`dataset::read_views`], [`load_view`] for their images, [`read_points`], and [`camera_file`]. Repeated objects:
//! [`MaskFolder`] and [`read_groups`]. Float images: [`ktx2`]. Training state: [`checkpoint`]. The
//! files of a run: [`RunFolder`].

mod atomic;
pub mod boxes;
mod bytes;
pub mod camera_file;
pub mod checkpoint;
pub mod colmap;
pub mod dataset;
pub mod error;
mod export_notes;
pub mod exposures;
pub mod fingerprint;
pub mod glb;
pub mod groups;
pub mod host_memory;
mod jpeg_end;
pub mod json;
pub mod ktx2;
pub mod mask_png;
pub mod masks;
#[cfg(test)]
mod message_tests;
pub mod nerf;
pub mod nerf_write;
mod packing;
pub mod page;
pub mod paged_file;
mod pages;
pub mod picture_png;
mod plausible;
pub mod ply;
mod ply_packed;
mod ply_table;
pub mod point_cloud;
pub mod run_folder;
pub mod run_lock;
mod safetensors_header;
pub mod scene_export;
pub mod scene_file;
pub mod scene_load;
pub mod scene_pack;
pub mod scene_small;
pub mod scene_write;
pub mod small;
pub mod sog;
pub mod splat;
pub mod spz;
mod spz_axes;
mod spz_codec;
mod spz_write;
mod step_columns;
mod text;
pub mod usd;
pub mod view_image;
mod view_resample;

use std::fs;
use std::path::Path;

use instgs_vk::scene::gaussians::MAX_SH_DEGREE;

pub use atomic::{atomic_write, copy_file, locked_temporary, remove_if_there, replaced_file};
pub use boxes::{read_boxes, with_view_names, write_boxes};
pub use camera_file::{read_cameras, write_cameras};
pub use checkpoint::Checkpoint;
pub use dataset::{Dataset, Split, View, read_views};
pub use error::{IoError, Place};
pub use exposures::{PhotoExposure, read_exposures, write_exposures};
pub use fingerprint::Fingerprint;
pub use glb::{read_glb, write_glb};
pub use groups::{read_groups, write_groups};
pub use masks::{Mask, MaskFolder, read_mask, write_categories, write_mask};
pub use nerf_write::{Frame, write_frames, write_transforms};
pub use packing::packing_lost;
pub use page::{PageOptions, page_text, write_page};
pub use paged_file::PagedFile;
pub use ply::{read_ply, write_ply};
pub use point_cloud::{LoadedPoints, read_points, write_points};
pub use run_folder::RunFolder;
pub use run_lock::{RunLock, is_at};
pub use scene_export::{ExportFormat, ExportedScene, export_scene};
pub use scene_file::read_scene_file;
pub use scene_load::{LoadedScene, load_scene, load_scene_to_draw, save_scene};
pub use scene_pack::Pack;
pub use scene_write::{
    write_planned_scene_file, write_scene_file, write_scene_file_in_pages, write_scene_file_packed,
    write_small_scene_file,
};
pub use sog::{read_sog, write_sog};
pub use splat::read_splat;
pub use spz::{SpzLoss, read_spz, write_spz};
pub use view_image::{LoadedView, ViewImage, load_view};

/// Reads the whole of a regular file into memory.
///
/// # Errors
/// The file is missing, is no regular file, or is larger than the available memory.
pub fn read_bytes(path: &Path) -> Result<Vec<u8>, IoError> {
    let fail = |e: std::io::Error| IoError::os(path, "cannot read", &e);
    let kind = fs::metadata(path).map_err(fail)?;
    if kind.is_dir() {
        return Err(IoError::new(path, "is a folder, not a file"));
    }
    // A pipe may never end, or never begin; a device has no size.
    if !kind.is_file() {
        return Err(IoError::new(path, "is no regular file").advise("copy its content to a file"));
    }
    if let Some(have) = host_memory::available_bytes().filter(|&have| kind.len() > have) {
        let (need, have) = (kind.len() >> 20, have >> 20);
        return Err(IoError::too_large(path, format!("has {need} MiB, but {have} MiB of memory are available")));
    }
    fs::read(path).map_err(fail)
}

/// Logit of an opacity stored in 8 bits. 0 and 255 have no finite logit and become those of 1e-6 and 1 - 1e-6 (logits
/// -+13.8), which round back to the same byte.
pub(crate) fn logit_of_byte(alpha: u8) -> f32 {
    let a = (f64::from(alpha) / 255.0).clamp(1e-6, 1.0 - 1e-6);
    (a / (1.0 - a)).ln() as f32
}

/// Log scale that stands for a scale of zero: the logarithm of the smallest normal f32, scene units.
pub(crate) const LEAST_LOG_SCALE: f32 = -87.336_54;

/// A note for the user if a file has a higher SH degree, `stored`, than is supported.
pub(crate) fn cut_note(stored: u32) -> Option<String> {
    (stored > MAX_SH_DEGREE).then(|| format!("has colours of SH degree {stored}, of which {MAX_SH_DEGREE} are kept"))
}
