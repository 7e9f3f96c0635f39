//! Undo and redo on a scene with two templates.

use super::*;
use glam::DVec3;
use instgs_samples::sample_scene;
use instgs_vk::scene::Group;
use instgs_vk::scene::edit::Keep;

fn move_by(editor: &Editor, by: DVec3) -> Edit {
    Edit::MoveBy { which: editor.selector().unwrap(), by }
}

#[test]
fn clicks_choose_one_or_more_and_alike_all_of_a_kind() {
    let scene = sample_scene();
    let mut editor = Editor::default();
    assert!(editor.selector().is_none());
    editor.click(Some(0), false);
    editor.click(Some(1), true);
    assert_eq!(editor.chosen_flags(&scene)[..2], [true, true]);
    editor.click(Some(0), true);
    assert_eq!(editor.selector(), Some(Selector::Indices(vec![1])));
    let template = scene.instances[1].template;
    assert!(editor.has_chosen_of(&scene, template) && !editor.has_chosen_of(&scene, template + 1));
    editor.choose_alike(&scene);
    assert!(editor.chosen().iter().all(|&k| scene.instances[k].template == template));
    assert_eq!(editor.chosen().len(), scene.instances.iter().filter(|i| i.template == template).count());
    editor.click(None, true);
    assert!(!editor.chosen().is_empty(), "beside, with shift: no change");
    editor.click(None, false);
    assert!(editor.chosen().is_empty());
}

#[test]
fn the_first_state_is_that_before_all_changes() {
    let mut scene = sample_scene();
    let (before, mut editor) = (scene.clone(), Editor::default());
    editor.click(Some(0), false);
    for edit in [move_by(&editor, DVec3::X), Edit::Duplicate { which: Selector::Index(1), by: DVec3::Y, turn: None }] {
        editor.apply(&mut scene, &edit).unwrap();
    }
    editor.set_hidden(&[2], true);
    editor.undo(&mut scene);
    editor.saved();
    let (now, history, chosen) = (scene.clone(), editor.history(), editor.chosen().clone());
    assert!(editor.first_state(&mut scene) == before && before != now);
    assert!(scene == now && editor.history() == history && *editor.chosen() == chosen && !editor.is_unsaved());
}

/// Lists of instances are made anew for copies and names, and not for each frame of a drag.
#[test]
fn lists_are_out_of_date_after_copies_and_names_only() {
    let (mut scene, mut editor) = (sample_scene(), Editor::default());
    editor.click(Some(0), false);
    let first = editor.listing();
    let moved = move_by(&editor, DVec3::X);
    editor.apply_live(&mut scene, &moved).0.unwrap();
    editor.set_hidden(&[1], true);
    assert_eq!(editor.listing(), first);
    let rename = Edit::Rename { template: 0, name: "stool".into() };
    let copy = Edit::Duplicate { which: Selector::Index(0), by: DVec3::Y, turn: None };
    for edit in [rename, copy] {
        let before = editor.listing();
        editor.apply(&mut scene, &edit).unwrap();
        let applied = editor.listing();
        editor.undo(&mut scene);
        assert!(before != applied && applied != editor.listing(), "{edit:?}");
    }
}

/// Every kind of change is undone and redone; the scenes are the same, bit for bit, at every step.
#[test]
fn changes_are_taken_back_and_done_again() {
    let plain = sample_scene();
    let matrix = |k: usize| [0, 1, 2].map(|row| [0, 1, 2, 3].map(|column| 0.1 * (k + row + column) as f32));
    let colored = InstancedScene { color_from_template: (0..4).map(matrix).collect(), ..plain.clone() };
    [plain, colored].into_iter().for_each(takes_back_and_does_again);
}

