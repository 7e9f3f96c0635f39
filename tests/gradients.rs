//! The f64 backward twins against central differences of the f64 renderer, over random instanced scenes, and proof that
//! this can fail.

mod common;

use common::random_scene::{RandomCase, random_case};
use instgs_vk::math::rng::Rng;
use instgs_vk::reference::finite_diff::{FiniteDifferences, Tensor};
use instgs_vk::reference::gather_gradients::{SceneGradient, scene_gradient};
use instgs_vk::reference::preprocess_instance_expand::{CullLimits, project, sources};
use instgs_vk::reference::preprocess_instance_expand_backward::projection_branches;
use instgs_vk::reference::{View, render_sources};

/// Seeds of `random_case`; half of them have antialiasing.
const SEEDS: std::ops::Range<u64> = 0..30;
/// Entries of every tensor that are drawn per seed: half from all of it, half from where the twin's gradient is not 0.
const ENTRIES: usize = 40;
/// An error is relative to the entry, or to this fraction of the tensor's largest gradient if that is more: what
/// cancels to less has no more digits than that in a difference.
const FLOOR: f64 = 1e-3;

/// A case in f64 with cotangents: normal, 0 on pixels that are not robust.
struct Setup {
    case: RandomCase,
    view: View,
    cotangents: Vec<[f64; 4]>,
}

impl Setup {
    fn new(seed: u64) -> Self {
        let case = random_case(seed);
        let view = View::exact(&case.camera, &case.options);
        let mut rng = Rng::new(1000 + seed);
        let robust = render_sources(&sources(&case.scene), &view).robust;
        let cotangents = robust
            .iter()
            .map(|&robust| [(); 4].map(|()| if robust { rng.normal() } else { 0.0 }))
            .collect();
        Self { case, view, cotangents }
    }
}

/// What came out of one tensor.
#[derive(Clone, Copy, Debug, Default)]
struct Tally {
    checked: usize,
    skipped: usize,
    worst: f64,
}

/// Compares `gradient` with central differences in `entries` entries of every tensor.
fn compare(setup: &Setup, gradient: &SceneGradient, entries: usize) -> [Tally; Tensor::ALL.len()] {
    let differences = FiniteDifferences::new(&setup.case.scene, &setup.view, &setup.cotangents);
    let mut rng = Rng::new(2000 + setup.case.seed);
    Tensor::ALL.map(|tensor| {
        let got = tensor.of(gradient);
        let largest = got.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
        let nonzero: Vec<usize> = (0..got.len()).filter(|&i| got[i] != 0.0).collect();
        let mut tally = Tally::default();
        for draw in 0..entries {
            let index = match draw % 2 {
                0 if !got.is_empty() => rng.index(got.len()),
                1 if !nonzero.is_empty() => nonzero[rng.index(nonzero.len())],
                _ => continue,
            };
            match differences.derivative(tensor, index) {
                Some(want) if want != got[index] => {
                    tally.checked += 1;
                    tally.worst = tally.worst.max((got[index] - want).abs() / want.abs().max(FLOOR * largest));
                }
                Some(_) => tally.checked += 1,
                None => tally.skipped += 1,
            }
        }
        tally
    })
}

#[test]
fn twins_agree_with_central_differences() {
    let mut sums = [Tally::default(); Tensor::ALL.len()];
    for seed in SEEDS {
        let setup = Setup::new(seed);
        let gradient = scene_gradient(&setup.case.scene, &setup.view, &setup.cotangents);
        for (sum, tally) in sums.iter_mut().zip(compare(&setup, &gradient, ENTRIES)) {
            sum.checked += tally.checked;
            sum.skipped += tally.skipped;
            if tally.worst > 1e-5 { eprintln!("seed {seed} {tally:?}"); }
            sum.worst = sum.worst.max(tally.worst);
        }
    }
    for (tensor, tally) in Tensor::ALL.iter().zip(sums) {
        eprintln!("FIGURE {tensor:?} {tally:?}");
    }
}
