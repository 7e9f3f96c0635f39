//! Reader of the golden files: pictures and gradients of an independent f64 implementation.
//!
//! `tests/fixtures/golden` holds the files that every test run reads; its README has their arrays and conventions. The
//! larger files are in `../shared/golden`, and the tests that read them are ignored ones in modules named
//! `shared_golden`, which `tools/test` runs where that folder is at hand.

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use glam::DVec3;
use instgs_reference::RenderOptions;
use instgs_reference::gather_gradients::CloudGradient;
use instgs_reference::preprocess_instance_expand::SourceGaussian;
use instgs_vk::math::covariance::logit;
use instgs_vk::math::sh::widened;
use instgs_vk::math::similarity::Similarity;
use instgs_vk::scene::gaussians::sh_coefficients;
use instgs_vk::scene::{Camera, Gaussians, InstancedScene};
use npyz::npz::NpzArchive;

/// One file: a plain cloud and its cameras with the expected results.
pub(crate) struct GoldenCase {
    /// File name without extension.
    pub(crate) name: String,
    /// Background-only scene; ln(scale) and logit(opacity) rounded to f32.
    pub(crate) scene: InstancedScene,
    /// The same Gaussians with ln(scale) and logit(opacity) in f64.
    pub(crate) sources: Vec<SourceGaussian>,
    /// All cameras of the file.
    pub(crate) views: Vec<GoldenView>,
    /// Gradient by the parameters in `sources`, summed over the cameras; converted from the file's linear scales and
    /// opacities to their logarithms and logits.
    pub(crate) gradient: CloudGradient,
}

/// One camera with what it should see.
pub(crate) struct GoldenView {
    /// The camera; all values are f32 values.
    pub(crate) camera: Camera,
    /// Near, dilation, compensation, background.
    pub(crate) options: RenderOptions,
    /// rgb over the background, per pixel.
    pub(crate) color: Vec<[f64; 3]>,
    /// 1 - T per pixel.
    pub(crate) alpha: Vec<[f64; 1]>,
    /// False where f32 may differ.
    pub(crate) robust: Vec<bool>,
    /// Splats blended per pixel.
    pub(crate) n_contrib: Vec<u32>,
    /// False where the generator culled the Gaussian: its values below mean nothing then.
    pub(crate) visible: Vec<bool>,
    /// Centres, px, per Gaussian.
    pub(crate) means_px: Vec<[f64; 2]>,
    /// View depth per Gaussian.
    pub(crate) depths: Vec<f64>,
    /// (a, b, c) per Gaussian.
    pub(crate) conics: Vec<[f64; 3]>,
    /// Clamped SH colour per Gaussian.
    pub(crate) colors: Vec<[f64; 3]>,
    /// Opacity, compensated if antialiased, per Gaussian.
    pub(crate) opacities: Vec<f64>,
    /// dL/d(r, g, b, alpha) per pixel; 0 where not robust.
    pub(crate) cotangents: Vec<[f64; 4]>,
    /// dL / d centre, per px, per Gaussian; 0 if culled, as are the next two.
    pub(crate) grad_means_px: Vec<[f64; 2]>,
    /// dL / d(a, b, c), b counted once, per Gaussian.
    pub(crate) grad_conics: Vec<[f64; 3]>,
    /// dL / d clamped colour per Gaussian.
    pub(crate) grad_colors: Vec<[f64; 3]>,
}

/// The two image pairs of `loss_l1_dssim.npz` with the loss 0.8 L1 + 0.2 (1 - SSIM).
pub(crate) struct GoldenLoss {
    /// px.
    pub(crate) width: usize,
    /// px.
    pub(crate) height: usize,
    /// What is judged, row by row.
    pub(crate) image: Vec<[f64; 3]>,
    /// What it should be.
    pub(crate) target: Vec<[f64; 3]>,
    /// Mean absolute difference.
    pub(crate) l1: f64,
    /// Mean SSIM, zero padding.
    pub(crate) ssim: f64,
    /// The loss.
    pub(crate) loss: f64,
    /// dloss / dimage.
    pub(crate) gradient: Vec<[f64; 3]>,
}

/// The rendering cases in the repository.
const COMMITTED: [&str; 5] = ["aa_200g_deg3", "bg_offcentre_120g_deg2", "few_8g_deg1", "opaque_150g_deg3", "single_1g"];

/// The rendering cases of `../shared/golden` that are too large for the repository.
const SHARED: [&str; 5] =
    ["basic_200g_deg3", "basic_50g_deg3", "dense_500g_deg3", "frustum_300g_deg3", "tiny_huge_200g_deg3"];

