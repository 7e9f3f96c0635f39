//! The strategy `densify` on the device against the twin: decisions exactly, places to rounding.

use std::sync::Arc;

use instgs_reference::densify::{
    Densified, Limits, Made, OwnNeed, decay_opacity, densify, densify_sources, new_offsets, opacity_logit,
    reset_opacity, seen_gaussian, shape, use_of_sources,
};
use instgs_train::config::{ConfigBuilder, Growth, TrainConfig};
use instgs_train::device_state::DeviceState;
use instgs_train::state_file::{restore, to_checkpoint};
use instgs_train::strategy::{DensifyOutcome, Strategy};
use instgs_vk::gpu::staging::{download, write};
use instgs_vk::gpu::{Buffer, DeviceChoice, Gpu, GpuOptions};
use instgs_vk::kernels::Variant;
use instgs_vk::math::covariance::rotation_from_quat;
use instgs_vk::math::rng::Rng;
use instgs_vk::math::sh::widened;
use instgs_vk::math::similarity::Similarity;
use instgs_vk::render::TrainFrame;
use instgs_vk::scene::gaussians::sh_coefficients;
use instgs_vk::scene::{Gaussians, Instance, InstancedScene, Offsets, Owner, Parameter, SourceRange};

use crate::common::gpu::{assert_silent, gpu, trigonometric_error};

/// Scene extent of all cases, scene units.
pub(crate) const EXTENT: f64 = 4.0;

/// A state as it may be in training, with what the tests need to know of it.
pub(crate) struct Case {
    pub(crate) cloud: Gaussians,
    pub(crate) statistics: Vec<[f32; 3]>,
    pub(crate) moments: Vec<Vec<[f32; 2]>>,
}

/// f32 of a Gaussian in each parameter array: means, quats, log scales, logits, SH bands.
const WIDTHS: [usize; 8] = [3, 4, 3, 1, 3, 9, 15, 21];

/// Every kind of Gaussian, well away from all thresholds: opacities from 0.01 or below 0.004 (limit 0.005), largest
/// scales around the split limit 0.04 and the size limit 0.4, radii around 20 px, mean gradients around 2e-4 with ties.
pub(crate) fn random_case(seed: u64, count: usize, sh_degree: u32) -> Case {
    let mut rng = Rng::new(seed);
    let mut cloud = Gaussians::with_capacity(sh_degree, count);
    let mut statistics = Vec::new();
    let mut ranks: Vec<usize> = (0..count).collect();
    rng.shuffle(&mut ranks);
    for &rank in &ranks {
        let largest = if rng.chance(0.5) { rng.range(0.005, 0.035) } else { rng.range(0.045, 1.0) };
        let opacity = if rng.chance(0.85) { rng.range(0.01, 0.999) } else { rng.range(0.0005, 0.004) };
        cloud.means.push([(); 3].map(|()| rng.range(-2.0, 2.0) as f32));
        cloud.quats.push([(); 4].map(|()| rng.normal() as f32));
        // The longest axis is any; now and then another is as long, or nearly.
        let second = if rng.chance(0.2) { largest } else { largest * rng.range(0.3, 0.999) };
        let mut scales = [largest, second, 0.1 * largest];
        rng.shuffle(&mut scales);
        cloud.log_scales.push(scales.map(|s| s.ln() as f32));
        cloud.opacity_logits.push((opacity / (1.0 - opacity)).ln() as f32);
        cloud.sh.extend((0..sh_coefficients(sh_degree)).map(|_| [(); 3].map(|()| rng.normal() as f32)));
        // Far more apart than f32 rounds, except for runs of four that are equal. Views are powers of two.
        let gradient = 1e-4 + 2e-4 * ((rank / 4) as f64 + 0.3) / count as f64 * 4.0;
        let views = f64::from(1 << rng.index(5));
        let seen = rng.chance(0.9);
        let radius = if rng.chance(0.7) { rng.range(1.0, 19.0) } else { rng.range(21.0, 60.0) };
        let statistic = [f64::from(gradient as f32) * views, views, radius];
        statistics.push(if seen { statistic.map(|v| v as f32) } else { [0.0; 3] });
    }
    let moments = WIDTHS.iter().map(|w| (0..count * w).map(|_| [rng.normal() as f32, rng.uniform() as f32]).collect());
    Case { moments: moments.collect(), cloud, statistics }
}

