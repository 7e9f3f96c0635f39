//! Packed files: precision, size, and values that do not fit the format.

use super::*;
use crate::scene_file::parse_scene_file;
use instgs_samples::sample;
use instgs_samples::{sample_scene, with_ablations, with_levels, with_low_sh_offsets, with_own};
use instgs_vk::math::rng::Rng;
use instgs_vk::math::similarity::Similarity;
use instgs_vk::scene::instanced_scene::{Instance, SourceRange};

pub(super) fn path() -> &'static Path {
    Path::new("x.instgs")
}

pub(super) fn through(scene: &InstancedScene, pack: Pack) -> Result<InstancedScene, IoError> {
    parse_scene_file(&packed_scene_file_bytes(scene, pack, path())?, path())
}

/// `instances` copies of a template of `count` Gaussians, each with offsets of its own scale.
pub(super) fn repeated(instances: usize, count: usize) -> InstancedScene {
    let mut rng = Rng::new(5);
    let mut scene = InstancedScene {
        templates: sample(3, count),
        template_ranges: vec![SourceRange { first: 0, count: count as u32 }],
        ..InstancedScene::default()
    };
    for k in 0..instances {
        let first_offset = Some((k * count) as u32);
        scene.instances.push(Instance { template: 0, world_from_template: Similarity::IDENTITY, first_offset });
        let scale = 10.0f64.powi(k as i32 % 5 - 3);
        let mut normal = || (scale * rng.normal()) as f32;
        for _ in 0..count {
            scene.offsets.means.push([normal(), normal(), normal()]);
            scene.offsets.sh_dc.push([normal(), normal(), normal()]);
            scene.offsets.opacity_logits.push(normal());
        }
    }
    scene
}

/// Largest difference, relative to `scale`; two NaN are equal.
pub(super) fn difference(a: &[f32], b: &[f32], scale: f32) -> f32 {
    assert_eq!(a.len(), b.len());
    let of = |(x, y): (&f32, &f32)| if x.to_bits() == y.to_bits() { 0.0 } else { (x - y).abs() / scale };
    a.iter().zip(b).map(of).fold(0.0, f32::max)
}

/// Scenes with offsets of every kind and without, with own Gaussians, with many instances, and with nothing.
pub(super) fn scenes() -> [InstancedScene; 6] {
    [sample_scene(), with_ablations(), with_low_sh_offsets(), with_own(), repeated(3, 20), InstancedScene::default()]
}

#[test]
fn f16_keeps_eleven_bits_and_means_and_poses_whole() -> Result<(), IoError> {
    for scene in scenes() {
        let bytes = packed_scene_file_bytes(&scene, Pack::F16, path())?;
        let back = parse_scene_file(&bytes, path())?;
        assert_eq!(packed_scene_file_bytes(&back, Pack::F16, path())?, bytes, "a second packing loses more");
        assert_eq!(
            (&back.instances, &back.groups, &back.foreign_tensors),
            (&scene.instances, &scene.groups, &scene.foreign_tensors)
        );
        assert_eq!(back.own_ranges, scene.own_ranges);
        let own = (&scene.own, &back.own);
        for (a, b) in [(&scene.templates, &back.templates), own, (&scene.background, &back.background)] {
            assert_eq!(a.means, b.means);
            let near = |a: &[f32], b: &[f32]| a.iter().zip(b).all(|(x, y)| (x - y).abs() <= x.abs() / 2048.0 + 3e-8);
            assert!(near(a.sh.as_flattened(), b.sh.as_flattened()) && near(&a.opacity_logits, &b.opacity_logits));
            assert!(near(a.quats.as_flattened(), b.quats.as_flattened()));
            assert!(near(a.log_scales.as_flattened(), b.log_scales.as_flattened()));
        }
        let (a, b) = (&scene.offsets, &back.offsets);
        let largest = |values: &[f32]| values.iter().fold(1e-30f32, |m, v| m.max(v.abs()));
        for (a, b) in [
            (a.means.as_flattened(), b.means.as_flattened()),
            (a.sh_dc.as_flattened(), b.sh_dc.as_flattened()),
            (&a.opacity_logits, &b.opacity_logits),
            (a.sh_rest.as_flattened(), b.sh_rest.as_flattened()),
            (a.log_scales.as_flattened(), b.log_scales.as_flattened()),
            (a.quats.as_flattened(), b.quats.as_flattened()),
        ] {
            assert!(difference(a, b, largest(a)) <= 1.0 / 2048.0);
        }
    }
    Ok(())
}

