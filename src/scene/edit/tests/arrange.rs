//! Aligning, distributing, mirroring; templates of one's own, Gaussians given and taken, light of neighbours.

use super::*;
use crate::math::covariance::covariance;
use crate::math::sh::eval_sh;

fn edit(scene: &mut InstancedScene, edit: Edit) -> EditOutcome {
    let outcome = apply(scene, &edit).unwrap();
    scene.validate().unwrap();
    outcome
}

fn centres_along(scene: &InstancedScene, axis: DVec3) -> Vec<f64> {
    instance_centres(scene, 0..scene.instances.len()).into_iter().map(|centre| axis.dot(centre)).collect()
}

#[test]
fn centres_are_aligned_along_their_axis_alone() {
    for (to, want) in [(AlignTo::Lowest, 0usize), (AlignTo::Highest, 3)] {
        let mut scene = scene();
        let before = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| centres_along(&scene, axis));
        edit(&mut scene, Edit::Align { which: Selector::Indices(vec![0, 2, 3]), axis: 2.0 * DVec3::X, to });
        let after = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| centres_along(&scene, axis));
        for k in [0, 2, 3] {
            assert!((after[0][k] - before[0][want]).abs() < 1e-5);
            assert!((after[1][k] - before[1][k]).abs() < 1e-5 && (after[2][k] - before[2][k]).abs() < 1e-5);
        }
        assert!(after[0][1] == before[0][1] && after[0][4] == before[0][4]);
    }
    let mut scene = scene();
    let error = apply(&mut scene, &Edit::Align { which: Selector::Index(0), axis: DVec3::X, to: AlignTo::Mean });
    assert!(error.unwrap_err().to_string().contains("two or more"));
}

#[test]
fn distances_are_equal_and_the_ends_stay() {
    let mut scene = scene();
    edit(&mut scene, Edit::MoveBy { which: Selector::Index(2), by: DVec3::new(1.7, 0.0, 0.0) });
    let before = centres_along(&scene, DVec3::X);
    edit(&mut scene, Edit::Distribute { which: Selector::Indices(vec![0, 1, 2, 3, 4]), axis: DVec3::X });
    let mut after = centres_along(&scene, DVec3::X);
    assert!((after[0] - before[0]).abs() < 1e-5 && (after[4] - before[4]).abs() < 1e-5);
    after.sort_by(f64::total_cmp);
    let steps: Vec<f64> = after.windows(2).map(|pair| pair[1] - pair[0]).collect();
    assert!(steps.iter().all(|step| (step - steps[0]).abs() < 1e-4), "{steps:?}");
}

/// The mirrored scene is the mirror image: means, covariances and colours as seen from the mirrored side.
#[test]
fn mirrored_is_the_mirror_image() {
    let mut scene = scene();
    scene.own = row(2);
    scene.own_ranges = vec![SourceRange::default(); 5];
    scene.own_ranges[2] = SourceRange { first: 0, count: 2 };
    let before = scene.clone();
    let (normal, point) = (DVec3::new(1.0, 2.0, -0.5).normalize(), DVec3::new(0.3, 0.1, 0.7));
    let which = || Selector::Indices(vec![0, 1, 2]);
    let mirror = || Edit::Mirror { which: which(), normal, point: Some(point) };
    edit(&mut scene, mirror());
    let across = DMat3::IDENTITY - 2.0 * DMat3::from_cols(normal.x * normal, normal.y * normal, normal.z * normal);
    let (was, is) = (before.flatten(), scene.flatten());
    assert_eq!(was.len(), is.len());
    let quat = |cloud: &Gaussians, i: usize| cloud.quats[i].map(f64::from);
    // Instances 0 to 2 have 2 + 3 + 2 + 2 own Gaussians.
    for i in 0..9 {
        let want = across * (widened(was.means[i]) - point) + point;
        assert!(want.distance(widened(is.means[i])) < 1e-5, "{i}");
        let scales = |cloud: &Gaussians| widened(cloud.log_scales[i]);
        let want = across * covariance(quat(&was, i), scales(&was)) * across;
        let got = covariance(quat(&is, i), scales(&is));
        assert!((want - got).to_cols_array().iter().all(|v| v.abs() < 1e-5), "{i}");
        for view in [DVec3::X, DVec3::new(0.3, -0.5, 0.8).normalize()] {
            let want = eval_sh(was.sh_degree, was.sh_of(i), view);
            assert!(want.distance(eval_sh(is.sh_degree, is.sh_of(i), across * view)) < 1e-4, "{i}");
        }
    }
    assert!((9..was.len()).all(|i| was.means[i] == is.means[i]), "the others stay");
    let ids = |scene: &InstancedScene| scene.instance_labels().iter().map(|label| label.id).collect::<Vec<_>>();
    assert_eq!(ids(&scene), ids(&before));
    // Mirrored again, the instances have their old templates; no third ones are made.
    let templates = scene.template_ranges.len();
    edit(&mut scene, mirror());
    assert_eq!(scene.template_ranges.len(), templates);
    assert!((0..5).all(|k| scene.instances[k].template == before.instances[k].template));
}