fn takes_back_and_does_again(mut scene: InstancedScene) {
    let mut editor = Editor::default();
    let which = || Selector::Indices(vec![0, 1]);
    // Between the two Gaussians of template 1.
    let middle = f64::from(scene.templates.means[3][0] + scene.templates.means[4][0]) / 2.0;
    let edits = [
        Edit::MoveBy { which: which(), by: DVec3::X },
        Edit::Duplicate { which: which(), by: DVec3::Y, turn: None },
        Edit::Give { which: Selector::Index(0), margin: 1e3 },
        Edit::Take { which: Selector::Index(0) },
        Edit::Recolour { which: Selector::Index(0), rgb: [0.1, 0.0, 0.0] },
        Edit::Reset { which: Selector::Index(0), what: instgs_vk::scene::edit::Extra::All },
        Edit::Recolour { which: Selector::Template(0), rgb: [0.0, 0.1, 0.0] },
        Edit::Scale { which: Selector::Index(1), by: 1.5 },
        Edit::Swap { which: Selector::Index(0), template: 1 },
        Edit::Crop {
            template: 1,
            corners: [DVec3::splat(f64::NEG_INFINITY), DVec3::new(middle, f64::INFINITY, f64::INFINITY)],
            keep: Keep::Inside,
        },
        Edit::Rename { template: 1, name: "seat".into() },
        Edit::Mirror { which: which(), normal: DVec3::X, point: None },
        Edit::MakeUnique { which: Selector::Index(1) },
        Edit::Delete { which: which() },
    ];
    let mut states = vec![scene.clone()];
    for edit in &edits {
        let (outcome, changed) = editor.apply(&mut scene, edit).unwrap();
        // A name is nothing that is uploaded.
        let places = matches!(edit, Edit::MoveBy { .. } | Edit::Scale { .. } | Edit::Rename { .. });
        assert_eq!(matches!(changed, Changed::Places(_)), places, "{edit:?}");
        if !outcome.added.is_empty() {
            assert_eq!(editor.chosen().iter().copied().collect::<Vec<_>>(), outcome.added);
        }
        scene.validate().unwrap();
        states.push(scene.clone());
    }
    assert_eq!(editor.steps(), [edits.len(), 0]);
    for want in states.iter().rev().skip(1) {
        assert!(editor.undo(&mut scene).is_some() && scene == *want);
    }
    assert!(editor.undo(&mut scene).is_none());
    for want in states.iter().skip(1) {
        assert!(editor.redo(&mut scene).is_some() && scene == *want);
    }
    assert!(editor.redo(&mut scene).is_none() && editor.is_unsaved());
    editor.saved();
    assert!(!editor.is_unsaved());
    // A new change drops the redo history.
    editor.undo(&mut scene);
    editor.click(Some(0), false);
    let edit = move_by(&editor, DVec3::Z);
    editor.apply(&mut scene, &edit).unwrap();
    assert!(editor.redo(&mut scene).is_none());
}

/// All edits of a drag make one undo step, and each starts from the scene as it was before the drag.
#[test]
fn a_drag_is_one_step() {
    let mut scene = sample_scene();
    let before = scene.clone();
    let mut editor = Editor::default();
    editor.click(Some(0), false);
    for x in [0.1, 0.7, -0.4, 2.0] {
        let edit = move_by(&editor, DVec3::new(x, 0.0, 0.0));
        let (done, changed) = editor.apply_live(&mut scene, &edit);
        assert_eq!((done.unwrap().changed, changed), (vec![0], Changed::Places(vec![0])));
        let mut want = before.clone();
        apply(&mut want, &edit).unwrap();
        assert!(scene == want && editor.is_live() && editor.is_unsaved() && editor.steps() == [0, 0]);
    }
    editor.finish();
    let dragged = scene.clone();
    assert!(!editor.is_live() && editor.steps() == [1, 0]);
    assert!(editor.undo(&mut scene).is_some() && scene == before && editor.undo(&mut scene).is_none());
    assert!(editor.redo(&mut scene).is_some() && scene == dragged);
    // Saving, another edit, and undo each end the drag.
    let edit = move_by(&editor, DVec3::Z);
    editor.apply_live(&mut scene, &edit).0.unwrap();
    editor.saved();
    assert!(!editor.is_live() && !editor.is_unsaved() && editor.steps() == [2, 0]);
    editor.undo(&mut scene);
    assert!(scene == dragged && editor.is_unsaved());
    let edit = move_by(&editor, DVec3::Y);
    editor.apply_live(&mut scene, &edit).0.unwrap();
    editor.apply(&mut scene, &Edit::Delete { which: Selector::Index(1) }).unwrap();
    assert_eq!(editor.steps(), [3, 0]);
    editor.undo(&mut scene);
    editor.undo(&mut scene);
    assert!(scene == dragged);
}

