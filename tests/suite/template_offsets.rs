//! What an instance has of its own in a template that is built: offsets from the template's Gaussians to its own, halves where two
//! stand for one, and Gaussians that no template Gaussian stands for.

use glam::{DMat3, DVec3};
use instgs_objects::template::{Doubles, OffsetInit, OffsetKinds, TemplateOptions, Unmatched};
use instgs_vk::math::covariance::{rotation_from_quat, sigmoid};
use instgs_vk::math::nearest::PointSet;
use instgs_vk::math::rng::Rng;
use instgs_vk::math::sh::{ShRotation, widened};
use instgs_vk::scene::Gaussians;

use crate::template::{build_one, lump, lumps, own, placed};

/// Every kind of offset: template plus offset is one of the instance's Gaussians in the cloud, parameter by parameter. Where several
/// are the same one, they cover together what it covers.
#[test]
fn template_plus_offset_is_an_own_gaussian() {
    let input = lumps(1, &[300, 280, 310]);
    let kinds = OffsetKinds { sh_degree: 3, covariance: true, ..OffsetKinds::default() };
    let doubles = Doubles::Alike;
    let built = build_one(&input, &TemplateOptions { kinds, doubles, ..TemplateOptions::default() });
    built.scene.validate().unwrap();
    let (template, offsets) = (&built.scene.templates, &built.scene.offsets);
    assert_eq!((template.len(), offsets.len(), offsets.quats.len(), offsets.sh_rest.len()), (297, 891, 891, 3 * 891));
    for (k, pose) in input.group.instances.iter().enumerate() {
        let own = own(&input, k);
        let (pose, mut used) = (pose.world_from_template, 0);
        let world: Vec<[f32; 3]> = own.means.clone();
        let set = PointSet::new(&world);
        let sh_rotation = ShRotation::new(pose.rotation());
        let mut transmitted = vec![None; own.len()];
        for i in 0..297 {
            let o = 297 * k + i;
            let mean = pose.transform_point(widened(template.means[i]) + widened(offsets.means[o]));
            let near = set.nearest(mean.as_vec3().to_array(), 1)[0];
            if near.squared_distance > 1e-8 {
                continue;
            }
            let j = near.index as usize;
            used += 1;
            let log_scales = widened(template.log_scales[i]) + widened(offsets.log_scales[o]) + pose.scale().ln();
            let quat = std::array::from_fn(|c| f64::from(template.quats[i][c]) + f64::from(offsets.quats[o][c]));
            let turned = pose.rotation() * rotation_from_quat(quat);
            // The axes have the order of the template's; the logarithm of the covariance has none.
            let log_covariance = |r: DMat3, logs: DVec3| r * DMat3::from_diagonal(logs) * r.transpose();
            let of_own = rotation_from_quat(own.quats[j].map(f64::from));
            let want = log_covariance(of_own, widened(own.log_scales[j]));
            let error = log_covariance(turned, log_scales) - want;
            assert!(error.to_cols_array().iter().all(|v| v.abs() < 2e-5), "{error}");
            let mut sh: Vec<DVec3> = template.sh_of(i).iter().map(|&c| widened(c)).collect();
            sh[0] += widened(offsets.sh_dc[o]);
            (0..3).for_each(|c| sh[c + 1] += widened(offsets.sh_rest[3 * o + c]));
            let sh = sh_rotation.rotate(&sh);
            assert!(sh.iter().zip(own.sh_of(j)).all(|(a, b)| a.distance(widened(*b)) < 1e-5));
            let logit = template.opacity_logits[i] + offsets.opacity_logits[o];
            *transmitted[j].get_or_insert(1.0) *= sigmoid(-f64::from(logit));
        }
        for (j, transmitted) in transmitted.into_iter().enumerate() {
            let want = sigmoid(-f64::from(own.opacity_logits[j].clamp(-7.0, 7.0)));
            assert!(transmitted.is_none_or(|t: f64| (t / want - 1.0).abs() < 1e-5), "{transmitted:?} {want}");
        }
        assert_eq!(used, 297 - built.report[0].instances[k].lacking);
    }
}

