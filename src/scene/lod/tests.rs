use glam::DVec3;

use super::merge::Merged;
use super::*;
use crate::math::covariance::sigmoid;
use crate::math::rng::Rng;
use crate::math::sh::widened;

/// Small Gaussians in a ball of radius 1.
fn ball(rng: &mut Rng, count: usize, sh_degree: u32) -> Gaussians {
    let mut cloud = Gaussians::with_capacity(sh_degree, count);
    for _ in 0..count {
        cloud.means.push((rng.unit_vector() * rng.uniform().cbrt()).as_vec3().to_array());
        cloud.quats.push(rng.rotation_quat().map(|q| q as f32));
        cloud.log_scales.push([0; 3].map(|_| rng.range(-6.0, -4.0) as f32));
        cloud.opacity_logits.push(rng.range(-2.0, 3.0) as f32);
        cloud.sh.extend((0..cloud.sh_coefficients()).map(|_| rng.normal_vector().as_vec3().to_array()));
    }
    cloud
}

/// Two templates, the second with an instance that has offsets: all kinds if `rare`, otherwise the usual three.
fn scene(seed: u64, rare: bool) -> InstancedScene {
    let mut rng = Rng::new(seed);
    let templates = ball(&mut rng, 1500, 1);
    let range = |first, count| SourceRange { first, count };
    let mut vectors = |count: usize, deviation: f64| -> Vec<[f32; 3]> {
        (0..count).map(|_| (deviation * rng.normal_vector()).as_vec3().to_array()).collect()
    };
    let offsets = Offsets {
        means: vectors(1000, 0.02),
        sh_dc: vectors(1000, 0.3),
        sh_rest: vectors(if rare { 3000 } else { 0 }, 0.1),
        log_scales: vectors(if rare { 1000 } else { 0 }, 0.3),
        opacity_logits: (0..1000).map(|k| (k % 5) as f32 * 0.3 - 0.6).collect(),
        quats: if rare { vec![[0.1, -0.2, 0.1, 0.0]; 1000] } else { Vec::new() },
    };
    let place = |x: f64| Similarity::from_parts(glam::DMat3::IDENTITY, 1.0, DVec3::new(x, 0.0, 0.0));
    let instance = |template, x, first_offset| Instance { template, world_from_template: place(x), first_offset };
    InstancedScene {
        templates,
        template_ranges: vec![range(0, 500), range(500, 1000)],
        instances: vec![instance(0, 0.0, None), instance(1, 3.0, None), instance(1, 6.0, Some(0))],
        offsets,
        background: ball(&mut Rng::new(seed + 1), 5000, 0),
        ..InstancedScene::default()
    }
}

#[test]
fn every_gaussian_is_in_one_merged_one_and_levels_shrink() {
    let scene = scene(1, false);
    let levels = Levels::of(&scene);
    assert_eq!(
        levels.parts.iter().take(3).map(|p| (p.owner, p.cell)).collect::<Vec<_>>(),
        [(0, 0.0), (1, 0.0), (2, 0.0)]
    );
    let range = scene.template_ranges[1];
    let rungs = ladder(&scene.templates.range(range));
    assert!(rungs.len() >= 3, "{} levels", rungs.len());
    let mut before = range.count as usize;
    for rung in &rungs {
        let mut all: Vec<u32> = rung.members.concat();
        all.sort_unstable();
        assert!(all.iter().copied().eq(0..range.count));
        assert!(10 * rung.members.len() <= 7 * before && rung.cell > 0.0);
        before = rung.members.len();
    }
    // No merged Gaussian spans more than a cell, and none larger than a cell is merged.
    let means = |i: u32| widened(scene.templates.means[(range.first + i) as usize]);
    for rung in &rungs {
        let cell = f64::from(rung.cell);
        for members in &rung.members {
            let far = |&i: &u32| (means(i) - means(members[0])).abs().max_element() <= cell;
            assert!(members.iter().all(far));
        }
    }
}

#[test]
fn cells_of_an_instance_follow_one_another() {
    let levels = Levels::of(&scene(2, false));
    for (k, coarser) in levels.coarser.iter().enumerate() {
        let own = &levels.parts[coarser.start as usize..coarser.end as usize];
        let chain: Vec<&Part> = std::iter::once(&levels.parts[k]).chain(own).collect();
        assert!(chain.len() > 2 && chain.iter().all(|p| p.owner == k as u32 && p.full == chain[0].range));
        for pair in chain.windows(2) {
            assert!(pair[0].next_cell == pair[1].cell && pair[1].cell > pair[0].cell);
            assert!(pair[1].range.count < pair[0].range.count);
        }
        assert_eq!(chain[chain.len() - 1].next_cell, NO_NEXT_CELL);
    }
}

