//! How many Gaussians of a plain cloud fit the bytes of an instanced scene: both as f16 `.instgs`.

use std::path::Path;

use instgs_io::scene_write::packed_scene_file_bytes;
use instgs_io::{IoError, Pack};
use instgs_vk::scene::gaussians::sh_coefficients;
use instgs_vk::scene::{Gaussians, InstancedScene};

/// Two numbers of Gaussians whose files are compared. The header's digits differ by a few bytes, which must be less than one for
/// each Gaussian.
const SAMPLES: [usize; 2] = [1 << 10, 1 << 11];

/// The largest number of Gaussians with which an f16 file of a plain cloud has at most `bytes`. The cloud `like` has the SH
/// degree and what else a file says of a scene; its own Gaussians do not matter.
///
/// # Errors
/// The cloud cannot be written.
pub(super) fn most_gaussians(bytes: u64, like: &InstancedScene) -> Result<u32, IoError> {
    let [few, more] = [file_bytes(SAMPLES[0], like)?, file_bytes(SAMPLES[1], like)?];
    let each = (more - few) / (SAMPLES[1] - SAMPLES[0]) as u64;
    // The header's length depends on the number, so that files are made until one fits and the next does not.
    let mut most = bytes / each;
    loop {
        let excess = file_bytes(most as usize, like)?.saturating_sub(bytes);
        if excess == 0 || most == 0 {
            break;
        }
        most -= excess.div_ceil(each).min(most);
    }
    while file_bytes(most as usize + 1, like)? <= bytes {
        most += 1;
    }
    Ok(u32::try_from(most).unwrap_or(u32::MAX))
}

/// Length of the f16 file of a plain cloud of `count` Gaussians.
fn file_bytes(count: usize, like: &InstancedScene) -> Result<u64, IoError> {
    let sh_degree = like.background.sh_degree;
    let background = Gaussians {
        means: vec![[0.0; 3]; count],
        quats: vec![[1.0, 0.0, 0.0, 0.0]; count],
        log_scales: vec![[0.0; 3]; count],
        opacity_logits: vec![0.0; count],
        sh_degree,
        sh: vec![[0.0; 3]; count * sh_coefficients(sh_degree)],
    };
    let scene = InstancedScene { background, ..like.clone() };
    Ok(packed_scene_file_bytes(&scene, Pack::F16, Path::new("a plain cloud"))?.len() as u64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use instgs_vk::scene::PixelFilter;

    /// One Gaussian more would not fit, and a .ply of the same bytes would hold about half of them.
    #[test]
    fn the_last_gaussian_that_fits_is_the_last() -> Result<(), IoError> {
        let degree = |sh_degree| InstancedScene::from_cloud(Gaussians::with_capacity(sh_degree, 0));
        let filter = PixelFilter { dilation_px2: 0.123_456, antialias: true };
        let mut filtered = InstancedScene { pixel_filter: filter, ..degree(3) };
        filtered.source = "a source with a name".into();
        for like in [degree(0), degree(3), filtered] {
            for bytes in [1 << 12, 1_234_567, 5_000_000] {
                let most = most_gaussians(bytes, &like)? as usize;
                let [fits, next] = [file_bytes(most, &like)?, file_bytes(most + 1, &like)?];
                assert!(fits <= bytes && bytes < next, "{bytes} bytes: {most} Gaussians have {fits}, one more {next}");
            }
        }
        let as_ply = 5_000_000 / instgs_io::ply::row_bytes(3);
        let ratio = f64::from(most_gaussians(5_000_000, &degree(3))?) / as_ply as f64;
        assert!((1.95..2.05).contains(&ratio), "{ratio}");
        assert_eq!(most_gaussians(10, &degree(3))?, 0);
        Ok(())
    }
}