#[test]
fn a_drag_that_is_given_up_or_leads_nowhere_leaves_no_step() {
    let mut scene = sample_scene();
    let before = scene.clone();
    let mut editor = Editor::default();
    editor.click(Some(0), false);
    let edit = move_by(&editor, DVec3::X);
    editor.apply_live(&mut scene, &edit).0.unwrap();
    assert_eq!(editor.cancel(&mut scene), Changed::Places(vec![0]));
    assert!(scene == before && !editor.is_live() && !editor.is_unsaved() && editor.steps() == [0, 0]);
    // A drag back to its start; and a failing edit after one that succeeded.
    for to in [DVec3::ZERO, DVec3::splat(f64::INFINITY)] {
        editor.apply_live(&mut scene, &edit).0.unwrap();
        let other = move_by(&editor, to);
        let (done, changed) = editor.apply_live(&mut scene, &other);
        assert_eq!((done.is_ok(), changed), (to == DVec3::ZERO, Changed::Places(vec![0])));
        editor.finish();
        assert!(scene == before && editor.steps() == [0, 0] && !editor.is_unsaved());
    }
    // Recolouring uploads everything, in both directions.
    let recolour = Edit::Recolour { which: Selector::Template(0), rgb: [0.1, 0.0, 0.0] };
    assert_eq!(editor.apply_live(&mut scene, &recolour).1, Changed::Everything);
    assert_eq!(editor.cancel(&mut scene), Changed::Everything);
    assert!(scene == before);
}

#[test]
fn hidden_things_stay_in_the_scene_and_come_back() {
    let mut scene = sample_scene();
    let before = scene.clone();
    let mut editor = Editor::default();
    assert!(editor.hide_chosen().is_none() && editor.show_all().is_none());
    editor.click(Some(1), false);
    assert_eq!(editor.hide_chosen(), Some(Changed::Shown(vec![1])));
    assert!(editor.hidden().contains(&1) && editor.chosen().is_empty());
    assert!(scene == before && !editor.is_unsaved() && editor.steps() == [1, 0]);
    for more in [true, false] {
        editor.click(Some(1), more);
        assert!(editor.chosen().is_empty(), "the Scene panel lists it, too");
    }
    // All visible instances of one template.
    let template = before.instances[1].template;
    let other = (0..before.instances.len()).find(|&k| k != 1 && before.instances[k].template == template).unwrap();
    editor.click(Some(other), false);
    editor.choose_alike(&scene);
    assert!(editor.chosen().contains(&other) && !editor.chosen().contains(&1));
    // Deleting an earlier instance shifts the indices of the selection; undo restores them.
    editor.apply(&mut scene, &Edit::Delete { which: Selector::Index(0) }).unwrap();
    assert_eq!(editor.hidden().iter().copied().collect::<Vec<_>>(), [0]);
    assert_eq!(editor.undo(&mut scene), Some(Changed::Everything));
    assert!(scene == before && editor.hidden().contains(&1) && editor.hidden().len() == 1);
    assert_eq!(editor.undo(&mut scene), Some(Changed::Shown(vec![1])));
    assert!(editor.hidden().is_empty());
    assert_eq!(editor.redo(&mut scene), Some(Changed::Shown(vec![1])));
    assert_eq!(editor.show_all(), Some(Changed::Shown(vec![1])));
    assert!(editor.hidden().is_empty() && editor.chosen().contains(&1));
    assert_eq!(editor.undo(&mut scene), Some(Changed::Shown(vec![1])));
    assert!(editor.hidden().contains(&1));
    assert_eq!(renumbered(&BTreeSet::from([0, 2, 5, 6]), &[1, 5]), BTreeSet::from([0, 1, 4]));
}

