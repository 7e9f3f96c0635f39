//! Growth of single instances on the device against the twin: what few instances call for they get for their own.

use instgs_reference::densify::{
    Made, OwnGaussian, densify_sources, own_needs, own_of, seen_gaussian, shape, use_of_sources,
};
use instgs_train::device_state::DeviceState;
use instgs_train::state_file::{restore, to_checkpoint};
use instgs_vk::gpu::staging::{download, write};
use instgs_vk::kernels::Variant;
use instgs_vk::math::rng::Rng;
use instgs_vk::math::sh::widened;
use instgs_vk::scene::instanced_scene::SAME_COLOR;
use instgs_vk::scene::{InstancedScene, Parameter, SourceRange};

use crate::common::gpu::{assert_silent, gpu};
use crate::densify::{Case, EXTENT, allowed_error, bits, config, instanced_case, limits, strategy};

/// A scene whose instances share no offsets, with colour matrices and own Gaussians of two of them, and the screen statistics of
/// its offset records: one in four is well above the threshold of growth.
pub(crate) fn case_with_own(seed: u64, sh_degree: u32) -> (InstancedScene, Case, Vec<[f32; 2]>) {
    let (mut scene, case) = instanced_case(seed, sh_degree);
    let mut rng = Rng::new(seed + 2);
    let records = 3 * 300 + 150;
    let missing = records - scene.offsets.len();
    let first = scene.offsets.clone();
    (0..missing).for_each(|m| scene.offsets.push_from(&first, m));
    scene.offsets.quats = (0..records).map(|_| [(); 4].map(|()| (0.2 * rng.normal()) as f32)).collect();
    for (instance, first) in scene.instances.iter_mut().zip([Some(450), Some(300), Some(0), Some(750), None]) {
        instance.first_offset = first;
    }
    scene.instances[4].template = 1;
    let matrix = |_| SAME_COLOR.map(|row| row.map(|v| v + (0.2 * rng.normal()) as f32));
    scene.color_from_template = (0..5).map(matrix).collect();
    let of = |range: std::ops::Range<usize>| case.cloud.filtered(|i| range.contains(&i));
    (scene.own, scene.background) = (of(450..480), of(480..900));
    let range = |first, count| SourceRange { first, count };
    scene.own_ranges = vec![range(0, 10), range(10, 0), range(10, 20), range(30, 0), range(30, 0)];
    scene.validate().unwrap();
    let statistics = (0..records).map(|_| {
        let gradient = if rng.chance(0.25) { rng.range(2.2e-4, 9e-4) } else { rng.range(0.1e-4, 1.8e-4) };
        let views = f64::from(1 << rng.index(5));
        if rng.chance(0.1) { [0.0; 2] } else { [(gradient * views) as f32, views as f32] }
    });
    let statistics = statistics.collect();
    (scene, case, statistics)
}

