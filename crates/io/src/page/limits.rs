//! How large a scene a browser draws: the page keeps a scene in textures of a fixed width, whose height the device bounds.

use instgs_vk::scene::InstancedScene;
use instgs_vk::scene::gaussians::sh_coefficients;

/// Width of the page's textures, texels (`web/layout.js`).
const TEXTURE_WIDTH: u64 = 2048;
/// Texels of a Gaussian's mean, opacity, rotation and size (`web/layout.js`).
const GEOMETRY_TEXELS: u64 = 3;
/// Height that nearly all devices have; some phones have a half or a quarter of it.
const USUAL_HEIGHT: u64 = 16_384;

/// What decides about the height of a scene's textures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct TextureNeeds {
    /// Source Gaussians: each is stored once, however many instances show it.
    stored: u64,
    /// Gaussians with every instance written out.
    expanded: u64,
    /// SH coefficients of a Gaussian.
    coefficients: u64,
    /// Offset records.
    records: u64,
    /// Texels of each of them.
    record_texels: u64,
}

impl TextureNeeds {
    fn of(scene: &InstancedScene) -> Self {
        let clouds = [&scene.templates, &scene.own, &scene.background];
        let degree = clouds.iter().filter(|cloud| !cloud.is_empty()).map(|cloud| cloud.sh_degree).max();
        let coefficients = sh_coefficients(degree.unwrap_or(0)) as u64;
        let offsets = &scene.offsets;
        let shape = if offsets.quats.is_empty() && offsets.log_scales.is_empty() { 0 } else { 2 };
        let rest = if offsets.sh_rest.is_empty() { 0 } else { coefficients - 1 };
        Self {
            stored: scene.source_len() as u64,
            expanded: scene.expanded_len(),
            coefficients,
            records: offsets.means.len() as u64,
            record_texels: 2 + shape + rest,
        }
    }

    /// Lines of the highest texture, with the number of Gaussians (or of offset records) that would just fit `USUAL_HEIGHT`.
    fn highest(self) -> (u64, u64, &'static str) {
        // Two coefficients share a texel, as half floats.
        let of_source = GEOMETRY_TEXELS.max(self.coefficients.div_ceil(2));
        let all = [
            (self.stored, of_source, "Gaussians"),
            (self.expanded, 1, "Gaussians, instances written out,"),
            (self.records, self.record_texels.max(1), "offset records"),
        ];
        let lines = |(count, texels, what): (u64, u64, _)| {
            ((count * texels).div_ceil(TEXTURE_WIDTH), USUAL_HEIGHT * TEXTURE_WIDTH / texels, what)
        };
        all.map(lines).into_iter().max_by_key(|(lines, ..)| *lines).unwrap_or_default()
    }
}

/// What most browsers cannot show of a scene, in words for the user; `None` if they can show it.
pub(crate) fn too_large_note(scene: &InstancedScene) -> Option<String> {
    note_of(TextureNeeds::of(scene))
}

fn note_of(needs: TextureNeeds) -> Option<String> {
    let (lines, most, what) = needs.highest();
    (lines > USUAL_HEIGHT).then(|| {
        format!(
            "most browsers show this page only with WebGPU: with WebGL2, textures of {USUAL_HEIGHT} lines hold {most} {what} of \
             SH degree {}, and this scene takes {lines} lines; prune it for others (instgs-vk prune)",
            needs.coefficients.isqrt() - 1
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scenes_that_most_browsers_cannot_show_are_named() {
        let cloud = |count, coefficients| TextureNeeds {
            stored: count,
            expanded: count,
            coefficients,
            record_texels: 2,
            ..TextureNeeds::default()
        };
        // 8 texels of SH a Gaussian at degree 3; 3 of geometry where there is less SH.
        for (coefficients, most) in [(16, 4_194_304), (9, 6_710_886), (4, 11_184_810), (1, 11_184_810)] {
            assert_eq!(note_of(cloud(most, coefficients)), None, "{coefficients}");
            let note = note_of(cloud(most + 1, coefficients)).unwrap_or_default();
            assert!(note.contains(&format!("{most} Gaussians of")) && note.contains("16385 lines"), "{note}");
        }
        let instanced = TextureNeeds { expanded: 40_000_000, ..cloud(1000, 16) };
        assert!(note_of(instanced).is_some_and(|note| note.contains("33554432 Gaussians, instances written out, of")));
        let offsets = TextureNeeds { records: 2_000_000, record_texels: 19, ..cloud(1000, 16) };
        assert!(note_of(offsets).is_some_and(|note| note.contains("1766022 offset records")));
    }

    #[test]
    fn needs_are_those_of_the_scene() {
        let scene = instgs_samples::with_ablations();
        let needs = TextureNeeds { stored: 9, expanded: 14, coefficients: 16, records: 8, record_texels: 19 };
        assert_eq!(TextureNeeds::of(&scene), needs);
        let plain = TextureNeeds { coefficients: 16, record_texels: 2, ..needs };
        assert_eq!(TextureNeeds::of(&instgs_samples::sample_scene()), plain);
        assert_eq!(too_large_note(&scene), None);
    }

    #[test]
    fn the_page_counts_the_same() {
        let layout = include_str!("../../web/layout.js");
        assert!(layout.contains(&format!("TEXTURE_WIDTH = {TEXTURE_WIDTH};")));
        assert!(layout.contains(&format!("GEOMETRY_TEXELS = {GEOMETRY_TEXELS};")));
    }
}