/// One Gaussian in twenty gets a NaN or an infinity somewhere.
fn poison(case: &mut Case, seed: u64) {
    let mut rng = Rng::new(seed);
    let c = case.cloud.sh_coefficients();
    for i in 0..case.cloud.len() / 20 {
        let bad = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY][rng.index(3)];
        let i = 20 * i + rng.index(20);
        match rng.index(5) {
            0 => case.cloud.means[i][rng.index(3)] = bad,
            1 => case.cloud.quats[i][rng.index(4)] = bad,
            2 => case.cloud.log_scales[i][rng.index(3)] = bad,
            3 => case.cloud.opacity_logits[i] = bad,
            _ => case.cloud.sh[c * i + rng.index(c)][rng.index(3)] = bad,
        }
    }
}

/// Limits and when, as a configuration; `done` is 200 before large ones are pruned, 400 after.
pub(crate) fn config(sets: &[&str]) -> TrainConfig {
    let schedule = ["steps=1000", "densify.start=100", "densify.opacity_reset_every=300", "seed=123456789012"];
    // Off by default; the kernel can do it.
    let more = ["densify.screen_size_max_px=20", "densify.growth=clone_or_split"];
    let schedule = [&schedule[..], &more].concat();
    let builder = schedule.iter().chain(sets).try_fold(ConfigBuilder::new(), |builder, set| builder.set(set));
    builder.unwrap().finish().unwrap()
}

pub(crate) fn limits(config: &TrainConfig, done: u64) -> Limits {
    let (d, large) = (&config.densify, config.prunes_large_at(done));
    Limits {
        gradient_threshold: d.gradient_threshold,
        halves: d.growth == Growth::Halves,
        split_above: if d.growth == Growth::Halves { 0.0 } else { d.split_fraction * EXTENT },
        split_count: d.children(),
        split_shrink: d.split_shrink,
        child_opacity: if d.growth == Growth::Halves { d.half_opacity } else { 1.0 },
        opacity_min: d.opacity_min,
        scale_max: if large { d.world_size_max * EXTENT } else { f64::INFINITY },
        radius_max_px: if large { d.screen_size_max_px } else { f64::INFINITY },
        max_expanded: config.max_gaussians,
        own_share: config.joint.own_share,
        seed: config.seed,
        time: done as u32,
    }
}

/// The device's state of a case.
pub(crate) fn upload_case(gpu: &Arc<Gpu>, case: &Case) -> DeviceState {
    let chunk_size = Variant::for_training(gpu.caps()).workgroup_size;
    let scene = InstancedScene::from_cloud(case.cloud.clone());
    let mut state = DeviceState::new(gpu, &scene, chunk_size).unwrap();
    write(gpu, &mut state.gradients.screen_statistics, &case.statistics).unwrap();
    let bands = case.cloud.sh_degree as usize + 5;
    let arrays = moment_buffers(&mut state).zip(&case.moments).take(bands);
    arrays.for_each(|(buffer, values)| write(gpu, buffer, values).unwrap());
    state
}

/// Moments of all parameters of a plain cloud.
fn moment_buffers(state: &mut DeviceState) -> impl Iterator<Item = &mut Buffer<[f32; 2]>> {
    state.moments.parameters.iter_mut().filter(|(p, _)| p.owner() != Owner::Offset).map(|(_, buffer)| buffer)
}

