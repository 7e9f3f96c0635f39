//! The sensitivity that `--pack small` rounds by, against central differences of the twin's pictures.

use instgs_train::measure_sensitivity;
use instgs_train::pruning::{PruneGoal, Pruned, prune, removal_costs};
use instgs_vk::math::rng::Rng;
use instgs_vk::scene::removable::{Part, Removables};
use instgs_vk::scene::{Camera, InstancedScene, Parameter, SourceRange};

use crate::common::gpu::{assert_silent, gpu};
use crate::common::random_scene::{RandomCase, add_own_gaussians, add_rare_offsets, random_case};

/// Probes: the estimate of one value has a relative deviation of sqrt(2 / 600) = 6 %.
const PROBES: usize = 600;

/// The number at `(row, value)` of a parameter.
fn number(scene: &mut InstancedScene, parameter: Parameter, row: usize, value: usize) -> &mut f32 {
    let templates = scene.templates.len();
    let own = scene.own.len();
    let (cloud, local) = match row {
        row if row < templates => (&mut scene.templates, row),
        row if row < templates + own => (&mut scene.own, row - templates),
        row => (&mut scene.background, row.saturating_sub(templates + own)),
    };
    let coefficients = cloud.sh_coefficients();
    match parameter {
        Parameter::Means => &mut cloud.means[local][value],
        Parameter::LogScales => &mut cloud.log_scales[local][value],
        Parameter::OpacityLogits => &mut cloud.opacity_logits[local],
        Parameter::Quats => &mut cloud.quats[local][value],
        Parameter::Sh0 => &mut cloud.sh[local * coefficients][value],
        Parameter::OffsetMeans => &mut scene.offsets.means[row][value],
        Parameter::OffsetShDc => &mut scene.offsets.sh_dc[row][value],
        Parameter::OffsetOpacityLogits => &mut scene.offsets.opacity_logits[row],
        Parameter::OffsetLogScales => &mut scene.offsets.log_scales[row][value],
        Parameter::OffsetQuats => &mut scene.offsets.quats[row][value],
        other => panic!("{other:?} is not looked at"),
    }
}

/// Mean squared derivative of the twin's picture.
fn squared_derivative(scene: &InstancedScene, camera: &Camera, parameter: Parameter, row: usize, value: usize) -> f64 {
    // Smaller steps see more of the jumps where an alpha falls below 1/255, which have no derivative.
    let step = if matches!(parameter, Parameter::Means | Parameter::OffsetMeans) { 1e-3 } else { 8e-3 };
    let moved = |by: f32| {
        let mut scene = scene.clone();
        let number = number(&mut scene, parameter, row, value);
        *number += by;
        let at = f64::from(*number);
        (instgs_reference::render(&scene, camera, &instgs_reference::RenderOptions::default()).color, at)
    };
    let ((high, at_high), (low, at_low)) = (moved(step), moved(-step));
    let pairs = high.as_flattened().iter().zip(low.as_flattened());
    let squares: f64 = pairs.map(|(a, b)| ((a - b) / (at_high - at_low)).powi(2)).sum();
    squares / (3.0 * high.len() as f64)
}

#[test]
fn sensitivity_is_the_squared_derivative_of_pictures() {
    let Some(gpu) = gpu() else { return };
    let mut case = random_case(3);
    add_rare_offsets(&mut Rng::new(4), &mut case.scene, u64::MAX);
    let (scene, camera) = (&case.scene, &case.camera);
    let cameras = vec![camera.clone(); PROBES];
    let mut views = 0;
    let measured = measure_sensitivity(&gpu, scene, &cameras, || views += 1).unwrap();
    assert!(views == PROBES && measured.fits(scene));
    let parameters = [
        (Parameter::Means, 3),
        (Parameter::LogScales, 3),
        (Parameter::OpacityLogits, 1),
        (Parameter::Quats, 4),
        (Parameter::Sh0, 3),
        (Parameter::OffsetMeans, 3),
        (Parameter::OffsetShDc, 3),
        (Parameter::OffsetOpacityLogits, 1),
        (Parameter::OffsetLogScales, 3),
        (Parameter::OffsetQuats, 4),
    ];
    let mut rng = Rng::new(5);
    for (parameter, width) in parameters {
        let rows = &measured.rows[parameter];
        let (mut want, mut got) = (0.0, 0.0);
        // Those that show most say most.
        let mut order: Vec<usize> = (0..rows.len()).collect();
        order.sort_by(|&a, &b| rows[b].total_cmp(&rows[a]));
        let picked = order.iter().take(4).copied().chain((0..4).map(|_| rng.index(rows.len())));
        for row in picked.collect::<Vec<_>>() {
            let of_value = |value| squared_derivative(scene, camera, parameter, row, value);
            want += (0..width).map(of_value).sum::<f64>() / width as f64;
            got += f64::from(rows[row]);
        }
        println!("{parameter:?}: measured {got:.4e}, differences {want:.4e}");
        assert!(want > 0.0 && (got / want - 1.0).abs() < 0.15, "{parameter:?}: {got} {want}");
    }
    let again = measure_sensitivity(&gpu, scene, &cameras[..5], || ()).unwrap();
    assert_eq!(again, measure_sensitivity(&gpu, scene, &cameras[..5], || ()).unwrap());
    assert!(measure_sensitivity(&gpu, scene, &[], || ()).is_err());
    assert_silent(&gpu);
}