/// Two that stand for the same Gaussian of an instance are its halves: one to each side of it, with its longest axis divided by 1.6 and
/// 0.6 of its opacity. A template of twice as many has two for most.
#[test]
fn two_for_one_are_its_halves() {
    let input = lumps(1, &[300, 300, 300]);
    let kinds = OffsetKinds { covariance: true, ..OffsetKinds::default() };
    let options = TemplateOptions { kinds, count_factor: 2.0, ..TemplateOptions::default() };
    let built = build_one(&input, &options);
    let (template, offsets, count) = (&built.scene.templates, &built.scene.offsets, built.scene.templates.len());
    assert_eq!(count, 600);
    let mut pairs = 0;
    for (k, pose) in input.group.instances.iter().enumerate() {
        let (own, pose) = (own(&input, k), pose.world_from_template);
        let of = |i: usize| {
            let o = count * k + i;
            let mean = pose.transform_point(widened(template.means[i]) + widened(offsets.means[o]));
            let opacity = sigmoid(f64::from(template.opacity_logits[i] + offsets.opacity_logits[o]));
            let logs = widened(template.log_scales[i]) + widened(offsets.log_scales[o]) + pose.scale().ln();
            (mean, opacity, logs)
        };
        let all: Vec<(DVec3, f64, DVec3)> = (0..count).map(of).collect();
        for j in 0..own.len() {
            let (mean, logs) = (widened(own.means[j]), widened(own.log_scales[j]));
            let away = (1.0f64 - 1.6f64.powi(-2)).sqrt() * logs.max_element().exp();
            let is_half = |(at, ..): &&(DVec3, f64, DVec3)| (at.distance(mean) - away).abs() < 1e-3 * away;
            let halves: Vec<_> = all.iter().filter(is_half).collect();
            let [one, other] = halves[..] else { continue };
            if (one.0 + other.0).distance(2.0 * mean) > 1e-3 * away {
                continue;
            }
            pairs += 1;
            let opacity = 0.6 * sigmoid(f64::from(own.opacity_logits[j].clamp(-7.0, 7.0)));
            for (_, of_half, logs_of_half) in [one, other] {
                assert!((of_half - opacity.max(sigmoid(-4.6).min(opacity / 0.6))).abs() < 1e-4, "{of_half} {opacity}");
                let shorter = logs.element_sum() - logs_of_half.element_sum();
                assert!((shorter - 1.6f64.ln()).abs() < 1e-3, "{shorter}");
            }
        }
    }
    assert!(pairs > 500, "{pairs} of 900");
}

/// Offsets not wanted are zero, or empty; without any, instances have no records.
#[test]
fn only_wanted_kinds_differ() {
    let input = lumps(2, &[200, 200]);
    let none = OffsetKinds { position: false, sh_dc: false, opacity: false, sh_degree: 0, covariance: false };
    for kind in 0..4 {
        let kinds = OffsetKinds { position: kind == 1, sh_dc: kind == 2, opacity: kind == 3, ..none };
        let scene = build_one(&input, &TemplateOptions { kinds, ..TemplateOptions::default() }).scene;
        let offsets = scene.offsets;
        assert_eq!(offsets.means.iter().flatten().any(|&v| v != 0.0), kinds.position);
        assert_eq!(offsets.sh_dc.iter().flatten().any(|&v| v != 0.0), kinds.sh_dc);
        assert_eq!(offsets.opacity_logits.iter().any(|&v| v != 0.0), kinds.opacity);
        assert!(scene.instances.iter().all(|i| i.first_offset.is_some() == kinds.any()));
        assert!(
            offsets.len() == if kind == 0 { 0 } else { 400 } && offsets.sh_rest.is_empty() && offsets.quats.is_empty()
        );
    }
    let zero = build_one(&input, &TemplateOptions { offsets: OffsetInit::Zero, ..TemplateOptions::default() });
    assert!(zero.scene.offsets.means.iter().flatten().all(|&v| v == 0.0) && zero.scene.offsets.len() == 400);
}