/// Everything that a strategy leaves on the device.
#[derive(PartialEq)]
pub(crate) struct After {
    pub(crate) cloud: Gaussians,
    pub(crate) moments: Vec<Vec<[f32; 2]>>,
    pub(crate) statistics: Vec<[f32; 3]>,
}

pub(crate) fn download_state(gpu: &Arc<Gpu>, state: &mut DeviceState) -> After {
    let count = state.source_count();
    let bands = state.scene.counts.background_sh_degree as usize + 5;
    let cloud = state.scene.download(gpu, &InstancedScene::default()).unwrap().background;
    let statistics = download(gpu, &state.gradients.screen_statistics, count).unwrap();
    let arrays = moment_buffers(state).zip(WIDTHS).take(bands);
    let moments = arrays.map(|(buffer, width)| download(gpu, buffer, count * width).unwrap()).collect();
    After { cloud, moments, statistics }
}

pub(crate) fn strategy(gpu: &Arc<Gpu>, sh_degree: u32) -> Strategy {
    let frame = TrainFrame::new(gpu, Variant::for_training(gpu.caps())).unwrap();
    Strategy::new(gpu, &frame, sh_degree).unwrap()
}

/// Runs a case on the device.
pub(crate) fn run(gpu: &Arc<Gpu>, case: &Case, config: &TrainConfig, done: u64) -> (DensifyOutcome, After) {
    let mut state = upload_case(gpu, case);
    let outcome = strategy(gpu, case.cloud.sh_degree).after_step(&mut state, config, done, EXTENT).unwrap().unwrap();
    (outcome, download_state(gpu, &mut state))
}

/// Bits, so that NaN is equal to itself.
pub(crate) fn bits<const N: usize>(values: &[[f32; N]]) -> Vec<[u32; N]> {
    values.iter().map(|v| v.map(f32::to_bits)).collect()
}

/// Standard deviations that a child is drawn away from its parent, at most: normal numbers of 32 random bits.
pub(crate) const MOST_SIGMAS: f64 = 7.0;

/// How far from the twin's a child of Gaussian `i` may be, scene units.
pub(crate) fn allowed_error(gpu: &Gpu, cloud: &Gaussians, i: usize) -> f64 {
    let largest = cloud.log_scales[i].iter().fold(f32::MIN, |a, &b| a.max(b));
    // Poisoned Gaussians have no size, and no children.
    1e-5 + MOST_SIGMAS * f64::from(largest).exp().min(1e3) * trigonometric_error(gpu)
}

/// Fails unless the device's result is the twin's; the largest error of a child's place, in scene units.
fn check(gpu: &Gpu, case: &Case, limits: &Limits, want: &Densified, got: &After) -> f64 {
    let (old, new) = (&case.cloud, &got.cloud);
    assert_eq!(new.len(), want.origins.len());
    assert!(got.statistics.iter().flatten().all(|&v| v == 0.0));
    let mut worst = 0.0f64;
    for (j, &(i, made)) in want.origins.iter().enumerate() {
        assert_eq!(bits(&[new.quats[j]]), bits(&[old.quats[i]]), "{j} from {i}, {made:?}");
        let error = (f64::from(new.opacity_logits[j]) - opacity_logit(old, (i, made), limits)).abs();
        let is_child = matches!(made, Made::Child(_)) && limits.child_opacity < 1.0;
        assert!(error <= if is_child { 1e-5 } else { 0.0 }, "logit {j} from {i}, {made:?}: {error:.2e}");
        assert_eq!(bits(new.sh_of(j)), bits(old.sh_of(i)));
        let (mean, log_scales) = shape(old, (i, made), limits);
        let allowed = if made == Made::Kept { 0.0 } else { allowed_error(gpu, old, i) };
        for a in 0..3 {
            let error = (f64::from(new.means[j][a]) - mean[a]).abs();
            worst = worst.max(error);
            assert!(error <= allowed, "mean {j} from {i}, {made:?}: {error:.2e}");
            let error = (f64::from(new.log_scales[j][a]) - log_scales[a]).abs();
            assert!(error <= if made == Made::Kept { 0.0 } else { 1e-6 }, "scale {j} from {i}, {made:?}: {error:.2e}");
        }
        for (k, (new, old)) in got.moments.iter().zip(&case.moments).enumerate() {
            let (new, old) = (&new[j * WIDTHS[k]..(j + 1) * WIDTHS[k]], &old[i * WIDTHS[k]..(i + 1) * WIDTHS[k]]);
            assert!(
                if made == Made::Kept { new == old } else { new.iter().all(|m| *m == [0.0; 2]) },
                "moments {k} {j}"
            );
        }
    }
    worst
}

