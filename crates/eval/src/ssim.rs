//! Structural similarity (Wang, Bovik, Sheikh, Simoncelli 2004) with the choices of the 3DGS code: Gaussian window, zero
//! padding, mean over every pixel and channel.

use rayon::prelude::*;

use crate::pair::PicturePair;

/// Half of the 11-pixel window.
const RADIUS: usize = 5;
const SIGMA_PX: f64 = 1.5;
/// (0.01 * range)^2 and (0.03 * range)^2 with the range 1.
const C1: f64 = 0.01 * 0.01;
const C2: f64 = 0.03 * 0.03;

/// Windowed sums of x, y, x^2, y^2 and xy.
type Moments = [f64; 5];

/// Mean SSIM, -1..=1, of all pixels and channels; 1 for equal pictures. The window is 11x11 with sigma 1.5; pixels
/// outside the picture are 0 in both pictures. Masked pixels hold the target in both and are part of the mean.
pub fn ssim(pair: &PicturePair) -> f64 {
    let (width, height) = (pair.width() as usize, pair.height() as usize);
    let window = window();
    let channel_sum = |channel: usize| {
        let rows = horizontal(pair, channel, &window);
        let sums: Vec<f64> = (0..height).into_par_iter().map(|y| row_sum(&rows, width, y, &window)).collect();
        // Summed row by row, so that the number of threads does not change the last bit.
        sums.iter().sum::<f64>()
    };
    (0..3).map(channel_sum).sum::<f64>() / (3 * width * height) as f64
}

/// The normalised 1D Gaussian; the 2D window is its outer product with itself.
fn window() -> [f64; 2 * RADIUS + 1] {
    let gauss = |i: usize| (-(i as f64 - RADIUS as f64).powi(2) / (2.0 * SIGMA_PX * SIGMA_PX)).exp();
    let raw: [f64; 2 * RADIUS + 1] = std::array::from_fn(gauss);
    let sum: f64 = raw.iter().sum();
    raw.map(|w| w / sum)
}

/// Moments of one channel under the horizontal window, for every pixel.
fn horizontal(pair: &PicturePair, channel: usize, window: &[f64]) -> Vec<Moments> {
    let width = pair.width() as usize;
    let mut out = vec![[0.0; 5]; pair.render().len()];
    let sources = pair.render().par_chunks(width).zip(pair.target().par_chunks(width));
    out.par_chunks_mut(width).zip(sources).for_each(|(out, (render, target))| {
        let products: Vec<Moments> = (render.iter().zip(target))
            .map(|(r, t)| (f64::from(r[channel]), f64::from(t[channel])))
            .map(|(x, y)| [x, y, x * x, y * y, x * y])
            .collect();
        for (i, sum) in out.iter_mut().enumerate() {
            *sum = weighted(i, width, window, |j| &products[j]);
        }
    });
    out
}

/// The sum of SSIM over row `y`.
fn row_sum(rows: &[Moments], width: usize, y: usize, window: &[f64]) -> f64 {
    let height = rows.len() / width;
    (0..width).map(|x| similarity(weighted(y, height, window, |j| &rows[j * width + x]))).sum()
}

/// The sum under the window around position `center` of a line of `len` positions; positions outside count as 0.
fn weighted<'a>(center: usize, len: usize, window: &[f64], at: impl Fn(usize) -> &'a Moments) -> Moments {
    let mut sum = [0.0; 5];
    for j in center.saturating_sub(RADIUS)..(center + RADIUS + 1).min(len) {
        let weight = window[j + RADIUS - center];
        for (s, v) in sum.iter_mut().zip(at(j)) {
            *s += weight * v;
        }
    }
    sum
}