/// The half that one instance lacks is transparent there, and only there.
#[test]
fn a_missing_part_is_transparent() {
    let mut rng = Rng::new(4);
    let whole = |rng: &mut Rng| lump(rng, 4000);
    let mut half = whole(&mut rng);
    half = half.filtered(|i| half.means[i][2] < 0.2);
    let objects = [whole(&mut rng), half, whole(&mut rng)];
    let input = placed(&mut rng, &objects, 0.0);
    let built = build_one(&input, &TemplateOptions::default());
    let template = &built.scene.templates;
    let n = template.len();
    let transparent = |k: usize, i: usize| {
        sigmoid(f64::from(template.opacity_logits[i] + built.scene.offsets.opacity_logits[n * k + i])) < 0.011
    };
    let upper: Vec<usize> = (0..n).filter(|&i| template.means[i][2] > 0.6).collect();
    // Some stand so alone that what is far is near for them.
    let hidden: Vec<usize> = upper.iter().copied().filter(|&i| transparent(1, i)).collect();
    assert!(upper.len() > 300 && hidden.len() * 100 > upper.len() * 97, "{} of {}", hidden.len(), upper.len());
    assert!(hidden.iter().all(|&i| built.scene.offsets.means[n + i] == [0.0; 3]));
    // Draws of 3 % are as transparent themselves.
    assert!(upper.iter().filter(|&&i| transparent(0, i)).count() < upper.len() / 10);
    let lacking: Vec<usize> = built.report[0].instances.iter().map(|i| i.lacking).collect();
    assert!(lacking[1] >= hidden.len() && lacking[0] < n / 50 && lacking[2] < n / 50, "{lacking:?}");
}

/// With own Gaussians nothing of the cloud is lost: every Gaussian of an instance is where it was, those without a match bit by
/// bit up to rounding, and a part that one instance alone has is among them.
#[test]
fn what_has_no_match_becomes_its_own() {
    let mut rng = Rng::new(9);
    let mut objects: Vec<Gaussians> = (0..3).map(|_| lump(&mut rng, 700)).collect();
    let mut rack = lump(&mut rng, 100);
    rack.means.iter_mut().for_each(|mean| mean[2] = 3.0 + 0.05 * mean[2]);
    objects[1].append(&rack);
    let input = placed(&mut rng, &objects, 0.0);
    let lost = |unmatched| {
        let built = build_one(&input, &TemplateOptions { unmatched, ..TemplateOptions::default() });
        built.scene.validate().unwrap();
        let flat = built.scene.flatten();
        let set = PointSet::new(&flat.means);
        let far = |i: &usize| set.nearest(input.cloud.means[*i], 1)[0].squared_distance > 1e-8;
        let lost = (0..input.cloud.len()).filter(|&i| input.labels[i] != 0).filter(far).count();
        (lost, built)
    };
    let (lost_without, dropped) = lost(Unmatched::Drop);
    assert!(lost_without > 100 && dropped.scene.own.is_empty() && dropped.scene.own_ranges.is_empty());
    let (lost, built) = lost(Unmatched::Own);
    assert_eq!(lost, 0);
    let own: Vec<usize> = built.scene.own_ranges.iter().map(|range| range.count as usize).collect();
    let reported: Vec<usize> = built.report[0].instances.iter().map(|i| i.own).collect();
    assert_eq!(own, reported);
    // What is near the rack in the template's frame is nearly all instance 1's own.
    let high = |k: usize| {
        let range = built.scene.own_range(k).indices();
        range.filter(|&i| built.scene.own.means[i][2] > 2.0).count()
    };
    assert!(high(1) >= 50 && high(0) == 0 && high(2) == 0, "{} {} {}", high(0), high(1), high(2));
}