/// Random clouds of all SH degrees and odd sizes, before and after large ones are pruned, with 2 and 3 children, NaN.
#[test]
fn random_clouds_become_what_the_twin_says() {
    let Some(gpu) = gpu() else { return };
    let (mut worst, mut seen) = (0.0f64, [0u32; 4]);
    for (seed, (count, sh_degree)) in
        [(1, 0), (9, 1), (257, 2), (2048, 3), (5000, 1), (3001, 0)].into_iter().enumerate()
    {
        let thirds = ["densify.split_count=3", "densify.split_shrink=2.5"];
        let halves = ["densify.growth=halves", "densify.half_opacity=0.6"];
        for (done, sets) in [(200, &[][..]), (400, &thirds), (200, &halves), (400, &halves)] {
            let (mut case, config) = (random_case(seed as u64, count, sh_degree), config(sets));
            if seed > 1 {
                poison(&mut case, 99);
            } else {
                // Alone, it must live.
                case.cloud.opacity_logits.fill(0.0);
                case.cloud.log_scales.fill([-3.0; 3]);
                case.statistics.iter_mut().for_each(|s| s[2] = s[2].min(19.0));
            }
            let limits = limits(&config, done);
            let want = densify(&case.cloud, &case.statistics, &limits);
            let (outcome, got) = run(&gpu, &case, &config, done);
            worst = worst.max(check(&gpu, &case, &limits, &want, &got));
            let grown = count as u32 + want.cloned + want.split * (limits.split_count - 1);
            let pruned = grown - want.origins.len() as u32;
            let expected = DensifyOutcome {
                cloned: want.cloned,
                split: want.split,
                pruned,
                gaussians: want.origins.len() as u32,
                ..Default::default()
            };
            assert_eq!(outcome, expected);
            // A lone copy whose original was too wide on the screen.
            let lone = want.origins.windows(2).filter(|w| w[1].1 == Made::Copy && w[0].0 != w[1].0).count();
            [want.cloned, want.split, pruned, lone as u32].iter().zip(&mut seen).for_each(|(n, sum)| *sum += n);
        }
    }
    println!("clones, splits, pruned, lone copies: {seen:?}; children placed within {worst:.2e}");
    assert!(seen.iter().all(|&n| n > 50), "{seen:?}");
    assert_silent(&gpu);
}

