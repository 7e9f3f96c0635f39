//! Writing OpenUSD 26.03 and later: one `ParticleField3DGaussianSplat` prim for each instance and one for the background, as
//! text (`.usda`) or as a binary "crate" file (`.usdc`) with the same prims.
//!
//! The layer: `/scene` turns the scene's up to +y. `/templates`, which is a class and not drawn, has a prim for each template
//! that is shown as it is; instances without offsets, Gaussians of their own and colour matrix are references to it. Every
//! other instance has its own arrays, in the template's frame. Transforms are those of instances, so an instance can be moved,
//! and each has its name as a semantic label (`semantics:labels:class`).
//!
//! Scales are linear and opacities from 0 to 1; SH coefficients are those of one Gaussian after the other, in the order of
//! 3DGS, and turn with the prim.

mod binary;
mod children;
mod layer;
#[cfg(test)]
mod tests;
mod text;

use std::path::Path;

use glam::DVec3;

use self::layer::{InFrames, Layer};
use crate::atomic_write;
use crate::error::{IoError, Place};
use crate::glb::up_to_y;
use instgs_vk::scene::instanced_scene::InstancedScene;

/// Writes a scene as `.usda`; `up` is the world direction that becomes +y, of any length but zero.
///
/// # Errors
/// An inconsistent scene, a value that is not finite, or a file that cannot be written.
pub fn write_usda(path: &Path, scene: &InstancedScene, up: DVec3) -> Result<(), IoError> {
    let in_frames = checked(path, scene)?;
    let layer = Layer::of(scene, &in_frames, turn(path, up)?);
    atomic_write(path, |out| text::write(out, &layer))
}

/// Writes a scene as `.usdc`: [`write_usda`]'s prims in fewer bytes.
///
/// # Errors
/// The same errors as [`write_usda`].
pub fn write_usdc(path: &Path, scene: &InstancedScene, up: DVec3) -> Result<(), IoError> {
    let in_frames = checked(path, scene)?;
    let layer = Layer::of(scene, &in_frames, turn(path, up)?);
    let bytes = binary::bytes(&layer).map_err(|what| fail(path, what))?;
    atomic_write(path, |out| out.write_all(&bytes))
}

fn fail(path: &Path, what: String) -> IoError {
    IoError::new(path, format!("cannot write: {what}")).advise("export to .instgs, which can hold it")
}

fn turn(path: &Path, up: DVec3) -> Result<glam::DMat3, IoError> {
    let lost = || IoError::new(path, "cannot write: the up direction has no length").advise("give another --up");
    up_to_y(up).ok_or_else(lost)
}

/// Every instance's Gaussians in its own frame, if all values of the scene can be written.
fn checked(path: &Path, scene: &InstancedScene) -> Result<InFrames, IoError> {
    scene.validate().map_err(|e| fail(path, e.reason).at(Place::Tensor(e.tensor)))?;
    let local = InFrames::of(scene);
    if let Some(i) = (0..local.cloud.len()).find(|&i| !local.cloud.is_finite(i)) {
        return Err(fail(path, format!("Gaussian {i} has a value that is not finite")));
    }
    let mut log_scales = local.cloud.log_scales.as_flattened().iter().chain(scene.templates.log_scales.as_flattened());
    if log_scales.any(|scale| !scale.exp().is_finite()) {
        return Err(fail(path, "a Gaussian is larger than a number can say".into()));
    }
    Ok(local)
}