fn similarity([x, y, xx, yy, xy]: Moments) -> f64 {
    let (var_x, var_y, cov) = (xx - x * x, yy - y * y, xy - x * y);
    (2.0 * x * y + C1) * (2.0 * cov + C2) / ((x * x + y * y + C1) * (var_x + var_y + C2))
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use npyz::npz::NpzArchive;

    use super::*;
    use crate::psnr::psnr;
    use instgs_vk::math::rng::Rng;

    type Outcome = Result<(), Box<dyn std::error::Error>>;

    fn noise(seed: u64, pixels: usize) -> Vec<[f32; 3]> {
        let mut rng = Rng::new(seed);
        (0..pixels).map(|_| [0; 3].map(|_| rng.uniform() as f32)).collect()
    }

    /// The definition of SSIM, pixel by pixel over the 2D window.
    fn direct(pair: &PicturePair) -> f64 {
        let (width, height, window) = (pair.width() as i64, pair.height() as i64, window());
        let mut sum = 0.0;
        for (y, x, c) in (0..height).flat_map(|y| (0..width).flat_map(move |x| (0..3).map(move |c| (y, x, c)))) {
            let mut moments = [0.0; 5];
            for (dy, dx) in (-5..=5i64).flat_map(|dy| (-5..=5i64).map(move |dx| (dy, dx))) {
                if (0..width).contains(&(x + dx)) && (0..height).contains(&(y + dy)) {
                    let at = ((y + dy) * width + x + dx) as usize;
                    let (r, t) = (f64::from(pair.render()[at][c]), f64::from(pair.target()[at][c]));
                    let weight = window[(dy + 5) as usize] * window[(dx + 5) as usize];
                    for (m, v) in moments.iter_mut().zip([r, t, r * r, t * t, r * t]) {
                        *m += weight * v;
                    }
                }
            }
            sum += similarity(moments);
        }
        sum / (3 * width * height) as f64
    }

    #[test]
    fn agrees_with_the_definition_also_on_pictures_smaller_than_the_window() -> Outcome {
        for size in [(1, 1), (3, 2), (1, 17), (23, 14)] {
            let pixels = (size.0 * size.1) as usize;
            let pair = PicturePair::new(size, &noise(1, pixels), &noise(2, pixels), None)?;
            // Measured: 1.4e-16.
            assert!((ssim(&pair) - direct(&pair)).abs() < 1e-14, "{size:?}: {} {}", ssim(&pair), direct(&pair));
            let equal = PicturePair::new(size, &noise(1, pixels), &noise(1, pixels), None)?;
            assert!((ssim(&equal) - 1.0).abs() < 1e-14);
        }
        Ok(())
    }

    #[test]
    fn masked_pixels_count_as_equal() -> Outcome {
        let (render, target) = (noise(1, 400), noise(2, 400));
        let left: Vec<bool> = (0..400).map(|i| i % 20 < 10).collect();
        let masked = ssim(&PicturePair::new((20, 20), &render, &target, Some(&left))?);
        let blended: Vec<_> = (0..400).map(|i| if left[i] { render[i] } else { target[i] }).collect();
        assert_eq!(masked, ssim(&PicturePair::new((20, 20), &blended, &target, None)?));
        assert!(masked > ssim(&PicturePair::new((20, 20), &render, &target, None)?) + 0.2);
        Ok(())
    }

    /// An independent implementation's pictures and figures (tests/fixtures/golden/README.md).
    #[test]
    fn agrees_with_the_golden_file() -> Outcome {
        let file = include_bytes!("../../../tests/fixtures/golden/loss_l1_dssim.npz");
        let mut archive = NpzArchive::new(Cursor::new(&file[..]))?;
        for (case, size) in [("a", (64, 48)), ("b", (57, 33))] {
            let picture = |archive: &mut _, name: &str| -> Result<Vec<[f32; 3]>, Box<dyn std::error::Error>> {
                let values: Vec<f32> = read(archive, &format!("{case}_{name}"))?.iter().map(|&v| v as f32).collect();
                Ok(values.as_chunks::<3>().0.to_vec())
            };
            let (render, target) = (picture(&mut archive, "image")?, picture(&mut archive, "target")?);
            let pair = PicturePair::new(size, &render, &target, None)?;
            let (want_ssim, want_psnr) =
                (read(&mut archive, &format!("{case}_ssim_same"))?[0], read(&mut archive, &format!("{case}_psnr"))?[0]);
            // Measured: 7e-16 and 2.5e-14 dB.
            let (ssim_error, psnr_error) = ((ssim(&pair) - want_ssim).abs(), (psnr(&pair) - want_psnr).abs());
            assert!(ssim_error < 1e-12 && psnr_error < 1e-10, "{case}: {ssim_error:e} {psnr_error:e}");
            // The file's values for the other border rule must not agree.
            let valid_rule = read(&mut archive, &format!("{case}_ssim_valid"))?[0];
            assert!((ssim(&pair) - valid_rule).abs() > 1e-4);
        }
        Ok(())
    }

    fn read(archive: &mut NpzArchive<Cursor<&[u8]>>, name: &str) -> Result<Vec<f64>, Box<dyn std::error::Error>> {
        Ok(archive.by_name(name)?.ok_or(format!("no array {name}"))?.into_vec::<f64>()?)
    }
}