/// A scene of two templates, five instances and a background: all cases are cut from one random cloud. Two instances share
/// their offsets, one has none, and one shows a Gaussian that its template alone would lose.
pub(crate) fn instanced_case(seed: u64, sh_degree: u32) -> (InstancedScene, Case) {
    let case = random_case(seed, 900, sh_degree);
    let mut rng = Rng::new(seed + 1);
    let of = |range: std::ops::Range<usize>| case.cloud.filtered(|i| range.contains(&i));
    let template_ranges = vec![SourceRange { first: 0, count: 300 }, SourceRange { first: 300, count: 150 }];
    let mut offsets = Offsets::default();
    let of_offsets = sh_degree.min(1 + seed as u32 % 3);
    for _ in 0..300 + 150 + 300 {
        offsets.means.push([(); 3].map(|()| rng.normal() as f32));
        offsets.sh_dc.push([(); 3].map(|()| rng.normal() as f32));
        offsets.opacity_logits.push(if rng.chance(0.2) { 4.0 } else { rng.range(-0.1, 0.1) as f32 });
        offsets.sh_rest.extend((1..sh_coefficients(of_offsets)).map(|_| [(); 3].map(|()| rng.normal() as f32)));
        offsets.log_scales.push([(); 3].map(|()| rng.normal() as f32));
    }
    let instances = [(0, Some(450)), (1, Some(300)), (0, None), (0, Some(0)), (0, Some(0))];
    let instance = |(template, first_offset)| Instance {
        template,
        first_offset,
        world_from_template: Similarity::from_parts(
            rotation_from_quat(rng.rotation_quat()),
            rng.range(0.5, 2.0),
            rng.normal_vector(),
        ),
    };
    let scene = InstancedScene {
        templates: of(0..450),
        template_ranges,
        instances: instances.map(instance).into(),
        offsets,
        background: of(450..900),
        ..InstancedScene::default()
    };
    scene.validate().unwrap();
    (scene, case)
}

