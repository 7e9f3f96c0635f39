//! Tests of the panel through simulated user input, without a window.

use egui::{Event, Pos2, Rect};

use super::*;
use crate::test_screen::{TestScreen, click, drag, press};
use instgs_samples::sample_scene;
use instgs_vk::scene::edit::Keep;

/// A panel with the scene and the editor it shows.
struct Desk {
    screen: TestScreen,
    panel: EditPanel,
    scene: InstancedScene,
    editor: Editor,
    /// True in a test of edits that are not possible.
    may_fail: bool,
}

impl Desk {
    fn new(chosen: &[usize]) -> Self {
        let mut editor = Editor::default();
        chosen.iter().for_each(|&k| editor.click(Some(k), true));
        let (screen, panel, scene) = (TestScreen::default(), EditPanel::default(), sample_scene());
        let mut desk = Self { screen, panel, scene, editor, may_fail: false };
        // Windows settle on their size within the first frames.
        (0..4).for_each(|_| assert_eq!(desk.frame(Vec::new()), []));
        desk
    }

    /// One frame; the actions are applied as the window applies them.
    fn frame(&mut self, events: Vec<Event>) -> Vec<Action> {
        let facts = EditFacts {
            scene: &self.scene,
            editor: &self.editor,
            up: DVec3::Z,
            step: 0.1,
            beside: DVec3::X,
            mode: GizmoMode::Move,
        };
        let mut actions = Vec::new();
        self.screen.frame(events, |ctx| {
            egui::Window::new("Properties").show(ctx, |ui| self.panel.lay_out(ui, &facts, &mut actions));
            self.panel.settle(ctx, &mut actions);
        });
        for action in &actions {
            match action {
                Action::Edit(edit) => {
                    let done = self.editor.apply(&mut self.scene, edit);
                    assert!(done.is_ok() || self.may_fail, "{edit:?}: {:?}", done.err());
                }
                Action::Live(edit) => {
                    let (done, _) = self.editor.apply_live(&mut self.scene, edit);
                    assert!(done.is_ok() || self.may_fail, "{edit:?}: {done:?}");
                }
                Action::Finish => self.editor.finish(),
                Action::Cancel => drop(self.editor.cancel(&mut self.scene)),
                _ => {}
            }
        }
        actions
    }

    fn pictures(&mut self, pictures: Vec<Vec<Event>>) -> Vec<Action> {
        pictures.into_iter().flat_map(|events| self.frame(events)).collect()
    }

    fn place(&self, text: &str) -> Rect {
        self.screen.place(text)
    }

    fn press(&mut self, at: Pos2, pressed: bool) -> Vec<Action> {
        self.pictures(press(at, pressed).into())
    }

    fn click(&mut self, text: &str) -> Vec<Action> {
        self.pictures(click(self.place(text).center()))
    }

    /// Opens the sliders of a crop.
    fn begin_crop(&mut self) {
        self.click("Edit the template");
        self.click("Crop with a box");
    }

    /// Sets the slider of a text: it is left of it, and a press sets it to its middle.
    fn press_slider(&mut self, text: &str) -> Vec<Action> {
        let slider = self.place(text).left_center() - egui::vec2(110.0, 0.0);
        [true, false].into_iter().flat_map(|pressed| self.press(slider, pressed)).collect()
    }

    /// Drags the field to the right of a label.
    fn drag(&mut self, label: &str, by: f32) -> Vec<Action> {
        self.pictures(drag(self.place(label).right_center() + egui::vec2(14.0, 0.0), by))
    }
}