#[test]
fn a_unique_instance_looks_as_before_and_is_alone() {
    let mut scene = scene();
    let matrix = [[0.9, 0.1, 0.0, 0.05], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.1, 0.0]];
    scene.color_from_template = vec![matrix; 5];
    let before = scene.flatten();
    let outcome = edit(&mut scene, Edit::MakeUnique { which: Selector::Index(3) });
    assert_eq!(outcome.changed, [3]);
    let after = scene.flatten();
    let near = |a: &[f32], b: &[f32]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-4);
    assert!(near(before.means.as_flattened(), after.means.as_flattened()));
    assert!(near(before.sh.as_flattened(), after.sh.as_flattened()));
    let template = scene.instances[3].template;
    assert_eq!(scene.instances.iter().filter(|i| i.template == template).count(), 1);
    let group = scene.instance_labels()[3];
    assert_eq!((group.id, scene.groups[group.group.unwrap()].name.as_deref()), (Some(7), Some("chair 2")));
    // The template of the others no longer reaches it.
    edit(
        &mut scene,
        Edit::Crop { template: 0, corners: [DVec3::splat(-9.0), DVec3::new(0.0, 9.0, 9.0)], keep: Keep::Inside },
    );
    assert_eq!(scene.template_ranges[template as usize].count, 2);
    let again = edit(&mut scene, Edit::MakeUnique { which: Selector::Index(3) });
    assert!(again.changed.is_empty() && again.warnings.len() == 1);
}

#[test]
fn what_is_reset_is_its_template() {
    let mut scene = scene();
    let outcome = edit(&mut scene, Edit::Reset { which: Selector::Indices(vec![0, 2]), what: Extra::All });
    assert_eq!((outcome.changed, scene.instances[0].first_offset), (vec![0], None));
    assert_eq!(scene.offsets.len(), 5, "its run of two is gone");
    let again = edit(&mut scene, Edit::Reset { which: Selector::Index(0), what: Extra::Offsets });
    assert!(again.changed.is_empty() && again.warnings.len() == 1);
}

/// Gaussians that are given and taken back are where they were, and in between they move with the instance.
#[test]
fn gaussians_are_given_and_taken_back() {
    let mut scene = scene();
    let inside = instance_centres(&scene, [1])[0];
    scene.background = row(1);
    scene.background.means[0] = inside.as_vec3().to_array();
    let far = Gaussians { means: vec![[90.0; 3]], ..row(1) };
    scene.background.append(&far);
    let before = scene.clone();
    edit(&mut scene, Edit::Give { which: Selector::Index(1), margin: 0.5 });
    assert_eq!((scene.background.len(), scene.own_range(1).count), (1, 1));
    edit(&mut scene, Edit::MoveBy { which: Selector::Index(1), by: DVec3::Y });
    edit(&mut scene, Edit::Take { which: Selector::Index(1) });
    assert_eq!((scene.background.len(), scene.own.len()), (2, 0));
    assert_eq!(scene.background.means[0], far.means[0]);
    assert!(widened(scene.background.means[1]).distance(inside + DVec3::Y) < 1e-5);
    let [want, got] = [before.background.sh_of(0), scene.background.sh_of(1)].map(|sh| eval_sh(1, sh, DVec3::X));
    assert!(want.distance(got) < 1e-5);
    let none = apply(&mut scene, &Edit::Take { which: Selector::Index(1) });
    assert!(none.unwrap_err().to_string().contains("no own Gaussians"));
    assert!(apply(&mut scene, &Edit::Give { which: Selector::Index(0), margin: 0.0 }).is_err());
}