/// Templates and background of a scene in training change as the twin says, and offsets follow their Gaussians. A
/// checkpoint of the result is restored into a state of the scene before.
#[test]
fn templates_grow_and_offsets_follow() {
    let Some(gpu) = gpu() else { return };
    let chunk_size = Variant::for_training(gpu.caps()).workgroup_size;
    let (mut seen, mut worst) = ([0u32; 3], [0.0f64; 2]);
    let halves = ["densify.growth=halves", "densify.half_opacity=0.6"];
    let cases = [
        (1, 0, 5000u32, &[][..]),
        (2, 2, 5000, &[]),
        (3, 3, 2150, &[]),
        (4, 1, 1, &[]),
        (5, 1, 9000, &[]),
        (6, 0, 9000, &halves),
        (7, 1, 5000, &[halves[0], halves[1], "offsets.position=false"]),
    ];
    for (seed, sh_degree, cap, sets) in cases {
        let (mut scene, case) = instanced_case(seed, sh_degree);
        if seed % 2 == 0 {
            let mut rng = Rng::new(seed + 3);
            let quats = (0..scene.offsets.len()).map(|_| [(); 4].map(|()| (0.3 * rng.normal()) as f32));
            scene.offsets.quats = quats.collect();
        }
        // Cases of this bound only grow: then the restored arrays are larger than those of the start.
        let grows = if cap == 9000 { "densify.opacity_reset_every=0" } else { "densify.opacity_reset_every=300" };
        let config = config(&[&[&*format!("max_gaussians={cap}"), grows], sets].concat());
        let limits = limits(&config, 400);
        let needs = vec![OwnNeed::default(); case.cloud.len()];
        let want = densify_sources(&case.cloud, &use_of_sources(&scene), &needs, &case.statistics, &limits);
        let mut state = DeviceState::new(&gpu, &scene, chunk_size).unwrap();
        write(&gpu, &mut state.gradients.screen_statistics, &case.statistics).unwrap();
        let mark = |_: usize, moments: &mut Buffer<[f32; 2]>| {
            let values: Vec<[f32; 2]> = (0..moments.len()).map(|i| [i as f32 + 1.0, 2.0]).collect();
            write(&gpu, moments, &values).unwrap();
        };
        state.moments.parameters.iter_mut().enumerate().for_each(|(k, (_, moments))| mark(k, moments));
        let outcome = strategy(&gpu, sh_degree).after_step(&mut state, &config, 400, EXTENT).unwrap().unwrap();
        let got = state.download(&gpu).unwrap();
        got.validate().unwrap();
        // The whole pool is in one cloud, as the twin has it.
        let old = &case.cloud;
        let mut pool = got.templates.clone();
        pool.append(&got.background);
        assert_eq!(pool.len(), want.origins.len());
        for (j, &(i, made)) in want.origins.iter().enumerate() {
            let (mean, _) = shape(old, (i, made), &limits);
            let error = (0..3).map(|a| (f64::from(pool.means[j][a]) - mean[a]).abs()).fold(0.0, f64::max);
            let allowed = if made == Made::Kept { 0.0 } else { allowed_error(&gpu, old, i) };
            assert!(error <= allowed, "mean {j} from {i}, {made:?}: {error:.2e}");
            assert_eq!(bits(pool.sh_of(j)), bits(old.sh_of(i)));
        }
        let templates = want.origins.iter().take_while(|(i, _)| *i < 450).count();
        assert_eq!((got.templates.len(), got.background.len()), (templates, want.origins.len() - templates));
        let records = |scene: &InstancedScene, k: usize, local: usize| {
            let first = scene.instances[k].first_offset? as usize + local;
            let o = &scene.offsets;
            let shape = (o.log_scales[first], o.quats.get(first).copied(), o.rest_of(first).to_vec());
            Some((o.means[first], o.opacity_logits[first], (o.sh_dc[first], shape)))
        };
        let moments = download(&gpu, &state.moments.parameters[Parameter::OffsetMeans], 3 * got.offsets.len()).unwrap();
        for k in 0..5 {
            assert_eq!(got.instances[k].world_from_template.rows(), scene.instances[k].world_from_template.rows());
            let range = got.template_ranges[got.instances[k].template as usize];
            let first = scene.template_ranges[scene.instances[k].template as usize].first as usize;
            for local in 0..range.count as usize {
                let (i, made) = want.origins[range.first as usize + local];
                let (now, before) = (records(&got, k, local), records(&scene, k, i - first));
                assert_eq!(
                    now.as_ref().map(|record| &record.2),
                    before.as_ref().map(|record| &record.2),
                    "{k} {local}"
                );
                if let (Some((mean, logit, _)), Made::Child(_)) = (&now, made) {
                    let want = new_offsets(&scene, k, (i, made), &limits);
                    let error = (f64::from(*logit) - want.opacity_logit).abs();
                    worst[1] = worst[1].max(error);
                    assert!(error <= 1e-5, "logit of {local} in {k}: {error:.2e}");
                    let inherited = before.as_ref().map(|record| record.1);
                    assert!(
                        limits.child_opacity < 1.0 || Some(*logit) == inherited,
                        "{k} {local}: {logit}, not inherited"
                    );
                    if config.offsets.position {
                        let error = (widened(*mean) - want.mean).abs().max_element();
                        let scale = seen_gaussian(&scene, k, (i - first) as u32).log_scales.max_element().exp();
                        let by_angles = MOST_SIGMAS * scale * (1e-6 + trigonometric_error(&gpu));
                        worst[0] = worst[0].max(error / scale.max(1.0));
                        assert!(
                            error <= allowed_error(&gpu, old, i) + by_angles,
                            "mean of {local} in {k}: {error:.2e}"
                        );
                    } else {
                        assert_eq!(Some(*mean), before.map(|record| record.0), "{k} {local}");
                    }
                } else {
                    assert_eq!(now, before, "{k} {local}");
                }
                if let (Some(now), Some(before)) = (got.instances[k].first_offset, scene.instances[k].first_offset) {
                    let before = 3 * (before as usize + i - first);
                    let want = if made == Made::Kept { [before as f32 + 1.0, 2.0] } else { [0.0; 2] };
                    assert_eq!(moments[3 * (now as usize + local)], want, "{k} {local}");
                }
            }
        }
        assert_eq!(got.instances[3].first_offset, got.instances[4].first_offset);
        assert!(got.expanded_len() <= u64::from(cap) || outcome.cloned + outcome.split == 0);
        assert!(cap < 9000 || state.source_count() > 1000, "{}", state.source_count());
        let checkpoint = to_checkpoint(&gpu, &mut state, 400, false).unwrap();
        let mut restored = DeviceState::new(&gpu, &scene, chunk_size).unwrap();
        restore(&gpu, &mut restored, checkpoint.clone(), "test".as_ref()).unwrap();
        assert!(restored.download(&gpu).unwrap() == got && restored.layout == state.layout);
        assert!(to_checkpoint(&gpu, &mut restored, 400, false).unwrap() == checkpoint);
        [outcome.cloned, outcome.split, outcome.pruned].iter().zip(&mut seen).for_each(|(n, sum)| *sum += n);
    }
    println!("clones, splits, pruned: {seen:?}; offsets of means (by scales above 1) and logits within {worst:?}");
    assert!(seen.iter().all(|&n| n > 50), "{seen:?}");
    assert_silent(&gpu);
}