#[test]
fn buttons_ask_for_what_they_say() {
    let which = || Selector::Indices(vec![1]);
    for (text, want) in [
        ("Hide", Action::Hide),
        ("Select same template", Action::ChooseAlike),
        ("Select same group", Action::ChooseGroup),
        ("Rotate", Action::Mode(GizmoMode::Turn)),
        ("Duplicate", Action::Edit(Edit::Duplicate { which: which(), by: DVec3::X, turn: None })),
        ("Delete", Action::Edit(Edit::Delete { which: which() })),
    ] {
        assert_eq!(Desk::new(&[1]).click(text), [want]);
    }
    let mut desk = Desk::new(&[1]);
    desk.click("Template and own Gaussians");
    assert_eq!(desk.click("Make unique"), [Action::Edit(Edit::MakeUnique { which: which() })]);
    assert_eq!(desk.click("Return to background"), [], "there are no own Gaussians");
    let mut desk = Desk::new(&[0, 1]);
    desk.click("Arrange");
    let both = Selector::Indices(vec![0, 1]);
    let base = Edit::Align { which: both, axis: DVec3::Z, to: instgs_vk::scene::edit::AlignTo::Base };
    assert_eq!(desk.click("Stand on one ground"), [Action::Edit(base)]);
    assert!(Desk::new(&[]).screen.says("Click an object"));
}

/// Dragging any number changes the scene while it is held and makes one undo step.
#[test]
fn a_dragged_number_is_one_step() {
    for (chosen, label) in [
        (&[0][..], "Position"),
        (&[0], "Rotation"),
        (&[0], "Scale"),
        (&[0, 1], "Move by"),
        (&[0, 1], "Rotate by"),
        (&[0, 1], "Scale by"),
    ] {
        let mut desk = Desk::new(chosen);
        let actions = desk.drag(label, 30.0);
        let live = actions.iter().filter(|action| matches!(action, Action::Live(_))).count();
        assert!(live >= 2, "{label}: {actions:?}");
        assert!(actions.first() == Some(&Action::Finish) && actions.last() == Some(&Action::Finish));
        assert!(desk.editor.steps() == [1, 0] && !desk.editor.is_live());
        let before = sample_scene();
        let moved = |k: usize| desk.scene.instances[k].world_from_template != before.instances[k].world_from_template;
        assert!((0..before.instances.len()).all(|k| moved(k) == chosen.contains(&k)), "{label}");
        // The next drag of the number continues from its last value.
        desk.drag(label, 30.0);
        assert_eq!(desk.editor.steps(), [2, 0]);
        (0..2).for_each(|_| drop(desk.editor.undo(&mut desk.scene).unwrap()));
        assert!(desk.scene == before);
    }
}

/// The centre moves as far as the number says, along its axis alone.
#[test]
fn the_position_is_that_of_the_centre() {
    let mut desk = Desk::new(&[1]);
    let before = instgs_vk::scene::edit::instance_centres(&desk.scene, [1])[0];
    let actions = desk.drag("Position", 30.0);
    let last = actions.iter().rev().find_map(|action| match action {
        Action::Live(Edit::MoveTo { to, .. }) => Some(*to),
        _ => None,
    });
    let after = instgs_vk::scene::edit::instance_centres(&desk.scene, [1])[0];
    assert!(last.is_some_and(|to| to.distance(after) < 1e-5 && to.x > before.x + 1.0), "{before} {last:?}");
    assert!((after.y - before.y).abs() < 1e-5 && (after.z - before.z).abs() < 1e-5);
}

/// A desk with the colour fields of an instance, and where the first number is.
fn colour_desk() -> (Desk, Pos2) {
    let mut desk = Desk::new(&[0]);
    desk.click("Colour");
    // It is to the right of the colour button.
    let from = desk.place("Shift").right_center() + egui::vec2(66.0, 0.0);
    (desk, from)
}

/// By how much the instance's first Gaussian is redder than at first.
fn red(desk: &Desk) -> f64 {
    let before = sample_scene().offsets.sh_dc[0][0];
    f64::from(desk.scene.offsets.sh_dc[0][0] - before) * instgs_vk::math::sh::SH_C0
}