#[test]
fn sh_bands_that_are_lost_on_the_way_are_warned_of() {
    // The templates' degree is 1.
    for (background, given, taken) in
        [(2, Some("above 1: the templates"), None), (1, None, None), (0, None, Some("above 0"))]
    {
        let mut scene = scene();
        scene.background = row(1);
        scene.background.set_sh_degree(background);
        scene.background.means[0] = instance_centres(&scene, [1])[0].as_vec3().to_array();
        // One stays, so that the background keeps its degree.
        let mut far = Gaussians { means: vec![[90.0; 3]], ..row(1) };
        far.set_sh_degree(background);
        scene.background.append(&far);
        let warned = |outcome: EditOutcome, want: Option<&str>| {
            assert_eq!(outcome.warnings.len(), usize::from(want.is_some()), "{:?}", outcome.warnings);
            assert!(
                outcome.warnings.iter().zip(want).all(|(text, want)| text.contains(want)),
                "{:?}",
                outcome.warnings
            );
        };
        warned(edit(&mut scene, Edit::Give { which: Selector::Index(1), margin: 0.5 }), given);
        warned(edit(&mut scene, Edit::Take { which: Selector::Index(1) }), taken);
    }
    let mut scene = with_own();
    scene.background.set_sh_degree(0);
    let outcome = edit(&mut scene, Edit::Take { which: which("template:0") });
    assert_eq!(outcome.changed, [0, 2]);
    assert_eq!(outcome.warnings, ["their colours lose SH bands above 0: the background has none"]);
}

#[test]
fn light_comes_from_neighbours_of_the_same_template() {
    let mut scene = scene();
    assert!(apply(&mut scene, &Edit::Relight { which: Selector::Index(0) }).is_err(), "no matrices");
    let lit = |shift: f32| {
        let mut matrix = SAME_COLOR;
        matrix[0][3] = shift;
        matrix
    };
    scene.color_from_template = [9.0, 5.0, 1.0, 1.0, 1.0].map(lit).to_vec();
    edit(&mut scene, Edit::Relight { which: Selector::Index(0) });
    assert_eq!(scene.color_from_template[0], lit(1.0), "of chairs, not of the table");
    let alone = apply(&mut scene, &Edit::Relight { which: Selector::Index(1) });
    assert!(alone.unwrap_err().to_string().contains("no other instance"));
}

#[test]
fn polygons_hold_what_is_scattered_in_them() {
    let mut scene = scene();
    let corner = |x: f64, y: f64| DVec3::new(x, y, 2.0);
    // An L: a quarter of its square is outside.
    let points = vec![
        corner(0.0, 0.0),
        corner(8.0, 0.0),
        corner(8.0, 4.0),
        corner(4.0, 4.0),
        corner(4.0, 8.0),
        corner(0.0, 8.0),
    ];
    let over = |points| ScatterOver::Polygon { points, up: DVec3::Z, min_distance: 0.2, turn: TAU, seed: 3 };
    let scatter = |over| Edit::Scatter(Scatter { template: 0, count: 40, over, offsets: OffsetSource::None });
    let added = edit(&mut scene, scatter(over(points))).added;
    let places = instance_centres(&scene, added.iter().copied());
    assert!(places.iter().all(|p| p.x >= 0.0 && p.y >= 0.0 && p.x <= 8.0 && p.y <= 8.0 && !(p.x > 4.0 && p.y > 4.0)));
    assert!(places.iter().any(|p| p.x > 4.0) && places.iter().any(|p| p.y > 4.0));
    assert!(apply(&mut scene, &scatter(over(vec![DVec3::ZERO, DVec3::X]))).is_err());
    // With those that are there, more than any number counts.
    let path = ScatterOver::Path { points: vec![DVec3::ZERO, DVec3::X], up: DVec3::Z, yaw: 0.0 };
    let endless = Scatter { template: 0, count: usize::MAX, over: path, offsets: OffsetSource::None };
    assert!(apply(&mut scene, &Edit::Scatter(endless)).is_err_and(|e| e.to_string().contains("valid number")));
}

#[test]
fn names_are_of_templates() {
    let mut scene = scene();
    scene.groups.truncate(1);
    edit(&mut scene, Edit::Rename { template: 0, name: " stool ".into() });
    edit(&mut scene, Edit::Rename { template: 1, name: "desk".into() });
    let names: Vec<_> = scene.groups.iter().filter_map(|group| group.name.as_deref()).collect();
    assert_eq!(names, ["stool", "desk"]);
    assert_eq!(Selector::Group("desk".into()).resolve(&scene).unwrap(), [1]);
    assert!(apply(&mut scene, &Edit::Rename { template: 0, name: " ".into() }).is_err());
}