#[test]
fn a_merged_gaussian_keeps_mass_mean_and_spread() {
    let mut pair = ball(&mut Rng::new(3), 2, 0);
    pair.means = vec![[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]];
    pair.quats = vec![[1.0, 0.0, 0.0, 0.0]; 2];
    pair.log_scales = vec![[0.0; 3]; 2];
    pair.opacity_logits = vec![0.0; 2];
    pair.sh = vec![[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let one = Merged::of(&pair, &[0, 1], None);
    assert_eq!((one.mean, one.sh[0]), ([0.0; 3], [0.5, 0.5, 0.0]));
    // Variances 1, 1 and 1 + 1.
    let mut scales = one.log_scales.map(|l| f64::from(l).exp().powi(2));
    scales.sort_by(f64::total_cmp);
    assert!(scales.iter().zip([1.0, 1.0, 2.0]).all(|(got, want)| (got - want).abs() < 1e-6), "{scales:?}");
    // Two areas of sqrt(3) with optical depth ln 2 each, spread over one of sqrt(1 + 2 + 2).
    let want = 1.0 - 0.5f64.powf(2.0 * (3.0f64 / 5.0).sqrt());
    assert!((sigmoid(f64::from(one.opacity_logit)) - want).abs() < 1e-6);
    assert_eq!(Merged::of(&pair, &[1], None).mean, pair.means[1]);
}

/// Template plus offset equals merging the instance by itself.
#[test]
fn offsets_of_levels_are_those_of_the_merged_instance() {
    for rare in [false, true] {
        let scene = scene(4, rare);
        let levels = Levels::of(&scene);
        let own = shown_cloud(&scene, &scene.instances[2]).unwrap();
        let rungs = ladder(&scene.templates.range(scene.template_ranges[1]));
        let parts = &levels.parts[levels.coarser[2].start as usize..levels.coarser[2].end as usize];
        assert_eq!(parts.len(), rungs.len());
        for (part, rung) in parts.iter().zip(&rungs) {
            let merged = merged(&scene.templates.range(scene.template_ranges[1]), &rung.members);
            let level = TemplateLevel { rung: rung.clone(), range: part.range, merged };
            let own_offsets = own.level(&scene, &level);
            let first = part.first_offset.unwrap() as usize;
            for (j, members) in rung.members.iter().enumerate() {
                let i = part.range.first as usize + j;
                let shape = (!rare).then(|| levels.templates.log_scales[i]);
                let want = Merged::of(own.cloud(), members, shape);
                let near = |base: [f32; 3], offset: [f32; 3], want: [f32; 3]| {
                    (0..3).all(|k| (base[k] + offset[k] - want[k]).abs() < 1e-5)
                };
                assert!(near(levels.templates.means[i], levels.offsets.means[first + j], want.mean));
                assert!(near(levels.templates.sh_of(i)[0], levels.offsets.sh_dc[first + j], want.sh[0]));
                let logit = levels.templates.opacity_logits[i] + levels.offsets.opacity_logits[first + j];
                assert!((logit - want.opacity_logit).abs() < 1e-5);
                if rare {
                    assert!(near(
                        levels.templates.log_scales[i],
                        levels.offsets.log_scales[first + j],
                        want.log_scales
                    ));
                    assert!(near(levels.templates.sh_of(i)[2], levels.offsets.rest_of(first + j)[1], want.sh[2]));
                }
                assert_eq!(levels.offsets.means[first + j], own_offsets.means[j]);
            }
        }
        assert_eq!(levels.coarser[1].len(), rungs.len());
        assert!(levels.parts[levels.coarser[1].start as usize].first_offset.is_none());
    }
}

/// Optimised levels are shown in place of merged ones, as long as the template is what it was; offsets stay those by merging.
#[test]
fn fitted_levels_replace_merged_ones_of_the_same_template() {
    let mut scene = scene(7, false);
    let merged = Levels::of(&scene);
    let mut fitted = merged_levels(&scene.templates.range(scene.template_ranges[1]));
    fitted.iter_mut().for_each(|level| level.gaussians.opacity_logits.iter_mut().for_each(|logit| *logit += 1.0));
    // One with another number of Gaussians, and one of another cell, fit no level.
    fitted[0].gaussians = fitted[0].gaussians.filtered(|i| i > 0);
    fitted[2].cell *= 1.01;
    scene.fitted_levels = fitted;
    scene.validate().unwrap();
    assert_eq!(scene.current_levels().len(), scene.fitted_levels.len());
    let levels = Levels::of(&scene);
    assert_eq!((&levels.parts, &levels.offsets), (&merged.parts, &merged.offsets));
    for (r, part) in merged.coarser[2].clone().map(|p| &merged.parts[p as usize]).enumerate() {
        let of = |levels: &Levels| levels.templates.opacity_logits[part.range.indices()].to_vec();
        assert_eq!(of(&levels) == of(&merged), [0, 2].contains(&r), "level {r}");
    }
    scene.templates.means[600][0] += 0.25;
    assert!(scene.current_levels().is_empty());
    let without = InstancedScene { fitted_levels: Vec::new(), ..scene.clone() };
    assert_eq!(Levels::of(&scene), Levels::of(&without));
    let count = scene.fitted_levels.len();
    assert_eq!((scene.drop_stale_levels(), scene.fitted_levels.len()), (count, 0));
}

/// The same values in half precision are the same template; others are not, nor are the same values in another order.
#[test]
fn prints_survive_half_precision_and_nothing_else() {
    let template = ball(&mut Rng::new(8), 20, 1);
    let print = template_print(&template);
    let mut halves = template.clone();
    let round = |v: &mut f32| *v = half::f16::from_f32(*v).to_f32();
    halves.quats.as_flattened_mut().iter_mut().for_each(round);
    halves.log_scales.as_flattened_mut().iter_mut().for_each(round);
    halves.opacity_logits.iter_mut().for_each(round);
    halves.sh.as_flattened_mut().iter_mut().for_each(round);
    assert!(halves != template && template_print(&halves) == print);
    let changed: [fn(&mut Gaussians); 6] = [
        |cloud| cloud.means[3][1] += 1e-6,
        |cloud| cloud.quats[3][1] += 1e-2,
        |cloud| cloud.log_scales[3][1] += 1e-2,
        |cloud| cloud.opacity_logits[3] += 1e-2,
        |cloud| cloud.sh[3][1] += 1e-2,
        |cloud| cloud.means.swap(3, 4),
    ];
    for change in changed {
        let mut other = template.clone();
        change(&mut other);
        assert!(template_print(&other) != print);
    }
}

/// Copies that share a run of offsets share those of its levels.
#[test]
fn copies_share_the_offsets_of_their_levels() {
    let mut scene = scene(9, false);
    let alone = Levels::of(&scene);
    scene.instances.extend(vec![scene.instances[2].clone(); 50]);
    let levels = Levels::of(&scene);
    assert_eq!(levels.offsets, alone.offsets);
    let firsts = |k: usize| levels.parts[levels.coarser[k].start as usize..levels.coarser[k].end as usize].iter();
    let of = |k: usize| firsts(k).map(|part| part.first_offset).collect::<Vec<_>>();
    assert!(of(2)[0].is_some() && (3..53).all(|k| of(k) == of(2)));
}

#[test]
fn blocks_are_a_partition_of_the_background() {
    let scene = scene(5, false);
    let (order, blocks) = block_order(&scene.background);
    let mut sorted = order.clone();
    sorted.sort_unstable();
    assert!(sorted.iter().copied().eq(0..5000) && (10..=19).contains(&blocks.len()), "{} blocks", blocks.len());
    let (last, full) = blocks.split_last().unwrap();
    assert!(last.count <= 512 && full.iter().all(|b| b.count == 256 || b.count == 512));
    let ends: Vec<u32> = blocks.iter().map(|b| b.first + b.count).collect();
    assert!(
        blocks[0].first == 0
            && blocks.windows(2).all(|b| b[0].first + b[0].count == b[1].first)
            && ends.last() == Some(&5000)
    );
    let levels = Levels::of(&scene);
    assert!(order.iter().enumerate().all(|(at, &i)| levels.background.means[at] == scene.background.means[i as usize]));
    let of_background = levels.parts.iter().filter(|p| p.cloud == Cloud::Background);
    assert!(of_background.clone().all(|p| p.owner == 3) && of_background.count() > 32);
}

#[test]
fn what_is_not_finite_is_left_alone_and_empty_scenes_have_no_levels() {
    let mut cloud = ball(&mut Rng::new(6), 300, 0);
    cloud.means[7] = [f32::NAN, 0.0, 0.0];
    cloud.log_scales[9][1] = f32::INFINITY;
    for rung in ladder(&cloud) {
        let alone = |i: u32| rung.members.iter().any(|m| m == &[i]);
        assert!(alone(7) && alone(9));
    }
    assert_eq!(Levels::of(&InstancedScene::default()), Levels::default());
    cloud.means.iter_mut().for_each(|m| *m = [1.0; 3]);
    assert_eq!(ladder(&cloud), []);
}
