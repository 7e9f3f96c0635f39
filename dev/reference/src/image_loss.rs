//! Twin of pass `image_loss`: (1 - w) L1 + w (1 - SSIM) of an image against a target, and its gradient.
//!
//! 3DGS Eq. 7. SSIM is that of Wang et al. 2004, Eq. 13, with a Gaussian window of 11x11 pixels, sigma 1.5, per
//! channel; pixels outside the image count as 0. Both means, of SSIM and of L1, are over all pixels and channels.

use rayon::prelude::*;

/// Number of pixels on either side of the window's centre.
pub const WINDOW_RADIUS: usize = 5;
/// Standard deviation of the window, px.
pub const WINDOW_SIGMA: f64 = 1.5;
/// SSIM's stabiliser of the means, (0.01 L)^2 with L = 1.
pub const SSIM_C1: f64 = 0.01 * 0.01;
/// SSIM's stabiliser of the variances, (0.03 L)^2 with L = 1.
pub const SSIM_C2: f64 = 0.03 * 0.03;

/// The image loss, its two terms, and its gradient.
#[derive(Clone, Debug, PartialEq)]
pub struct ImageLoss {
    /// Mean absolute difference over pixels and channels.
    pub l1: f64,
    /// Mean SSIM over pixels and channels.
    pub ssim: f64,
    /// The loss (1 - w) l1 + w (1 - ssim).
    pub loss: f64,
    /// dloss / dimage, per pixel and channel, row by row. The derivative of |x| at 0 is taken as 0.
    pub gradient: Vec<[f64; 3]>,
}

/// Two images of equal size, row by row, rgb.
#[derive(Clone, Copy, Debug)]
pub struct ImagePair<'a> {
    /// Width of both images, px.
    pub width: usize,
    /// Height of both images, px.
    pub height: usize,
    /// The image that the gradient is for.
    pub image: &'a [[f64; 3]],
    /// The image it is compared with.
    pub target: &'a [[f64; 3]],
    /// Pixels that count as equal to the target whatever the image holds, and get no gradient; means are still over all
    /// pixels. `None` if no pixel is ignored.
    pub ignored: Option<&'a [bool]>,
}

/// Colours of the image from this value on, and NaN, count as this value: one bad pixel must not spread.
pub const LARGEST_COLOR: f64 = 100.0;

fn counted(color: f64) -> f64 {
    if color.abs() < LARGEST_COLOR { color } else { LARGEST_COLOR }
}

/// SSIM of one channel and its derivative.
struct SsimSums {
    /// Sum of SSIM over the pixels.
    sum: f64,
    /// Derivative of that sum with respect to the image.
    gradient: Vec<f64>,
}

/// Loss and gradient; `ssim_weight` is w in 0..=1.
pub fn image_loss(images: &ImagePair, ssim_weight: f64) -> ImageLoss {
    image_loss_at(images, ssim_weight, WINDOW_SIGMA)
}

/// Like [`image_loss`], with a window of another standard deviation, px: tests plant a wrong one.
pub fn image_loss_at(images: &ImagePair, ssim_weight: f64, sigma: f64) -> ImageLoss {
    let weights = window_weights(sigma);
    let pixels = images.width * images.height;
    assert_eq!((images.image.len(), images.target.len()), (pixels, pixels), "both images have width * height pixels");
    let ignored = |p: usize| images.ignored.is_some_and(|mask| mask[p]);
    let count = (3 * pixels) as f64;
    let (mut l1, mut ssim) = (0.0, 0.0);
    let mut gradient = vec![[0.0; 3]; pixels];
    for channel in 0..3 {
        let target: Vec<f64> = images.target.iter().map(|rgb| rgb[channel]).collect();
        let image: Vec<f64> =
            (0..pixels).map(|p| if ignored(p) { target[p] } else { counted(images.image[p][channel]) }).collect();
        let structure = ssim_sums(&weights, &image, &target, images.width, images.height);
        ssim += structure.sum / count;
        for p in 0..pixels {
            let difference = image[p] - target[p];
            l1 += difference.abs() / count;
            let d_l1 = if difference == 0.0 { 0.0 } else { difference.signum() };
            if !ignored(p) {
                gradient[p][channel] = ((1.0 - ssim_weight) * d_l1 - ssim_weight * structure.gradient[p]) / count;
            }
        }
    }
    ImageLoss { l1, ssim, loss: (1.0 - ssim_weight) * l1 + ssim_weight * (1.0 - ssim), gradient }
}

