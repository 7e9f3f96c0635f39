//! Kernel `tile_surface` against its twin: random scenes, with and without instances' own Gaussians, in one piece and in depth slabs,
//! with tiles of two sizes.

use instgs_reference::preprocess_instance_expand::sources;
use instgs_reference::tile_blend::relaxed_limits;
use instgs_reference::tile_surface::surfaces;
use instgs_reference::{View, splats_in_depth_order};
use instgs_vk::kernels::Variant;
use instgs_vk::math::rng::Rng;
use instgs_vk::render::{RenderOptions, Renderer, Surfaces};

use crate::common::gpu::{assert_silent, device_options, gpu};
use crate::common::random_scene::{RandomCase, add_own_gaussians, random_case};

/// The case of a seed; instances of every other one have own Gaussians, too.
fn case_of(seed: u64) -> RandomCase {
    let mut case = random_case(seed);
    if seed % 2 == 1 {
        add_own_gaussians(&mut Rng::new(seed).fork(6), &mut case);
        case.scene.validate().unwrap();
    }
    case
}

#[test]
fn surfaces_are_what_the_twin_says_and_slabs_change_nothing() {
    let Some(gpu) = gpu() else { return };
    let own = Variant::for_device(gpu.caps());
    let mut renderer = Renderer::new(&gpu).unwrap();
    // Larger tiles, whose blocks skip splats that do not reach them.
    let other = Variant { tile_size: if own.tile_size == 8 { 16 } else { 8 }, ..own };
    let mut other = Renderer::with_variant(&gpu, other, false).unwrap();
    let mut on_device = Surfaces::new(&gpu).unwrap();
    let (mut compared, mut fragile, mut slabs, mut kinds) = (0, 0, 0, std::collections::BTreeSet::new());
    let (mut own_seen, mut after_own) = (0, 0);
    for seed in 0..24 {
        let case = case_of(seed);
        let is_own = |point: [u32; 2]| {
            let instance = case.scene.instances.get(point[0] as usize);
            instance.is_some_and(|i| point[1] >= case.scene.template_ranges[i.template as usize].count)
        };
        let view = View::device(&case.camera, &case.options);
        let splats = splats_in_depth_order(&sources(&case.scene), &view, &relaxed_limits(&view));
        let want = surfaces(&view, &splats, &case.scene);
        let device = renderer.upload(&case.scene).unwrap();
        let options = device_options(&case.options);
        renderer.render_with_surfaces(&device, &case.camera, &options, &mut on_device).unwrap();
        let got = on_device.download().unwrap();
        assert_eq!(got.len(), want.len());
        for (i, (got, want)) in got.iter().zip(&want).enumerate() {
            fragile += u32::from(!want.robust);
            if want.robust {
                let want = want.point.map(|point| [point.instance, point.local]);
                assert_eq!(got.map(|point| [point.instance, point.local]), want, "seed {seed}, pixel {i}");
                compared += 1;
                own_seen += u32::from(want.is_some_and(is_own));
                // The first instance has own Gaussians: what comes after it counts from behind them.
                after_own += u32::from(!case.scene.own.is_empty() && want.is_some_and(|[k, _]| k > 0));
                kinds.insert(want.map(|[k, _]| (k as usize).min(case.scene.instances.len())));
            }
        }
        other.render_with_surfaces(&device, &case.camera, &options, &mut on_device).unwrap();
        assert!(on_device.download().unwrap() == got, "seed {seed}: another tile size");
        renderer.render_with_surfaces(&device, &case.camera, &options, &mut on_device).unwrap();
        let [x, y] = [case.camera.width / 2, case.camera.height / 2];
        assert_eq!(on_device.at([x, y]).unwrap(), got[(y * case.camera.width + x) as usize]);
        assert_eq!(on_device.at([case.camera.width, y]).unwrap(), None);
        let few = RenderOptions { max_intersections: Some(1), ..options };
        let stats = renderer.render_with_surfaces(&device, &case.camera, &few, &mut on_device).unwrap();
        assert!(on_device.download().unwrap() == got, "seed {seed}: {} slabs", stats.slabs);
        slabs = slabs.max(stats.slabs);
    }
    println!("{compared} pixels, {fragile} fragile, up to {slabs} slabs, {} kinds of surface", kinds.len());
    println!("{own_seen} pixels show own Gaussians, {after_own} something after some in flat order");
    assert!(compared > 20_000 && fragile * 20 < compared && slabs > 2 && kinds.len() > 3 && kinds.contains(&None));
    assert!(own_seen > 500 && after_own > 500, "{own_seen} {after_own}");
    assert_silent(&gpu);
}
