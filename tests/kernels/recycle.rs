//! Room in a full cloud: `densify_cost` and `densify_retire`, as the strategy `densify` runs them, against the twin.

use std::path::Path;

use instgs_reference::densify::{LogitMoments, felt_of_sources, removal_cost, retired, use_of_sources};
use instgs_train::config::TrainConfig;
use instgs_train::device_state::DeviceState;
use instgs_train::state_file::{restore, to_checkpoint};
use instgs_vk::gpu::staging::{download, write};
use instgs_vk::kernels::Variant;
use instgs_vk::math::rng::Rng;
use instgs_vk::scene::Parameter;

use crate::common::gpu::{assert_silent, gpu};
use crate::densify::{EXTENT, config, instanced_case, strategy};

/// A full scene frees a fifth of its cap: what the twin says costs least leaves, and the rest stays as it is. One Gaussian whose
/// moment is not a number stays, too. Offsets have moments of their own, but for those of one instance. It is the first
/// densification, so the statistics are of all 200 steps.
#[test]
fn a_full_cloud_makes_room_where_it_is_missed_least() {
    let Some(gpu) = gpu() else { return };
    let chunk_size = Variant::for_training(gpu.caps()).workgroup_size;
    for seed in 20..24 {
        let (scene, case) = instanced_case(seed, 1);
        let cap = scene.expanded_len() as u32;
        let room = (f64::from(cap) * 0.8) as u32;
        let sets = [
            "densify.recycle=0.2",
            "densify.recycle_every=100",
            "densify.gradient_threshold=1e3",
            "densify.opacity_min=0",
        ];
        let config = config(&[&sets[..], &[&format!("max_gaussians={cap}")]].concat());
        let mut rng = Rng::new(seed);
        let mut moment = |_| [rng.normal() as f32, 10f64.powf(rng.range(-12.0, -6.0)) as f32];
        let mut moments: Vec<[f32; 2]> = (0..case.cloud.len()).map(&mut moment).collect();
        let mut of_offsets: Vec<[f32; 2]> = (0..scene.offsets.len()).map(&mut moment).collect();
        moments[700][1] = f32::NAN;
        of_offsets[300..450].fill([0.0; 2]);
        let seconds = |moments: &[[f32; 2]]| moments.iter().map(|moment| moment[1]).collect();
        let seconds = LogitMoments { sources: seconds(&moments), records: seconds(&of_offsets) };
        let (uses, felt) = (use_of_sources(&scene), felt_of_sources(&scene, &seconds));
        let cost = |i: usize| removal_cost(felt[i], &case.statistics[i], &uses[i], 200.0);
        let costs: Vec<f64> = (0..case.cloud.len()).map(|i| if i == 700 { f64::INFINITY } else { cost(i) }).collect();
        let leaves = retired(&costs, &uses, cap - room);
        let mut state = DeviceState::new(&gpu, &scene, chunk_size).unwrap();
        write(&gpu, &mut state.gradients.screen_statistics, &case.statistics).unwrap();
        write(&gpu, &mut state.moments.parameters[Parameter::OpacityLogits], &moments).unwrap();
        write(&gpu, &mut state.moments.parameters[Parameter::OffsetOpacityLogits], &of_offsets).unwrap();
        let outcome = strategy(&gpu, 1).after_step(&mut state, &config, 200, EXTENT).unwrap().unwrap();
        let got = state.download(&gpu).unwrap();
        let mut pool = got.templates.clone();
        pool.append(&got.background);
        let stay: Vec<[f32; 3]> = (0..costs.len()).filter(|&i| !leaves[i]).map(|i| case.cloud.means[i]).collect();
        assert!(pool.means == stay, "{} {}", pool.len(), stay.len());
        assert_eq!((outcome.cloned + outcome.split, outcome.pruned as usize), (0, costs.len() - stay.len()));
        let left = got.expanded_len() as u32;
        assert!(left <= room && left + 4 > room, "{left} of {room}");
        let background = leaves[450..].iter().filter(|leaves| **leaves).count();
        assert!(outcome.pruned as usize > background && background > 10, "{} {background}", outcome.pruned);
        // Below the cap, or in between, nobody leaves.
        for (cap, done) in [(2 * cap, 200), (cap, 250)] {
            let config = TrainConfig { max_gaussians: cap, ..config.clone() };
            let mut state = DeviceState::new(&gpu, &scene, chunk_size).unwrap();
            let outcome = strategy(&gpu, 1).after_step(&mut state, &config, done, EXTENT).unwrap();
            assert_eq!(outcome.map_or(0, |outcome| outcome.pruned), 0, "{cap} {done}");
        }
    }
    assert_silent(&gpu);
}