/// SSIM of channel `x` against `y`: S = (2 mx my + C1)(2 sxy + C2) / ((mx^2 + my^2 + C1)(sxx + syy + C2)) with windowed
/// means m and (co)variances s = mean of products - product of means.
fn ssim_sums(weights: &[f64], x: &[f64], y: &[f64], width: usize, height: usize) -> SsimSums {
    let products = |a: &[f64], b: &[f64]| -> Vec<f64> { a.iter().zip(b).map(|(a, b)| a * b).collect() };
    let window = |values: &[f64]| windowed(weights, values, width, height);
    let (mean_x, mean_y) = (window(x), window(y));
    let (mean_xx, mean_yy, mean_xy) = (window(&products(x, x)), window(&products(y, y)), window(&products(x, y)));
    let mut sum = 0.0;
    // Derivatives of the sum with respect to mean_x, mean_xx and mean_xy at every pixel.
    let mut by = [const { Vec::new() }; 3];
    for p in 0..x.len() {
        let (mx, my) = (mean_x[p], mean_y[p]);
        let means = [2.0 * mx * my + SSIM_C1, mx * mx + my * my + SSIM_C1];
        let variances = [2.0 * (mean_xy[p] - mx * my) + SSIM_C2, mean_xx[p] - mx * mx + mean_yy[p] - my * my + SSIM_C2];
        let ssim = means[0] * variances[0] / (means[1] * variances[1]);
        sum += ssim;
        let by_xx = -ssim / variances[1];
        let by_xy = 2.0 * means[0] / (means[1] * variances[1]);
        let by_means = 2.0 * my * variances[0] / (means[1] * variances[1]) - 2.0 * mx * ssim / means[1];
        by[0].push(by_means - 2.0 * mx * by_xx - my * by_xy);
        by[1].push(by_xx);
        by[2].push(by_xy);
    }
    // The window is symmetric and the border counts as 0, so the adjoint of windowing is windowing itself.
    let [by_x, by_xx, by_xy] = by.map(|values| window(&values));
    let gradient = (0..x.len()).map(|p| by_x[p] + 2.0 * x[p] * by_xx[p] + y[p] * by_xy[p]).collect();
    SsimSums { sum, gradient }
}

/// The window's weights along one axis; they sum to 1.
pub fn window_weights(sigma: f64) -> [f64; 2 * WINDOW_RADIUS + 1] {
    let bell: [f64; 2 * WINDOW_RADIUS + 1] = std::array::from_fn(|i| {
        let d = i as f64 - WINDOW_RADIUS as f64;
        (-d * d / (2.0 * sigma * sigma)).exp()
    });
    let sum: f64 = bell.iter().sum();
    bell.map(|v| v / sum)
}

/// Windowed mean around every pixel, zeros outside the image: along rows, then columns, since the window is separable.
fn windowed(weights: &[f64], values: &[f64], width: usize, height: usize) -> Vec<f64> {
    let across: Vec<f64> = (0..width * height)
        .into_par_iter()
        .map(|p| weighted(weights, p % width, width, |x| values[p / width * width + x]))
        .collect();
    (0..width * height)
        .into_par_iter()
        .map(|p| weighted(weights, p / width, height, |y| across[y * width + p % width]))
        .collect()
}

