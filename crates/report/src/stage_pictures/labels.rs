//! The plain cloud in the colours of its objects.

use super::colors::{Colors, luminance};
use instgs_vk::math::sh::SH_C0;
use instgs_vk::scene::Gaussians;

/// Brightness of a colour where the cloud's own Gaussians are black (`darkest`), and how much it rises towards white.
#[derive(Clone, Copy)]
struct Shades {
    darkest: f32,
    rise: f32,
}

/// Shades of objects, in which shapes stay visible and colours cannot be confused.
const OBJECT_SHADES: Shades = Shades { darkest: 0.5, rise: 0.5 };
/// Shades of the grey background.
const BACKGROUND_SHADES: Shades = Shades { darkest: 0.16, rise: 0.5 };

/// The cloud without view-dependent colour: every object in its colour, everything else grey.
pub(super) fn colored(cloud: &Gaussians, labels: &[u32], colors: &Colors) -> Gaussians {
    repainted(cloud, |i, shade| match labels.get(i).and_then(|&id| colors.of(id)) {
        Some(color) => shaded(color, OBJECT_SHADES, shade),
        None => shaded([255; 3], BACKGROUND_SHADES, shade),
    })
}

/// A cloud in one colour, without view-dependent colour.
pub(super) fn tinted(cloud: &Gaussians, color: [u8; 3]) -> Gaussians {
    repainted(cloud, |_, shade| shaded(color, OBJECT_SHADES, shade))
}

/// The base colour of a Gaussian, each channel in 0..=1.
pub(super) fn base_color(cloud: &Gaussians, i: usize) -> [f32; 3] {
    cloud.sh_of(i)[0].map(|c| (0.5 + SH_C0 as f32 * c).clamp(0.0, 1.0))
}

/// The cloud with new colours (0..=1), computed from the index and the brightness of every Gaussian.
fn repainted(cloud: &Gaussians, color: impl Fn(usize, f32) -> [f32; 3]) -> Gaussians {
    let sh = (0..cloud.len()).map(|i| color(i, luminance(base_color(cloud, i))).map(|c| (c - 0.5) / SH_C0 as f32));
    Gaussians {
        sh_degree: 0,
        sh: sh.collect(),
        means: cloud.means.clone(),
        quats: cloud.quats.clone(),
        log_scales: cloud.log_scales.clone(),
        opacity_logits: cloud.opacity_logits.clone(),
    }
}

fn shaded(color: [u8; 3], Shades { darkest, rise }: Shades, shade: f32) -> [f32; 3] {
    color.map(|c| f32::from(c) / 255.0 * (darkest + rise * shade))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn objects_have_their_colour_and_the_rest_is_grey() {
        let mut cloud = Gaussians::with_capacity(1, 3);
        for bright in [-1.0f32, 1.0, 1.0] {
            cloud.means.push([0.0; 3]);
            cloud.quats.push([1.0, 0.0, 0.0, 0.0]);
            cloud.log_scales.push([0.0; 3]);
            cloud.opacity_logits.push(2.0);
            cloud.sh.extend([[bright * 0.5 / SH_C0 as f32; 3], [9.0; 3], [9.0; 3], [9.0; 3]]);
        }
        let colors = Colors::of_ids([4, 7]);
        let out = colored(&cloud, &[7, 7, 0], &colors);
        assert_eq!((out.sh_degree, out.sh.len(), &out.means), (0, 3, &cloud.means));
        let color = |i| base_color(&out, i);
        let close = |a: [f32; 3], b: [f32; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-5);
        let own = colors.of(7).unwrap().map(|c| f32::from(c) / 255.0);
        assert!(close(color(1), own), "a white Gaussian shows the colour as it is");
        assert!(close(color(0), own.map(|c| 0.5 * c)), "{:?}", color(0));
        let [r, g, b] = color(2);
        assert!(r == g && g == b && r > 0.5, "grey");
        assert!(close(base_color(&tinted(&cloud, colors.of(7).unwrap()), 1), own));
    }
}
