//! Tests of the panel of boxes through simulated user input, without a window.

use super::*;
use crate::test_screen::{TestScreen, click, drag};

/// A panel with its list; the actions are applied as the window applies them.
#[derive(Default)]
struct Desk {
    screen: TestScreen,
    panel: BoxPanel,
    list: BoxList,
    searched: Option<f32>,
}

impl Desk {
    /// A list with one drawn box, which is selected, and two found ones.
    fn new() -> Self {
        let mut desk = Self::default();
        let at = |x: f64| ObjectBox {
            id: 0,
            category: None,
            center: DVec3::new(x, 0.0, 0.0),
            size: DVec3::ONE,
            world_from_box: DQuat::IDENTITY,
        };
        desk.list.draw(at(0.0));
        desk.list.take_found(1, vec![at(5.0), at(9.0)]);
        desk.pictures(vec![Vec::new(); 4]);
        desk
    }

    fn pictures(&mut self, pictures: Vec<Vec<egui::Event>>) -> Vec<BoxAction> {
        let mut all = Vec::new();
        for events in pictures {
            let Self { screen, panel, list, searched } = self;
            let facts = BoxFacts {
                list,
                up: DVec3::Z,
                step: 0.1,
                mode: GizmoMode::Move,
                searched: *searched,
                other_sizes: false,
                file: "x.boxes.json".into(),
            };
            let mut actions = Vec::new();
            screen.frame(events, |ctx| actions.extend(panel.lay_out(ctx, &facts)));
            for action in &actions {
                match action {
                    BoxAction::Change(object) => list.change(object.clone()),
                    BoxAction::Finish => list.finish(),
                    _ => {}
                }
            }
            all.extend(actions);
        }
        all
    }

    fn click(&mut self, text: &str) -> Vec<BoxAction> {
        self.pictures(click(self.screen.place(text).center()))
    }
}

#[test]
fn buttons_and_rows_ask_for_what_they_say() {
    for (text, want) in [
        ("Undo", BoxAction::Undo),
        ("Close", BoxAction::Leave),
        ("Find the rest (F)", BoxAction::Find),
        ("Other sizes too (O)", BoxAction::OtherSizes(true)),
        (icon::X, BoxAction::Remove(2)),
        ("2: no category, like 1", BoxAction::Choose(1)),
        ("Rotate", BoxAction::Mode(GizmoMode::Turn)),
        ("Save", BoxAction::Save("x.boxes.json".into())),
    ] {
        assert_eq!(Desk::new().click(text), [want]);
    }
    assert_eq!(Desk::new().click("Redo"), [], "nothing to do again");
    let mut searching = Desk { searched: Some(0.3), ..Desk::new() };
    searching.pictures(vec![Vec::new(); 2]);
    assert_eq!(searching.click("Cancel"), [BoxAction::CancelSearch]);
    assert_eq!(searching.click("Other sizes too (O)"), [], "a search goes on as it began");
    assert!(searching.screen.says("Searching for"));
}

#[test]
fn a_dragged_number_is_one_step() {
    for label in ["Centre", "Size", "Rotation"] {
        let mut desk = Desk::new();
        let before = desk.list.boxes()[0].object.clone();
        // The handles have a label of the same name, below.
        let place = desk.screen.first_place(label);
        let actions = desk.pictures(drag(place.right_center() + egui::vec2(14.0, 0.0), 30.0));
        let live = actions.iter().filter(|action| matches!(action, BoxAction::Change(_))).count();
        assert!(live >= 2 && actions.last() == Some(&BoxAction::Finish), "{label}: {actions:?}");
        let after = &desk.list.boxes()[0].object;
        let changed =
            [before.center != after.center, before.size != after.size, before.world_from_box != after.world_from_box];
        assert_eq!(changed, ["Centre", "Size", "Rotation"].map(|name| name == label));
        assert_eq!(desk.list.steps(), [3, 0]);
    }
}

#[test]
fn the_turn_is_about_the_vertical() {
    for up in [DVec3::Z, DVec3::NEG_Y, DVec3::new(0.1, 0.2, 0.9).normalize()] {
        let upright = DQuat::from_rotation_arc(DVec3::Z, up);
        let object = |turn: f64| ObjectBox {
            id: 1,
            category: None,
            center: DVec3::ONE,
            size: DVec3::ONE,
            world_from_box: DQuat::from_axis_angle(up, turn.to_radians()) * upright,
        };
        let by = (yaw_degrees(&object(50.0), up) - yaw_degrees(&object(10.0), up)).rem_euclid(360.0);
        assert!((by - 40.0).abs() < 1e-9, "{up}: {by}");
    }
}