/// Caps at every interesting place: no room, room for some, for all but one, for all. Ties go to the first.
#[test]
fn caps_hold_exactly_and_the_largest_gradients_win() {
    let Some(gpu) = gpu() else { return };
    let case = random_case(31, 4000, 0);
    let free = limits(&config(&[]), 400);
    let most = densify(&case.cloud, &case.statistics, &free).origins.len();
    let none = Limits { max_expanded: 0, ..free };
    let least = densify(&case.cloud, &case.statistics, &none).origins.len();
    assert!(most > least + 500, "{least} {most}");
    for cap in [1, least, least + 1, least + 2, (least + most) / 2, (least + most) / 2 + 1, most - 1, most] {
        let config = config(&[&format!("max_gaussians={cap}")]);
        let limits = limits(&config, 400);
        let want = densify(&case.cloud, &case.statistics, &limits);
        let (outcome, got) = run(&gpu, &case, &config, 400);
        check(&gpu, &case, &limits, &want, &got);
        let count = outcome.gaussians as usize;
        assert!(count <= cap.max(least) && count + 1 >= cap.clamp(least, most), "{count} for {cap}");
    }
    assert_silent(&gpu);
}

/// A device of small bindings bounds the growth, says so, and refuses what is more from the start; a lower bound of the
/// configuration is not its doing.
#[test]
fn a_device_of_small_bindings_is_filled_and_no_more() {
    let Some(shared) = gpu() else { return };
    let device = DeviceChoice::Name(shared.caps().name.clone());
    let most = 4096;
    let options = GpuOptions { device, validation: true, most_binding_bytes: Some(40 * most), ..Default::default() };
    let small = Gpu::open(&options).unwrap();
    let case = random_case(77, 3600, 0);
    let limits = Limits { max_expanded: most as u32, ..limits(&config(&[]), 200) };
    let want = densify(&case.cloud, &case.statistics, &limits);
    let (outcome, got) = run(&small, &case, &config(&[]), 200);
    check(&small, &case, &limits, &want, &got);
    assert_eq!((u64::from(outcome.gaussians), outcome.device_full), (most, true));
    assert!(run(&shared, &case, &config(&[]), 200).0.gaussians > outcome.gaussians);
    assert!(!run(&small, &case, &config(&["max_gaussians=3800"]), 200).0.device_full);
    let scene = InstancedScene { background: random_case(3, 4097, 0).cloud, ..Default::default() };
    let error = DeviceState::new(&small, &scene, 64).err().unwrap().to_string();
    assert!(error.contains("4097") && error.contains("4096") && error.contains("Gaussians in training"), "{error}");
    assert_silent(&small);
}

/// The error names what happened, and the state is as before.
#[test]
fn all_pruned_is_an_error_that_changes_nothing() {
    let Some(gpu) = gpu() else { return };
    let mut case = random_case(5, 300, 1);
    case.cloud.opacity_logits.fill(-9.0);
    let mut state = upload_case(&gpu, &case);
    let error = strategy(&gpu, 1).after_step(&mut state, &config(&[]), 200, EXTENT).unwrap_err().to_string();
    assert!(error.contains("none of 300 Gaussians") && error.contains("after 200 steps"), "{error}");
    let after = download_state(&gpu, &mut state);
    assert!(after.cloud == case.cloud && after.statistics == case.statistics);
    assert!(after.moments.iter().zip(&case.moments).all(|(a, b)| a == b));
    assert_silent(&gpu);
}

