//! Thinning templates: all instances lose the same Gaussians, and offsets stay with theirs.

use super::*;

/// A crop along x of template 1, which has means at x = 1.5, 2.5, 3.5.
fn crop(low: f64, high: f64, keep: Keep) -> Edit {
    let corners = [DVec3::new(low, f64::NEG_INFINITY, -1.0), DVec3::new(high, f64::INFINITY, 1.0)];
    Edit::Crop { template: 1, corners, keep }
}

/// An erasure in template 0, which has means at (-0.5, 0, 0.2) and (0.5, 0.1, 0.2).
fn erase(centres: &[[f64; 3]], radius: f64) -> Edit {
    Edit::Erase { template: 0, centres: centres.iter().map(|&c| DVec3::from_array(c)).collect(), radius }
}

/// Asserts that every instance looks as before, less the removed Gaussians of its template.
fn assert_thinned(before: &InstancedScene, after: &InstancedScene, template: u32, kept: &[usize]) {
    let (was, is) = (looks(before), looks(after));
    for (k, instance) in before.instances.iter().enumerate() {
        let whole = instance.template != template;
        assert_eq!(is[k], was[k].filtered(|i| whole || kept.contains(&i)), "instance {k}");
    }
    assert_eq!(is.last(), was.last(), "the background");
    assert_eq!((ids(after), &after.groups), (ids(before), &before.groups));
}

#[test]
fn a_box_crops_a_template_with_the_offsets_of_its_instances() {
    let before = scene();
    for (edit, kept) in [
        (crop(1.5, 2.6, Keep::Inside), &[0, 1][..]),
        (crop(2.0, 3.0, Keep::Inside), &[1]),
        (crop(2.0, 3.0, Keep::Outside), &[0, 2]),
        (crop(f64::NEG_INFINITY, 2.0, Keep::Outside), &[1, 2]),
    ] {
        let mut after = before.clone();
        let outcome = run(&mut after, edit);
        assert_eq!((outcome.changed, outcome.warnings.len()), (vec![1], 0));
        assert_thinned(&before, &after, 1, kept);
        let gone = 3 - kept.len();
        assert_eq!((after.templates.len(), after.offsets.len()), (5 - gone, 7 - gone));
        assert_eq!(after.offsets.sh_rest.len(), 3 * (7 - gone));
    }
}

#[test]
fn what_no_instance_shows_is_cropped_with_a_warning() {
    let mut after = scene();
    run(&mut after, Edit::Delete { which: which("1") });
    let outcome = run(&mut after, crop(2.0, 3.0, Keep::Inside));
    assert_eq!(outcome.warnings, ["template 1 lost 2 Gaussians, and no instance shows it"]);
    assert!(outcome.changed.is_empty() && after.templates.len() == 3);
}

#[test]
fn balls_erase_from_all_instances_at_once() {
    let before = scene();
    for (edit, kept) in
        [(erase(&[[-0.5, 0.05, 0.2]], 0.1), 1), (erase(&[[9.0, 0.0, 0.0], [0.5, 0.1, 0.2], [0.5, 0.1, 0.3]], 0.1), 0)]
    {
        let mut after = before.clone();
        let outcome = run(&mut after, edit);
        assert_eq!(outcome.changed, [0, 2, 3, 4]);
        assert_thinned(&before, &after, 0, &[kept]);
        assert_eq!(after.instances[3].first_offset, after.instances[4].first_offset, "a shared run stays one");
        assert_eq!((after.instances[2].first_offset, after.offsets.len()), (None, 5));
    }
}

#[test]
fn what_would_leave_nothing_or_makes_no_sense_is_refused() {
    let before = scene();
    let nan = DVec3::new(0.0, f64::NAN, 0.0);
    for (edit, want) in [
        (crop(5.0, 6.0, Keep::Inside), "all 3 Gaussians of template 1 would be removed"),
        (crop(0.0, 9.0, Keep::Outside), "all 3 Gaussians"),
        (crop(2.0, 1.0, Keep::Inside), "no box"),
        (Edit::Crop { template: 1, corners: [nan, DVec3::ONE], keep: Keep::Inside }, "no box"),
        (Edit::Crop { template: 2, corners: [DVec3::ZERO, DVec3::ONE], keep: Keep::Inside }, "no template 2"),
        (erase(&[[0.0; 3]], 9.0), "all 2 Gaussians of template 0 would be removed"),
        (erase(&[[0.0; 3]], 0.0), "not a radius"),
        (erase(&[[0.0; 3]], f64::NAN), "not a radius"),
        (erase(&[], 1.0), "one or more points"),
        (erase(&[[f64::INFINITY; 3]], 1.0), "one or more points"),
    ] {
        let mut after = before.clone();
        let error = apply(&mut after, &edit).unwrap_err().to_string();
        assert!(error.starts_with(edit.name()) && error.contains(want), "{error}");
        assert_eq!(after, before);
    }
    let mut shared = before;
    shared.template_ranges[1] = SourceRange { first: 1, count: 3 };
    let error = apply(&mut shared, &erase(&[[-0.5, 0.0, 0.2]], 0.1)).unwrap_err().to_string();
    assert!(error.contains("template 1 shares Gaussians with template"), "{error}");
}

#[test]
fn where_nothing_is_nothing_changes() {
    let mut before = scene();
    before.foreign_tensors =
        ["template.extra", "offset.extra", "background.extra"].map(|name| (name.into(), foreign())).into();
    let mut after = before.clone();
    let outcome = run(&mut after, erase(&[[7.0; 3]], 0.5));
    assert_eq!((outcome.changed.len(), outcome.warnings.len()), (0, 1));
    assert_eq!(after, before);
    let outcome = run(&mut after, crop(1.5, 2.6, Keep::Inside));
    assert_eq!(outcome.warnings.len(), 2);
    assert_eq!(after.foreign_tensors.into_keys().collect::<Vec<_>>(), ["background.extra"]);
}

fn foreign() -> ForeignTensor {
    ForeignTensor { dtype: "U8".into(), shape: vec![1], bytes: vec![1] }
}