#[test]
fn a_shift_of_colours_adds_up_over_drags() {
    let (mut desk, from) = colour_desk();
    for want in [1, 2] {
        desk.press(from, true);
        (1..4).for_each(|k| drop(desk.frame(vec![Event::PointerMoved(from + egui::vec2(10.0 * k as f32, 0.0))])));
        desk.press(from + egui::vec2(30.0, 0.0), false);
        desk.frame(Vec::new());
        assert_eq!(desk.editor.steps(), [want, 0]);
        assert!((red(&desk) - f64::from(desk.panel.shift.red())).abs() < 1e-5, "{}", red(&desk));
        assert!(red(&desk) > 0.05 * want as f64, "{}", red(&desk));
    }
    desk.editor.undo(&mut desk.scene);
    desk.frame(Vec::new());
    assert_eq!(desk.panel.shift.red(), 0.0, "the fields begin anew");
}

/// Saving completes the change in progress, and Escape reverts it: the number says what the colours are.
#[test]
fn a_shift_of_colours_that_is_ended_from_outside_counts_once_or_not() {
    let (mut desk, from) = colour_desk();
    let to = |x: f32| vec![Event::PointerMoved(from + egui::vec2(x, 0.0))];
    desk.press(from, true);
    desk.pictures(vec![to(10.0), to(20.0)]);
    desk.editor.finish();
    desk.pictures(vec![Vec::new(), to(30.0), to(40.0)]);
    desk.press(from + egui::vec2(40.0, 0.0), false);
    desk.frame(Vec::new());
    assert_eq!(desk.editor.steps(), [2, 0]);
    let shifted = desk.panel.shift.red();
    assert!(red(&desk) > 0.1 && (red(&desk) - f64::from(shifted)).abs() < 1e-5, "{} {shifted}", red(&desk));
    desk.press(from, true);
    desk.pictures(vec![to(10.0), to(20.0)]);
    desk.editor.cancel(&mut desk.scene);
    desk.press(from + egui::vec2(20.0, 0.0), false);
    desk.frame(Vec::new());
    assert!(desk.editor.steps() == [2, 0] && desk.panel.shift.red() == shifted, "{}", desk.panel.shift.red());
}

/// A crop over several sliders is one undo step once applied, or none if cancelled.
#[test]
fn a_crop_is_one_step_or_none() {
    for (button, steps) in [("Apply", [1, 0]), ("Cancel", [0, 0])] {
        let mut desk = Desk::new(&[0]);
        let before = desk.scene.clone();
        desk.begin_crop();
        let actions = desk.press_slider("X from");
        assert!(
            actions.iter().any(|action| matches!(action, Action::Live(Edit::Crop { template: 0, .. }))),
            "{actions:?}"
        );
        (0..3).for_each(|_| assert_eq!(desk.frame(Vec::new()), []));
        assert!(desk.editor.is_live() && desk.scene.templates.len() < before.templates.len());
        desk.click(button);
        assert!(!desk.editor.is_live() && desk.editor.steps() == steps);
        assert_eq!(desk.scene == before, button == "Cancel");
        desk.editor.undo(&mut desk.scene);
        assert!(desk.scene == before);
    }
}

/// A preview is in the scene while its fields change, and one step or none in the end.
#[test]
fn scattered_copies_are_previewed() {
    for (button, steps) in [("Apply", [1, 0]), ("Cancel", [0, 0])] {
        let mut desk = Desk::new(&[0]);
        let before = desk.scene.clone();
        desk.click("Scatter copies");
        desk.click("Preview");
        assert!(desk.editor.is_live() && desk.scene.instances.len() == before.instances.len() + 5);
        (0..3).for_each(|_| assert_eq!(desk.frame(Vec::new()), []));
        let copies = desk.place("5").center();
        desk.pictures(drag(copies, 30.0));
        assert!(desk.editor.is_live() && desk.scene.instances.len() > before.instances.len() + 5);
        desk.click(button);
        assert!(!desk.editor.is_live() && desk.editor.steps() == steps);
        assert_eq!(desk.scene == before, button == "Cancel");
        desk.editor.undo(&mut desk.scene);
        assert!(desk.scene == before);
    }
}