/// The same seed gives the same bytes, another seed or step moves children, and only them.
#[test]
fn repeats_give_the_same_bytes() {
    let Some(gpu) = gpu() else { return };
    let case = random_case(8, 3000, 2);
    let (outcome, first) = run(&gpu, &case, &config(&[]), 200);
    assert!(run(&gpu, &case, &config(&[]), 200).1 == first);
    for (sets, done) in [(&["seed=123456789013"][..], 200), (&["seed=127751756308"], 200), (&[], 300)] {
        let moved = run(&gpu, &case, &config(sets), done).1;
        let differ = moved.cloud.means.iter().zip(&first.cloud.means).filter(|(a, b)| a != b).count();
        assert_eq!(differ as u32, 2 * outcome.split, "{sets:?} {done}");
    }
    assert_silent(&gpu);
}

/// After a densification every opacity is lowered a little, moments stay, and what is very transparent stays as it is.
#[test]
fn opacities_decay_after_each_densification() {
    let Some(gpu) = gpu() else { return };
    let mut case = random_case(13, 2000, 0);
    case.cloud.opacity_logits.iter_mut().step_by(7).for_each(|logit| *logit = 17.0);
    let sets = ["densify.opacity_decay=0.02", "densify.opacity_min=0", "densify.gradient_threshold=1"];
    let (outcome, after) = run(&gpu, &case, &config(&sets), 200);
    assert_eq!(outcome.gaussians, 2000);
    let (mut worst, mut lowest) = (0.0f64, 0);
    let opacity = |logit: f64| 1.0 / (1.0 + (-logit).exp());
    let want = decay_opacity(&case.cloud.opacity_logits, 0.02, 1e-4);
    for (&got, want) in after.cloud.opacity_logits.iter().zip(want) {
        worst = worst.max((opacity(f64::from(got)) - opacity(want)).abs());
        lowest += u32::from(opacity(want) < 1.1e-4);
    }
    println!("opacities within {worst:.2e}, {lowest} at the floor");
    assert!(worst < 1e-6 && lowest > 50);
    assert!(after.moments.iter().zip(&case.moments).all(|(a, b)| a == b));
    assert!(run(&gpu, &case, &config(&sets[1..]), 200).1.cloud == case.cloud, "off by default");
    assert_silent(&gpu);
}

/// Nothing happens when nothing is due; opacities are lowered on the step of a reset, after densification.
#[test]
fn opacities_are_reset_when_due() {
    let Some(gpu) = gpu() else { return };
    let case = random_case(12, 1000, 0);
    let mut state = upload_case(&gpu, &case);
    let mut strategy = strategy(&gpu, 0);
    let config = config(&["densify.every=200"]);
    assert_eq!(strategy.after_step(&mut state, &config, 250, EXTENT).unwrap(), None);
    let outcome = strategy.after_step(&mut state, &config, 300, EXTENT).unwrap();
    let want = DensifyOutcome { gaussians: 1000, opacity_reset: true, ..Default::default() };
    assert_eq!(outcome, Some(want));
    let after = download_state(&gpu, &mut state);
    for (got, want) in after.cloud.opacity_logits.iter().zip(reset_opacity(&case.cloud.opacity_logits, 0.01)) {
        assert!((f64::from(*got) - want).abs() < 1e-6);
    }
    assert!(after.moments[3].iter().all(|m| *m == [0.0; 2]) && after.moments[0] == case.moments[0]);
    let outcome = strategy.after_step(&mut state, &config, 600, EXTENT).unwrap().unwrap();
    assert!(outcome.opacity_reset && outcome.pruned > 0 && outcome.cloned > 0, "{outcome:?}");
    assert_silent(&gpu);
}