#[test]
fn a_group_is_chosen_as_a_whole() {
    let mut scene = sample_scene();
    let group = |template_id, ids: &[u32]| Group { template_id, name: None, instance_ids: ids.into() };
    let template = scene.instances[0].template;
    let alike = scene.instances.iter().filter(|i| i.template == template).count();
    assert!(alike >= 2, "the sample has two of a kind");
    // The first of its kind is a group of its own.
    scene.groups = vec![group(template, &[1]), group(template, &[2])];
    let mut editor = Editor::default();
    editor.click(Some(0), false);
    editor.choose_group(&scene);
    assert_eq!(editor.chosen().len(), 1);
    scene.groups = vec![group(template, &[1, 2])];
    editor.choose_group(&scene);
    assert_eq!(editor.chosen().len(), alike);
    scene.groups.clear();
    editor.click(Some(0), false);
    editor.choose_group(&scene);
    assert_eq!(editor.chosen().iter().copied().collect::<Vec<_>>(), [0], "without a group");
}

#[test]
fn the_oldest_steps_are_forgotten_first() {
    let mut scene = sample_scene();
    let mut editor = Editor::default();
    editor.click(Some(0), false);
    let mut places = Vec::new();
    for _ in 0..5 {
        places.push(scene.instances[0].world_from_template);
        let edit = move_by(&editor, DVec3::X);
        editor.apply(&mut scene, &edit).unwrap();
    }
    let each = editor.undo[0].parts.bytes();
    assert_eq!(each, 56 * scene.instances.len() as u64);
    assert!(!editor.has_forgotten());
    editor.forget_oldest(4, u64::MAX);
    assert!(editor.steps() == [4, 0] && editor.has_forgotten());
    editor.forget_oldest(9, 3 * each);
    assert_eq!(editor.steps(), [3, 0]);
    while editor.undo(&mut scene).is_some() {}
    assert_eq!(scene.instances[0].world_from_template, places[2]);
    editor.redo(&mut scene);
    editor.forget_oldest(9, 0);
    assert_eq!(editor.steps()[0], 1, "the last one stays");
}

#[test]
fn the_middle_of_what_is_chosen() {
    let scene = sample_scene();
    let mut editor = Editor::default();
    assert_eq!(editor.chosen_centre(&scene), None);
    let centres = instance_centres(&scene, [0, 1]);
    editor.click(Some(0), false);
    assert_eq!(editor.chosen_centre(&scene), Some(centres[0]));
    editor.click(Some(1), true);
    let middle = editor.chosen_centre(&scene).unwrap();
    assert!(middle.distance((centres[0] + centres[1]) / 2.0) < 1e-12 && centres[0] != centres[1]);
}

#[test]
fn an_edit_that_fails_leaves_no_step() {
    let mut scene = sample_scene();
    let before = scene.clone();
    let mut editor = Editor::default();
    editor.click(Some(0), false);
    let edit = move_by(&editor, DVec3::splat(f64::INFINITY));
    assert!(editor.apply(&mut scene, &edit).is_err());
    assert!(scene == before && editor.steps() == [0, 0] && !editor.is_unsaved());
}

/// What is locked cannot be selected in any way; locking is undone like hiding.
#[test]
fn locked_instances_cannot_be_selected() {
    let mut scene = sample_scene();
    let mut editor = Editor::default();
    editor.choose([0, 1], false);
    assert!(editor.set_locked(&[0], true) && !editor.set_locked(&[0], true));
    assert_eq!(editor.selector(), Some(Selector::Indices(vec![1])));
    editor.click(Some(0), false);
    assert!(editor.chosen().is_empty());
    editor.choose(0..scene.instances.len(), false);
    assert!(!editor.chosen().contains(&0) && editor.chosen().len() == scene.instances.len() - 1);
    editor.choose_others(&scene);
    assert!(editor.chosen().is_empty());
    assert!(!editor.is_unsaved() && editor.history()[0] == ["lock"]);
    assert!(editor.undo(&mut scene).is_some() && editor.locked().is_empty());
    assert_eq!(editor.history(), [vec![], vec!["lock"]]);
    // Indices follow when instances before them go.
    editor.set_locked(&[1], true);
    editor.set_hidden(&[2], true);
    editor.apply(&mut scene, &Edit::Delete { which: Selector::Index(0) }).unwrap();
    assert!(editor.locked().contains(&0) && editor.hidden().contains(&1));
}