/// Sum of weight * value over the positions of 0..`end` within the window around `center`.
fn weighted(weights: &[f64], center: usize, end: usize, value: impl Fn(usize) -> f64) -> f64 {
    let first = center.saturating_sub(WINDOW_RADIUS);
    (first..end.min(center + WINDOW_RADIUS + 1)).map(|at| weights[at + WINDOW_RADIUS - center] * value(at)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use instgs_vk::math::rng::Rng;

    const SIZE: (usize, usize) = (13, 12);

    fn noise(rng: &mut Rng) -> Vec<[f64; 3]> {
        (0..SIZE.0 * SIZE.1).map(|_| [rng.uniform(), rng.uniform(), rng.uniform()]).collect()
    }

    fn pair<'a>(image: &'a [[f64; 3]], target: &'a [[f64; 3]], ignored: Option<&'a [bool]>) -> ImagePair<'a> {
        ImagePair { width: SIZE.0, height: SIZE.1, image, target, ignored }
    }

    /// Largest difference between gradient and central differences, relative to the largest entry; `spoil` is the
    /// factor on the gradient of channel 1.
    fn worst_error(ssim_weight: f64, masked: bool, spoil: f64) -> f64 {
        let mut rng = Rng::new(4);
        let (image, target) = (noise(&mut rng), noise(&mut rng));
        let mask: Vec<bool> = image.iter().map(|_| masked && rng.chance(0.3)).collect();
        let loss = |image: &[[f64; 3]]| image_loss(&pair(image, &target, Some(&mask)), ssim_weight);
        let gradient = loss(&image).gradient;
        let largest = gradient.as_flattened().iter().fold(0.0, |m: f64, v| m.max(v.abs()));
        let step = 1e-5;
        let mut worst: f64 = 0.0;
        for p in 0..image.len() {
            for channel in 0..3 {
                let side = |step: f64| {
                    let mut moved = image.clone();
                    moved[p][channel] += step;
                    loss(&moved).loss
                };
                let want = (side(step) - side(-step)) / (2.0 * step);
                let got = gradient[p][channel] * if channel == 1 { spoil } else { 1.0 };
                worst = worst.max((got - want).abs() / largest);
            }
        }
        worst
    }

    /// Gradients agree with differences. Measured: 2.4e-9; with a channel off by a thousandth 6e-4.
    #[test]
    fn gradients_agree_with_differences() {
        for (weight, masked) in [(0.0, false), (0.2, false), (1.0, false), (0.2, true)] {
            let worst = worst_error(weight, masked, 1.0);
            assert!(worst < 1e-6, "{weight} {masked}: {worst:e}");
        }
        assert!(worst_error(0.2, false, 1.001) > 1e-4, "a planted error is not seen");
    }

    /// Equal images have loss 0. Measured: 0 except for the gradient of SSIM at its maximum, which cancels to rounding.
    #[test]
    fn equal_images_cost_nothing() {
        let image = noise(&mut Rng::new(5));
        let loss = image_loss(&pair(&image, &image, None), 0.2);
        assert!((loss.l1, loss.ssim) == (0.0, 1.0) && loss.loss.abs() < 1e-15, "{loss:?}");
        assert!(loss.gradient.as_flattened().iter().all(|v| v.abs() < 1e-15));
    }

    /// A NaN in an ignored pixel must not spread, and the result must not depend on the ignored value.
    #[test]
    fn ignored_pixels_are_as_the_target() {
        let mut rng = Rng::new(6);
        let (mut image, target) = (noise(&mut rng), noise(&mut rng));
        let mask: Vec<bool> = (0..image.len()).map(|p| p % 5 == 0).collect();
        (0..image.len()).filter(|p| mask[*p]).for_each(|p| image[p] = [f64::NAN; 3]);
        let got = image_loss(&pair(&image, &target, Some(&mask)), 0.2);
        (0..image.len()).filter(|p| mask[*p]).for_each(|p| image[p] = target[p]);
        let want = image_loss(&pair(&image, &target, None), 0.2);
        assert_eq!((got.l1, got.ssim, got.loss), (want.l1, want.ssim, want.loss));
        for (p, (got, want)) in got.gradient.iter().zip(&want.gradient).enumerate() {
            assert_eq!(*got, if mask[p] { [0.0; 3] } else { *want });
        }
    }
}