/// Mean squared difference of the twin's pictures of two scenes.
fn squared_difference(scenes: [&InstancedScene; 2], camera: &Camera) -> f64 {
    let options = instgs_reference::RenderOptions::default();
    let [a, b] = scenes.map(|scene| instgs_reference::render(scene, camera, &options).color);
    let squares: f64 = a.as_flattened().iter().zip(b.as_flattened()).map(|(a, b)| (a - b).powi(2)).sum();
    squares / (3.0 * a.len() as f64)
}

/// A case with parts of every kind: instances with and without offsets, own Gaussians, and a template as background.
fn case_of_all_kinds() -> RandomCase {
    let mut case = random_case(3);
    add_own_gaussians(&mut Rng::new(6), &mut case);
    let scene = &mut case.scene;
    let instance = scene.instances.iter().position(|instance| instance.first_offset.is_some());
    // The template of one instance is its alone and has no offsets.
    let instance = &mut scene.instances[instance.expect("an instance with offsets")];
    let range = scene.template_ranges[instance.template as usize];
    let alone = scene.templates.range(range);
    let first = scene.templates.len() as u32;
    scene.templates.append(&alone);
    scene.background.append(&alone.placed(instance.world_from_template));
    instance.template = scene.template_ranges.len() as u32;
    instance.first_offset = None;
    scene.template_ranges.push(SourceRange { first, count: range.count });
    scene.validate().unwrap();
    case
}

/// True if a template's Gaussian is one part: all of its instances show it in the same way.
fn is_shown_once(removables: &Removables, of: u32) -> bool {
    let shows = |part: Part| matches!(part, Part::Record { gaussian, .. } | Part::Template(gaussian) if gaussian == of);
    removables.all.iter().filter(|removable| shows(removable.part)).count() == 1
}

#[test]
fn what_a_removal_costs_is_what_pictures_lose() {
    let Some(gpu) = gpu() else { return };
    let case = case_of_all_kinds();
    let (scene, camera) = (&case.scene, &case.camera);
    let cameras = vec![camera.clone(); PROBES];
    let sensitivity = measure_sensitivity(&gpu, scene, &cameras, || ()).unwrap();
    let removables = Removables::of(scene);
    let costs = removal_costs(scene, &removables, &sensitivity);
    let mut order: Vec<usize> = (0..costs.len()).collect();
    order.sort_by(|&a, &b| costs[b].total_cmp(&costs[a]));
    // Of every kind those that cost most, and some of the others.
    let kinds: [fn(Part) -> bool; 4] = [
        |part| matches!(part, Part::Record { .. }),
        |part| matches!(part, Part::Template(_)),
        |part| matches!(part, Part::Own(_)),
        |part| matches!(part, Part::Background(_)),
    ];
    for (kind, is_of_kind) in kinds.into_iter().enumerate() {
        // Without offsets a template's Gaussian only goes with all others of it.
        let goes_alone = |i: usize| match removables.all[i].part {
            Part::Template(gaussian) => is_shown_once(&removables, gaussian),
            _ => true,
        };
        let is_picked = |&i: &usize| is_of_kind(removables.all[i].part) && goes_alone(i);
        let of_kind: Vec<usize> = order.iter().copied().filter(is_picked).collect();
        let (mut want, mut got) = (0.0, 0.0);
        for &i in of_kind.iter().take(6).chain(of_kind.iter().skip(6).step_by(7).take(6)) {
            let marks: Vec<bool> = (0..costs.len()).map(|j| i == j).collect();
            want += squared_difference([scene, &removables.removed(scene, &marks).0], camera);
            got += costs[i];
        }
        println!("kind {kind}: predicted {got:.4e}, differences {want:.4e}, {} parts", of_kind.len());
        assert!(want > 0.0 && (got / want - 1.0).abs() < 0.15, "kind {kind}: {got} {want}");
    }
    // Half of what is drawn goes, and the order of costs shows: the other half would be missed far more.
    let kept = |goal| -> Pruned { prune(scene, &sensitivity, &cameras[..1], goal) };
    let half = kept(PruneGoal::Keep(0.5));
    half.scene.validate().unwrap();
    let lost = squared_difference([scene, &half.scene], camera);
    let nothing = InstancedScene { pixel_filter: scene.pixel_filter, ..InstancedScene::default() };
    assert!(half.fewer > 0 && lost < 0.2 * squared_difference([scene, &nothing], camera), "{lost}");
    let (close, closer) = (kept(PruneGoal::PicturePsnr(30.0)), kept(PruneGoal::PicturePsnr(50.0)));
    assert!(close.fewer > closer.fewer && closer.picture_psnr_db.is_none_or(|psnr| psnr >= 50.0));
    assert_eq!(kept(PruneGoal::Keep(1.0)).scene, *scene);
    assert_silent(&gpu);
}