#[test]
fn q8_keeps_half_a_step_of_each_instance() -> Result<(), IoError> {
    let (scene, count) = (repeated(5, 40), 40);
    let back = through(&scene, Pack::Q8)?;
    assert_eq!(back.templates, through(&scene, Pack::F16)?.templates);
    for k in 0..5 {
        let records = k * count..(k + 1) * count;
        let channel = |scene: &InstancedScene, c: usize| -> Vec<f32> {
            let offsets = &scene.offsets;
            let of = |i: usize| [&offsets.means[i][..], &offsets.sh_dc[i], &offsets.opacity_logits[i..=i]].concat()[c];
            records.clone().map(of).collect()
        };
        for c in 0..7 {
            let (want, got) = (channel(&scene, c), channel(&back, c));
            let [low, high] = want.iter().fold([f32::MAX, f32::MIN], |[l, h], &v| [l.min(v), h.max(v)]);
            let error = difference(&want, &got, high - low);
            assert!(error <= 1.0 / 507.0 && error > 1e-4, "instance {k}, channel {c}: {error}");
        }
    }
    Ok(())
}

#[test]
fn q8_of_shared_overlapping_and_unused_records() -> Result<(), IoError> {
    let mut scene = repeated(4, 6);
    scene.instances[1].first_offset = Some(0);
    scene.instances[2].first_offset = Some(9);
    scene.instances[3].first_offset = None;
    let back = through(&scene, Pack::Q8)?;
    assert_eq!(back.instances, scene.instances);
    // Segments 0..6, 6..9, 9..15, 15..24: records of the four scales 0.001 .. 1 have the step of their own segment.
    let worst = |records: std::ops::Range<usize>| {
        difference(scene.offsets.means[records.clone()].as_flattened(), back.offsets.means[records].as_flattened(), 1.0)
    };
    assert!(worst(0..6) < 2e-5 && worst(6..9) < 2e-4 && worst(9..15) < 2e-3 && worst(15..24) < 2e-2);
    Ok(())
}

#[test]
fn values_that_do_not_fit_stay() -> Result<(), IoError> {
    for pack in [Pack::F16, Pack::Q8] {
        let mut scene = sample_scene();
        scene.templates.sh[3][1] = 70000.0;
        scene.templates.quats[2] = [1e-9, 0.0, 2e-9, 0.0];
        scene.background.log_scales[0][0] = f32::NEG_INFINITY;
        scene.offsets.means[5][2] = f32::NAN;
        scene.offsets.opacity_logits[1] = -1e9;
        let back = through(&scene, pack)?;
        assert_eq!((&back.templates.sh, &back.templates.quats), (&scene.templates.sh, &scene.templates.quats));
        assert_eq!(back.background.log_scales, scene.background.log_scales);
        assert_eq!(difference(back.offsets.means.as_flattened(), scene.offsets.means.as_flattened(), 1.0), 0.0);
        assert_eq!(back.offsets.opacity_logits, scene.offsets.opacity_logits);
        // The other tensors are still packed.
        assert_ne!(back.templates.log_scales, scene.templates.log_scales);
        assert_ne!(back.offsets.sh_dc, scene.offsets.sh_dc);
        let mut tiny = sample_scene();
        tiny.offsets.means.as_flattened_mut().iter_mut().for_each(|v| *v *= 1e-9);
        let (a, b) = (through(&tiny, pack)?.offsets.means, tiny.offsets.means);
        assert!(difference(a.as_flattened(), b.as_flattened(), 1e-9) <= 1.0 / 250.0);
    }
    Ok(())
}

#[test]
fn sizes_are_those_of_the_analytic_bound() -> Result<(), IoError> {
    let (k, n) = (8, 700);
    let scene = repeated(k, n);
    // Transform, template and first offset of an instance; one template range.
    let tables = 56 * k + 8;
    for (pack, want) in [
        (Pack::F32, 236 * n + 28 * k * n + tables),
        (Pack::F16, 124 * n + 14 * k * n + tables),
        (Pack::Q8, 124 * n + 7 * k * n + tables + 56 * k),
    ] {
        let bytes = packed_scene_file_bytes(&scene, pack, path())?;
        let header = 8 + u64::from_le_bytes(bytes[..8].try_into().unwrap_or_default()) as usize;
        assert_eq!(bytes.len() - header, want, "{pack:?}");
        assert!(header < 2048, "{header}");
    }
    Ok(())
}

#[test]
fn levels_follow_their_templates_into_packed_files() -> Result<(), IoError> {
    let scene = with_levels();
    for pack in [Pack::F32, Pack::F16, Pack::Q8] {
        let back = through(&scene, pack)?;
        assert_eq!(back.current_levels().len(), 3, "{pack:?}: values of half precision have the same prints");
        let cells = |scene: &InstancedScene| scene.fitted_levels.iter().map(|level| level.cell).collect::<Vec<_>>();
        assert_eq!(cells(&back), cells(&scene));
        assert_eq!(back.fitted_levels[0].gaussians.means, scene.fitted_levels[0].gaussians.means);
    }
    assert!(through(&scene, Pack::Small)?.fitted_levels.is_empty());
    // Those of a template that changed are left out.
    let mut changed = scene;
    changed.templates.sh[0][1] += 0.5;
    assert_eq!(through(&changed, Pack::F32)?.fitted_levels, changed.fitted_levels[2..]);
    Ok(())
}