/// A folder given relative to the repository.
fn folder(relative: &str) -> PathBuf {
    crate::common::repository().join(relative)
}

/// The rendering cases in the repository; 9 views in all. Fails if a file is missing.
pub(crate) fn golden_cases() -> Vec<GoldenCase> {
    cases(&folder("tests/fixtures/golden"), COMMITTED)
}

/// The larger rendering cases of `../shared/golden`; 12 views in all. Fails if a file is missing.
pub(crate) fn shared_golden_cases() -> Vec<GoldenCase> {
    cases(&folder("../shared/golden"), SHARED)
}

fn cases(folder: &Path, names: [&str; 5]) -> Vec<GoldenCase> {
    names.iter().map(|name| read_case(&folder.join(format!("{name}.npz")))).collect()
}

/// The image pairs in the repository. Fails if the file is missing.
pub(crate) fn golden_losses() -> Vec<GoldenLoss> {
    let mut arrays = Arrays::open(&folder("tests/fixtures/golden/loss_l1_dssim.npz"));
    let read = |(pair, width, height): (&str, usize, usize)| GoldenLoss {
        width,
        height,
        image: arrays.rows(&format!("{pair}_image")),
        target: arrays.rows(&format!("{pair}_target")),
        l1: arrays.scalar(&format!("{pair}_l1")),
        ssim: arrays.scalar(&format!("{pair}_ssim_same")),
        loss: arrays.scalar(&format!("{pair}_loss_same")),
        gradient: arrays.rows(&format!("{pair}_grad_same")),
    };
    [("a", 64, 48), ("b", 57, 33)].map(read).into()
}

/// An open file; every array is read as f64, whatever its stored type.
struct Arrays {
    archive: NpzArchive<BufReader<File>>,
}