/// Another field completes the preview, and changes the copies, which are selected.
#[test]
fn copies_that_another_field_changes_are_no_preview_any_more() {
    let mut desk = Desk::new(&[0]);
    let before = desk.scene.instances.len();
    desk.click("Scatter copies");
    desk.click("Preview");
    let copies = desk.editor.chosen().clone();
    desk.drag("Move by", 30.0);
    desk.frame(Vec::new());
    assert!(desk.editor.steps() == [2, 0] && !desk.editor.is_live(), "the copies, and their way");
    assert!(*desk.editor.chosen() == copies && desk.scene.instances.len() == before + 5);
    assert!(desk.screen.says("Preview") && !desk.screen.says("Cancel"));
    // Applying the form adds more, and does not end what is over.
    assert!(matches!(desk.click("Apply").as_slice(), [Action::Edit(Edit::Scatter(s))] if s.count == 5));
}

#[test]
fn scattering_and_the_brush_are_set_in_the_panel() {
    let mut desk = Desk::new(&[0]);
    desk.click("Scatter copies");
    let actions = desk.click("Apply");
    assert!(matches!(actions.as_slice(), [Action::Edit(Edit::Scatter(s))] if s.count == 5), "{actions:?}");
    let mut desk = Desk::new(&[0]);
    desk.click("Edit the template");
    assert!(!desk.panel.brush.on && desk.panel.brush.radius > 0.0);
    assert_eq!(desk.click("Erase by clicking and dragging"), []);
    assert!(desk.panel.brush.on);
}

/// A box that leaves nothing is refused; the sliders stay for another one.
#[test]
fn a_crop_that_is_refused_can_be_set_otherwise() {
    let mut desk = Desk::new(&[0]);
    let before = desk.scene.clone();
    desk.may_fail = true;
    desk.begin_crop();
    let actions = desk.click("Remove inside");
    assert!(matches!(actions.last(), Some(Action::Live(Edit::Crop { keep: Keep::Outside, .. }))), "{actions:?}");
    (0..3).for_each(|_| assert_eq!(desk.frame(Vec::new()), []));
    assert!(desk.scene == before && !desk.editor.is_live() && desk.screen.says("X from"));
    assert_eq!(desk.click("Apply"), [], "there is nothing to apply");
    desk.press_slider("X from");
    assert!(desk.editor.is_live() && desk.scene.templates.len() < before.templates.len());
    desk.click("Apply");
    assert_eq!(desk.editor.steps(), [1, 0]);
}

#[test]
fn a_crop_is_of_the_template_that_the_object_has() {
    let mut desk = Desk::new(&[0]);
    desk.begin_crop();
    assert!(desk.screen.says("X from"));
    let unique = Edit::MakeUnique { which: Selector::Index(0) };
    desk.editor.apply(&mut desk.scene, &unique).unwrap();
    (0..3).for_each(|_| assert_eq!(desk.frame(Vec::new()), []));
    assert!(!desk.screen.says("X from") && desk.screen.says("Crop with a box"));
}

/// What was drawn is kept until there are copies: they may not fit.
#[test]
fn scattering_that_fails_keeps_what_was_drawn() {
    let mut desk = Desk::new(&[0]);
    let before = desk.scene.clone();
    desk.may_fail = true;
    desk.click("Scatter copies");
    desk.panel.scatter.points = vec![DVec3::ZERO, DVec3::X, DVec3::Y];
    desk.panel.scatter.distance = 1e6;
    let actions = desk.click("Apply");
    assert!(matches!(actions.as_slice(), [Action::Edit(Edit::Scatter(_))]), "{actions:?}");
    assert!(desk.scene == before && desk.panel.scatter.points.len() == 3);
    desk.panel.scatter.distance = 0.0;
    desk.click("Apply");
    assert!(desk.scene.instances.len() > before.instances.len() && desk.panel.scatter.points.is_empty());
}