/// A full scene has no room until the next recycling: it keeps its statistics until then, also through a checkpoint, and what it
/// removes is weighed by all steps that they are of.
#[test]
fn a_full_scene_waits_for_recycling_and_keeps_its_statistics() {
    let Some(gpu) = gpu() else { return };
    let chunk_size = Variant::for_training(gpu.caps()).workgroup_size;
    let (scene, case) = instanced_case(25, 1);
    let cap = format!("max_gaussians={}", scene.expanded_len());
    let (never, grows, stays) =
        ("densify.opacity_reset_every=0", "densify.gradient_threshold=1e3", "densify.opacity_min=0");
    let sets = [never, "steps=5000", "densify.recycle=0.2", "densify.recycle_every=500", grows, stays, cap.as_str()];
    let waits = config(&sets);
    let with_statistics = || {
        let mut state = DeviceState::new(&gpu, &scene, chunk_size).unwrap();
        write(&gpu, &mut state.gradients.screen_statistics, &case.statistics).unwrap();
        state
    };
    let statistics =
        |state: &DeviceState| download(&gpu, &state.gradients.screen_statistics, case.statistics.len()).unwrap();
    let mut state = with_statistics();
    let mut rng = Rng::new(25);
    let mut moment = |_| [0.0, 10f64.powf(rng.range(-12.0, -6.0)) as f32];
    let moments: Vec<[f32; 2]> = (0..case.cloud.len()).map(&mut moment).collect();
    let of_offsets: Vec<[f32; 2]> = (0..scene.offsets.len()).map(&mut moment).collect();
    write(&gpu, &mut state.moments.parameters[Parameter::OpacityLogits], &moments).unwrap();
    write(&gpu, &mut state.moments.parameters[Parameter::OffsetOpacityLogits], &of_offsets).unwrap();
    for done in [300, 400] {
        assert!(waits.densifies_at(done));
        assert_eq!(strategy(&gpu, 1).after_step(&mut state, &waits, done, EXTENT).unwrap(), None);
    }
    assert!(statistics(&state) == case.statistics && state.statistics_since == Some(0));
    let saved = to_checkpoint(&gpu, &mut state, 450, false).unwrap();
    let mut resumed = DeviceState::new(&gpu, &scene, chunk_size).unwrap();
    resumed.statistics_since = None;
    restore(&gpu, &mut resumed, saved, Path::new("checkpoint")).unwrap();
    assert!(statistics(&resumed) == case.statistics && resumed.statistics_since == Some(0));
    let outcome = strategy(&gpu, 1).after_step(&mut resumed, &waits, 500, EXTENT).unwrap().unwrap();
    assert!(outcome.pruned > 0 && resumed.statistics_since == Some(500), "{outcome:?}");
    assert!(statistics(&resumed)[..100].iter().all(|of_one| *of_one == [0.0; 3]));
    let seconds = |moments: &[[f32; 2]]| moments.iter().map(|moment| moment[1]).collect();
    let seconds = LogitMoments { sources: seconds(&moments), records: seconds(&of_offsets) };
    let (uses, felt) = (use_of_sources(&scene), felt_of_sources(&scene, &seconds));
    let full = scene.expanded_len() as u32;
    let leave_by = |steps: f64| {
        let cost = |i: usize| removal_cost(felt[i], &case.statistics[i], &uses[i], steps);
        let costs: Vec<f64> = (0..case.cloud.len()).map(cost).collect();
        retired(&costs, &uses, full - (f64::from(full) * 0.8) as u32)
    };
    let leaves = leave_by(500.0);
    let stay: Vec<[f32; 3]> = (0..leaves.len()).filter(|&i| !leaves[i]).map(|i| case.cloud.means[i]).collect();
    let got = resumed.download(&gpu).unwrap();
    let mut pool = got.templates.clone();
    pool.append(&got.background);
    assert!(pool.means == stay && leaves != leave_by(100.0), "{} {}", pool.len(), stay.len());
    // With room, or without recycling, it does not wait.
    let others = [config(&sets[..6]), config(&[never, "steps=5000", cap.as_str()])];
    for other in others {
        let outcome = strategy(&gpu, 1).after_step(&mut with_statistics(), &other, 300, EXTENT).unwrap();
        assert!(outcome.is_some());
    }
    assert_silent(&gpu);
}