impl Arrays {
    fn open(path: &Path) -> Self {
        let archive = NpzArchive::open(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        Self { archive }
    }

    fn read(&mut self, name: &str) -> Vec<f64> {
        let file = self.archive.by_name(name).unwrap().unwrap_or_else(|| panic!("no array {name}"));
        let type_text = file.dtype().descr();
        match type_text.trim_matches('\'') {
            "<f8" => file.into_vec::<f64>().unwrap(),
            "<i8" => file.into_vec::<i64>().unwrap().into_iter().map(|v| v as f64).collect(),
            "<i4" => file.into_vec::<i32>().unwrap().into_iter().map(f64::from).collect(),
            "|b1" => file.into_vec::<bool>().unwrap().into_iter().map(|v| f64::from(u8::from(v))).collect(),
            other => panic!("array {name} has type {other}"),
        }
    }

    fn scalar(&mut self, name: &str) -> f64 {
        self.read(name)[0]
    }

    fn rows<const C: usize>(&mut self, name: &str) -> Vec<[f64; C]> {
        self.read(name).as_chunks::<C>().0.to_vec()
    }
}

fn f32s<const C: usize>(row: &[f64; C]) -> [f32; C] {
    row.map(|v| v as f32)
}

fn read_case(path: &Path) -> GoldenCase {
    let mut arrays = Arrays::open(path);
    let name = path.file_stem().unwrap().to_string_lossy().into_owned();
    let (scales, opacities) = (arrays.rows::<3>("scales"), arrays.read("opacities"));
    let sh_degree = arrays.scalar("sh_degree") as u32;
    let kept = sh_coefficients(sh_degree);
    let sh = arrays.rows::<3>("sh");
    let cloud = Gaussians {
        sh_degree,
        means: arrays.rows::<3>("means").iter().map(f32s).collect(),
        quats: arrays.rows::<4>("quats").iter().map(f32s).collect(),
        log_scales: scales.iter().map(|row| row.map(|v| v.ln() as f32)).collect(),
        opacity_logits: opacities.iter().map(|&p| logit(p) as f32).collect(),
        sh: sh.as_chunks::<16>().0.iter().flat_map(|all| all[..kept].iter().map(f32s)).collect(),
    };
    let sources = (0..cloud.len()).map(|i| exact_source(&cloud, i, scales[i], opacities[i])).collect();
    let views = read_views(&mut arrays, &name, cloud.len());
    let gradient = read_gradient(&mut arrays, sh_degree, &scales, &opacities);
    GoldenCase { name, scene: InstancedScene::from_cloud(cloud), sources, views, gradient }
}

fn read_gradient(arrays: &mut Arrays, sh_degree: u32, scales: &[[f64; 3]], opacities: &[f64]) -> CloudGradient {
    let by_scale = arrays.rows::<3>("grad_scales");
    let by_opacity = arrays.read("grad_opacities");
    let by_sh = arrays.rows::<3>("grad_sh");
    let kept = sh_coefficients(sh_degree);
    CloudGradient {
        sh_degree,
        means: arrays.rows("grad_means"),
        quats: arrays.rows("grad_quats"),
        log_scales: by_scale.iter().zip(scales).map(|(g, s)| std::array::from_fn(|i| g[i] * s[i])).collect(),
        opacity_logits: by_opacity.iter().zip(opacities).map(|(g, o)| g * o * (1.0 - o)).collect(),
        sh: by_sh.as_chunks::<16>().0.iter().flat_map(|all| all[..kept].to_vec()).collect(),
    }
}

/// Gaussian `i` with the scale and opacity of the file, not their rounded logarithms.
fn exact_source(cloud: &Gaussians, i: usize, scale: [f64; 3], opacity: f64) -> SourceGaussian {
    SourceGaussian {
        flat_index: i as u32,
        instance: 0,
        local_index: i as u32,
        mean_template: widened(cloud.means[i]),
        quat: cloud.quats[i].map(f64::from),
        log_scales: DVec3::from_array(scale.map(f64::ln)),
        opacity_logit: logit(opacity),
        sh: cloud.sh_of(i).iter().map(|&c| widened(c)).collect(),
        sh_degree: cloud.sh_degree,
        world_from_template: Similarity::IDENTITY,
        color_from_template: None,
    }
}

/// The `index`-th of equal runs of `len` values.
fn part<T: Clone>(all: &[T], index: usize, len: usize) -> Vec<T> {
    all[index * len..(index + 1) * len].to_vec()
}

fn read_views(arrays: &mut Arrays, case: &str, gaussians: usize) -> Vec<GoldenView> {
    let (width, height) = (arrays.scalar("width") as u32, arrays.scalar("height") as u32);
    let pixels = (width * height) as usize;
    let poses = arrays.rows::<16>("viewmats");
    let intrinsics = arrays.rows::<9>("Ks");
    let backgrounds = arrays.rows::<3>("backgrounds");
    let (near, dilation) = (arrays.scalar("near_plane"), arrays.scalar("eps2d"));
    let antialias = arrays.scalar("antialiased") != 0.0;
    let (color, alpha) = (arrays.rows::<3>("render_colors"), arrays.rows::<1>("render_alphas"));
    let (robust, n_contrib) = (arrays.read("robust_mask"), arrays.read("n_contrib"));
    let (radii, means_px) = (arrays.rows::<2>("radii"), arrays.rows::<2>("means2d"));
    let (depths, conics) = (arrays.read("depths"), arrays.rows::<3>("conics"));
    let (colors, opacities) = (arrays.rows::<3>("colors"), arrays.read("view_opacities"));
    let (v_color, v_alpha) = (arrays.rows::<3>("v_render_colors"), arrays.read("v_render_alphas"));
    let cotangents: Vec<[f64; 4]> = v_color.iter().zip(&v_alpha).map(|(&[r, g, b], &a)| [r, g, b, a]).collect();
    let (grad_means_px, grad_conics) = (arrays.rows::<2>("grad_means2d"), arrays.rows::<3>("grad_conics"));
    let grad_colors = arrays.rows::<3>("grad_colors");
    let view = |c: usize| GoldenView {
        camera: Camera {
            name: format!("{case}_{c}"),
            width,
            height,
            fx: intrinsics[c][0],
            fy: intrinsics[c][4],
            cx: intrinsics[c][2],
            cy: intrinsics[c][5],
            view_from_world: std::array::from_fn(|row| std::array::from_fn(|col| poses[c][4 * row + col])),
        },
        options: RenderOptions { near, dilation, antialias, background: backgrounds[c] },
        color: part(&color, c, pixels),
        alpha: part(&alpha, c, pixels),
        robust: part(&robust, c, pixels).iter().map(|&v| v != 0.0).collect(),
        n_contrib: part(&n_contrib, c, pixels).iter().map(|&v| v as u32).collect(),
        visible: part(&radii, c, gaussians).iter().map(|r| r[0] > 0.0 && r[1] > 0.0).collect(),
        means_px: part(&means_px, c, gaussians),
        depths: part(&depths, c, gaussians),
        conics: part(&conics, c, gaussians),
        colors: part(&colors, c, gaussians),
        opacities: part(&opacities, c, gaussians),
        cotangents: part(&cotangents, c, pixels),
        grad_means_px: part(&grad_means_px, c, gaussians),
        grad_conics: part(&grad_conics, c, gaussians),
        grad_colors: part(&grad_colors, c, gaussians),
    };
    (0..poses.len()).map(view).collect()
}