/// A file holds the changes until it was begun; later ones are still unsaved.
#[test]
fn a_file_that_is_written_meanwhile_saves_what_it_holds() {
    let mut scene = sample_scene();
    let mut editor = Editor::default();
    let edit = Edit::MoveBy { which: Selector::Index(0), by: DVec3::X };
    editor.apply(&mut scene, &edit).unwrap();
    let revision = editor.revision();
    editor.apply(&mut scene, &edit).unwrap();
    editor.saved_at(revision);
    assert!(editor.is_unsaved());
    let revision = editor.revision();
    editor.saved_at(revision);
    assert!(!editor.is_unsaved());
}

#[test]
fn a_state_is_the_same_until_something_is_changed() {
    let mut scene = sample_scene();
    let mut editor = Editor::default();
    editor.click(Some(0), false);
    let edit = move_by(&editor, DVec3::X);
    editor.apply(&mut scene, &edit).unwrap();
    let revision = editor.revision();
    editor.set_hidden(&[1], true);
    assert!(editor.is_at(revision), "the scene is as it was");
    editor.apply_live(&mut scene, &edit).0.unwrap();
    assert!(!editor.is_at(revision), "a change in progress counts");
    editor.cancel(&mut scene);
    assert!(editor.is_at(revision));
    editor.apply(&mut scene, &edit).unwrap();
    assert!(!editor.is_at(revision));
}

/// A key that is held moves objects many times.
#[test]
fn what_a_held_key_does_is_one_step() {
    let (mut scene, mut editor) = (sample_scene(), Editor::default());
    let before = scene.clone();
    editor.click(Some(0), false);
    let edit = move_by(&editor, DVec3::X);
    editor.apply(&mut scene, &edit).unwrap();
    for _ in 0..3 {
        editor.apply_again(&mut scene, &edit).unwrap();
    }
    assert_eq!(editor.steps(), [1, 0]);
    let moved = |scene: &InstancedScene, k: usize| scene.instances[k].world_from_template.translation();
    assert!((moved(&scene, 0) - moved(&before, 0) - 4.0 * DVec3::X).length() < 1e-12);
    // Other instances, and what comes after a step that was undone, begin a step of their own.
    editor.click(Some(1), false);
    let other = move_by(&editor, DVec3::X);
    editor.apply_again(&mut scene, &other).unwrap();
    assert_eq!(editor.steps(), [2, 0]);
    editor.undo(&mut scene);
    editor.click(Some(0), false);
    editor.apply_again(&mut scene, &edit).unwrap();
    assert_eq!(editor.steps(), [2, 0]);
    (0..2).for_each(|_| drop(editor.undo(&mut scene)));
    assert!(scene == before);
    // A copy in between is no move.
    editor.apply(&mut scene, &Edit::Duplicate { which: Selector::Index(0), by: DVec3::Y, turn: None }).unwrap();
    let copy = move_by(&editor, DVec3::X);
    editor.apply_again(&mut scene, &copy).unwrap();
    assert_eq!(editor.steps(), [2, 0]);
}

#[test]
fn an_edit_that_changes_nothing_is_no_step() {
    let (mut scene, mut editor) = (sample_scene(), Editor::default());
    editor.click(Some(0), false);
    let edit = move_by(&editor, DVec3::X);
    editor.apply(&mut scene, &edit).unwrap();
    editor.undo(&mut scene);
    editor.saved();
    let revision = editor.revision();
    let nothing = move_by(&editor, DVec3::ZERO);
    editor.apply(&mut scene, &nothing).unwrap();
    editor.apply_again(&mut scene, &nothing).unwrap();
    assert!(editor.steps() == [0, 1] && editor.is_at(revision) && !editor.is_unsaved());
}

#[test]
fn a_live_edit_that_fails_is_known_until_the_change_ends() {
    let (mut scene, mut editor) = (sample_scene(), Editor::default());
    let corners = [DVec3::splat(-1e9), DVec3::splat(1e9)];
    let all = Edit::Crop { template: 0, corners, keep: Keep::Outside };
    assert!(editor.apply_live(&mut scene, &all).0.is_err() && editor.has_live_failed() && !editor.is_live());
    editor.cancel(&mut scene);
    assert!(!editor.has_live_failed());
    drop(editor.apply_live(&mut scene, &all));
    editor.finish();
    assert!(!editor.has_live_failed());
}