/// What few instances call for they get for their own, behind what they had; the template does not grow there.
#[test]
fn instances_grow_alone() {
    let Some(gpu) = gpu() else { return };
    let chunk_size = Variant::for_training(gpu.caps()).workgroup_size;
    let (mut grown, mut worst) = ([0; 3], 0.0f64);
    let halves = ["densify.growth=halves", "densify.half_opacity=0.6"];
    let cases =
        [(11, 0, 5000u32, &[][..]), (12, 2, 5000, &[]), (13, 3, 1800, &[]), (14, 1, 1, &[]), (15, 1, 5000, &halves)];
    for (seed, sh_degree, cap, sets) in cases {
        let (scene, case, records) = case_with_own(seed, sh_degree);
        let cap_set = format!("max_gaussians={cap}");
        let sets = [&[&*cap_set, "joint.own_share=0.5", "densify.opacity_reset_every=0"], sets].concat();
        let config = config(&sets);
        let limits = limits(&config, 400);
        let needs = own_needs(&scene, &records, &limits);
        let want = densify_sources(&case.cloud, &use_of_sources(&scene), &needs, &case.statistics, &limits);
        let mut state = DeviceState::new(&gpu, &scene, chunk_size).unwrap();
        write(&gpu, &mut state.gradients.screen_statistics, &case.statistics).unwrap();
        write(&gpu, &mut state.gradients.record_statistics, &records).unwrap();
        let marks: Vec<[f32; 2]> = (0..3 * case.cloud.len()).map(|i| [i as f32 + 1.0, 2.0]).collect();
        write(&gpu, &mut state.moments.parameters[Parameter::Means], &marks).unwrap();
        let outcome = strategy(&gpu, sh_degree).after_step(&mut state, &config, 400, EXTENT).unwrap().unwrap();
        let got = state.download(&gpu).unwrap();
        got.validate().unwrap();
        let moments = download(&gpu, &state.moments.parameters[Parameter::Means], 3 * state.source_count()).unwrap();
        // Templates, then by instance what it keeps of its own and what it gets, then the background.
        let mut pool = got.templates.clone();
        pool.append(&got.own);
        pool.append(&got.background);
        let kept = |range: std::ops::Range<usize>| {
            want.origins.iter().filter(move |(i, _)| range.contains(i)).map(|&(i, made)| (i, made, None))
        };
        let mut order: Vec<(usize, Made, Option<usize>)> = kept(0..450).collect();
        let mut ranges = Vec::new();
        for (k, range) in scene.own_ranges.iter().enumerate() {
            let first = order.len();
            let [begin, end] = [range.first, range.first + range.count].map(|i| 450 + i as usize);
            order.extend(kept(begin..end));
            let own = want.own.get(k).map_or(&[][..], Vec::as_slice);
            order.extend(own.iter().map(|own| (own.source, own.made, Some(k))));
            ranges.push((first - got.templates.len(), order.len() - first));
        }
        order.extend(kept(480..900));
        assert_eq!(pool.len(), order.len());
        let have: Vec<(usize, usize)> = got.own_ranges.iter().map(|r| (r.first as usize, r.count as usize)).collect();
        assert_eq!(have, ranges);
        for (j, (i, made, own_of_instance)) in order.into_iter().enumerate() {
            let marked = if made == Made::Kept { [3.0 * i as f32 + 1.0, 2.0] } else { [0.0; 2] };
            assert_eq!(moments[3 * j], marked, "{j} from {i}");
            let Some(k) = own_of_instance else {
                let (mean, _) = shape(&case.cloud, (i, made), &limits);
                let error = (0..3).map(|a| (f64::from(pool.means[j][a]) - mean[a]).abs()).fold(0.0, f64::max);
                let allowed = if made == Made::Kept { 0.0 } else { allowed_error(&gpu, &case.cloud, i) };
                assert!(error <= allowed, "mean {j} from {i}, {made:?}");
                assert_eq!(bits(pool.sh_of(j)), bits(case.cloud.sh_of(i)));
                continue;
            };
            grown[usize::from(made != Made::Copy)] += 1;
            let template = scene.template_ranges[scene.instances[k].template as usize];
            let seen = seen_gaussian(&scene, k, i as u32 - template.first);
            let want = own_of(seen, &OwnGaussian { source: i, made }, &limits);
            let [mean, log_scales] = [pool.means[j], pool.log_scales[j]].map(widened);
            let quat = (0..4).map(|c| (f64::from(pool.quats[j][c]) - want.quat[c]).abs()).fold(0.0, f64::max);
            let sh = pool.sh_of(j).iter().zip(&want.sh).map(|(&a, &b)| (widened(a) - b).abs().max_element());
            let errors = [
                (mean - want.mean).abs().max_element(),
                (log_scales - want.log_scales).abs().max_element(),
                (f64::from(pool.opacity_logits[j]) - want.opacity_logit).abs(),
                quat,
                sh.fold(0.0, f64::max),
            ];
            worst = errors.into_iter().fold(worst, f64::max);
            let allowed = 1e-5 + allowed_error(&gpu, &case.cloud, i);
            let is_right = errors[0] < allowed && errors[1..].iter().all(|&e| e < 2e-5);
            assert!(is_right, "own {j} of {k} from {i}, {made:?}: {errors:?}");
        }
        grown[2] += outcome.cloned + outcome.split;
        assert_eq!(outcome.own as usize, want.own.iter().map(Vec::len).sum::<usize>());
        assert!(got.expanded_len() <= u64::from(cap) || outcome.cloned + outcome.split + outcome.own == 0);
        for k in 0..5 {
            assert_eq!(got.instances[k].world_from_template.rows(), scene.instances[k].world_from_template.rows());
        }
        let checkpoint = to_checkpoint(&gpu, &mut state, 400, false).unwrap();
        let mut restored = DeviceState::new(&gpu, &scene, chunk_size).unwrap();
        restore(&gpu, &mut restored, checkpoint.clone(), "test".as_ref()).unwrap();
        assert!(restored.download(&gpu).unwrap() == got && restored.layout == state.layout);
        assert!(to_checkpoint(&gpu, &mut restored, 400, false).unwrap() == checkpoint);
    }
    println!("own copies, own children, grown in all: {grown:?}; own ones within {worst:.1e}");
    assert!(grown.iter().all(|&n| n > 50), "{grown:?}");
    assert_silent(&gpu);
}
