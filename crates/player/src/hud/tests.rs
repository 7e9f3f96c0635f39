//! Whether the panels fit the window, and what their buttons ask for.

use egui::{Pos2, Rect, vec2};

use super::*;
use crate::panel_texts::{PanelText, texts_of};
use instgs_samples::sample_scene;
use instgs_vk::scene::trajectory::Orbit;

/// The overlay of a window of a size in points, with its scene.
struct Desk {
    ctx: Context,
    hud: Hud,
    scene: InstancedScene,
    editor: Editor,
    navigator: Navigator,
    size: egui::Vec2,
    lod_error_px: f32,
    budget_ms: Option<f64>,
    /// The work beside the picture.
    work: Option<(String, Option<f32>)>,
    /// When the last frame asked for another one.
    delay: std::time::Duration,
}

impl Desk {
    fn new(size: egui::Vec2) -> Self {
        let (ctx, scene) = (Context::default(), sample_scene());
        let mut fonts = egui::FontDefinitions::default();
        egui_phosphor::add_to_fonts(&mut fonts, egui_phosphor::Variant::Regular);
        ctx.set_fonts(fonts);
        let navigator = Navigator::around(&Orbit::around(&scene, None));
        let mut hud = Hud::new(true);
        hud.panels.properties = false;
        let (editor, delay) = (Editor::default(), std::time::Duration::MAX);
        Self { ctx, hud, scene, editor, navigator, size, lod_error_px: 0.0, budget_ms: None, work: None, delay }
    }

    /// Lays out a few frames, in which panels settle, and returns the shapes of the last.
    fn settled(&mut self) -> Vec<egui::epaint::ClippedShape> {
        let (shapes, actions) = self.frames(vec![Vec::new(); 6]);
        assert_eq!(actions, []);
        shapes
    }

    /// Lays out frames with these events, and returns the shapes of the last and the actions of all.
    fn frames(&mut self, frames: Vec<Vec<egui::Event>>) -> (Vec<egui::epaint::ClippedShape>, Vec<Action>) {
        let (mut shapes, mut actions) = (Vec::new(), Vec::new());
        for (k, events) in frames.into_iter().enumerate() {
            let screen_rect = Some(Rect::from_min_size(Pos2::ZERO, self.size));
            let time = Some(0.5 * k as f64);
            let input = egui::RawInput { screen_rect, events, time, ..egui::RawInput::default() };
            let Self { ctx, hud, scene, editor, navigator, lod_error_px, budget_ms, work, .. } = self;
            let (clock, stats) = (FrameClock::default(), FrameStats::default());
            let (mut show, mut background, mut occlusion) = (Show::Color, [0.0; 3], false);
            let mut present = PresentMode::Fifo;
            let output = ctx.run(input, |ctx| {
                let facts = Facts {
                    title: "room.instgs",
                    device: "llvmpipe (LLVM 15.0.6, 256 bits)",
                    size_px: [1280, 720],
                    clock: &clock,
                    stats: &stats,
                    pixel_times: PixelTimes::default(),
                    scene,
                    background_len: scene.background.len() as u64,
                    editor,
                    file_bytes: 4_800_000,
                    device_bytes: [512 << 20, 300 << 20],
                    scene_on_host_bytes: 0,
                    scale: 1.0,
                    up: DVec3::Z,
                    step: 0.1,
                    beside: DVec3::X,
                    mode: GizmoMode::Move,
                    file: Path::new("/scenes/room.instgs"),
                    kept: &[],
                    recent: &["/scenes/room.instgs".into()],
                    work: work.clone(),
                    boxes: false,
                    split: false,
                };
                let settings = Settings {
                    navigator,
                    show: &mut show,
                    background: &mut background,
                    present: &mut present,
                    budget_ms,
                    lod_error_px,
                    occlusion: &mut occlusion,
                };
                actions.extend(hud.lay_out(ctx, &facts, settings));
            });
            shapes = output.shapes;
            let delays = output.viewport_output.values().map(|viewport| viewport.repaint_delay);
            self.delay = delays.min().unwrap_or(self.delay);
        }
        (shapes, actions)
    }
}

/// Texts that are cut off by their panel or by the window, with what can be seen of them.
fn cut_off(shapes: &[egui::epaint::ClippedShape], size: egui::Vec2) -> Vec<String> {
    let window = Rect::from_min_size(Pos2::ZERO, size);
    // A hair for rounding to pixels.
    let is_cut = |text: &PanelText| !text.clip.intersect(window).expand(1.0).contains_rect(text.rect);
    let cut = texts_of(shapes).into_iter().filter(is_cut);
    cut.map(|text| format!("{:?} at {} in {}", text.text, text.rect, text.clip)).collect()
}

const PANELS: [Panel; 8] = [
    Panel::Help,
    Panel::Scene,
    Panel::View,
    Panel::Cameras,
    Panel::History,
    Panel::Statistics,
    Panel::Open,
    Panel::SaveAs,
];

/// All texts, sorted: those that are scrolled out of a panel are not among the shapes.
fn texts(shapes: &[egui::epaint::ClippedShape]) -> Vec<String> {
    let mut out: Vec<String> = texts_of(shapes).into_iter().map(|text| text.text).collect();
    out.sort();
    out
}

/// A window as wide, and higher than any panel.
fn endless(size: egui::Vec2) -> egui::Vec2 {
    vec2(size.x, 4000.0)
}

/// The shapes of one panel in a window of a size.
fn shapes_of(panel: Panel, size: egui::Vec2) -> Vec<egui::epaint::ClippedShape> {
    let mut desk = Desk::new(size);
    *desk.hud.panels.flag(panel) = true;
    if panel == Panel::Properties {
        desk.editor.click(Some(0), false);
    }
    desk.settled()
}

/// Every text of every panel is seen, and seen whole, at 1280x720 and larger.
#[test]
fn nothing_is_cut_off() {
    for size in [vec2(1280.0, 720.0), vec2(1920.0, 1080.0)] {
        for panel in PANELS.into_iter().chain([Panel::Properties]) {
            let shapes = shapes_of(panel, size);
            assert_eq!(cut_off(&shapes, size), Vec::<String>::new(), "{panel:?} at {size}");
            assert_eq!(texts(&shapes), texts(&shapes_of(panel, endless(size))), "{panel:?} at {size}");
        }
    }
    // The test can fail: in a small window the help is scrolled.
    let size = vec2(640.0, 360.0);
    assert_ne!(texts(&shapes_of(Panel::Help, size)), texts(&shapes_of(Panel::Help, endless(size))));
}

/// A long panel uses the height that the window has.
#[test]
fn a_panel_scrolls_only_what_the_window_has_no_room_for() {
    for (height, fits) in [(720.0, true), (360.0, false)] {
        let (ctx, mut shapes) = (Context::default(), Vec::new());
        for k in 0..6 {
            let screen_rect = Some(Rect::from_min_size(Pos2::ZERO, vec2(1280.0, height)));
            let input = egui::RawInput { screen_rect, time: Some(0.5 * f64::from(k)), ..egui::RawInput::default() };
            let output = ctx.run(input, |ctx| {
                panel(ctx, texts::VIEW, Place::of(ctx, Align2::RIGHT_TOP), &mut true, |ui| {
                    (0..30).for_each(|line| drop(ui.label(line.to_string())));
                });
            });
            shapes = output.shapes;
        }
        assert_eq!(texts(&shapes).contains(&"29".to_owned()), fits, "{height}");
    }
}

/// On a screen of twice the pixels, 1280x720 are 640x360 points: panels stay inside the window, and their rest is scrolled.
#[test]
fn panels_stay_inside_small_windows() {
    let size = vec2(640.0, 360.0);
    for panel in PANELS {
        let mut desk = Desk::new(size);
        *desk.hud.panels.flag(panel) = true;
        desk.settled();
        let window = Rect::from_min_size(Pos2::ZERO, size);
        let areas = desk.ctx.memory(|memory| {
            let ids: Vec<egui::LayerId> = memory.areas().visible_layer_ids().into_iter().collect();
            ids.into_iter().filter_map(|layer| memory.area_rect(layer.id)).collect::<Vec<Rect>>()
        });
        assert!(
            areas.len() > 1 && areas.iter().all(|rect| window.expand(1.0).contains_rect(*rect)),
            "{panel:?}: {areas:?}"
        );
        // Of what can be seen, only the bar itself is above its lower edge; one area is the whole window.
        let is_seen = |rect: &&Rect| rect.height() > 0.0 && **rect != window;
        let above = areas.iter().filter(is_seen).filter(|rect| rect.top() < BAR - 1.0).count();
        assert!(above <= 1, "{panel:?}: {areas:?}");
    }
}

/// A path that is typed leaves the question whether a file may be replaced to the window.
#[test]
fn a_typed_path_replaces_nothing_unasked() {
    let mut desk = Desk::new(vec2(1280.0, 720.0));
    desk.hud.panels.save_as = true;
    let (key, modifiers) = (egui::Key::Enter, egui::Modifiers::NONE);
    let enter = egui::Event::Key { key, physical_key: None, pressed: true, repeat: false, modifiers };
    let (_, actions) = desk.frames(vec![Vec::new(), Vec::new(), Vec::new(), vec![enter], Vec::new()]);
    let to = "/scenes/room.instgs".into();
    assert_eq!(actions, [Action::Write { to, may_replace: false }]);
    assert!(!desk.hud.panels.save_as);
}

/// What the command line has set and no slider could stays as it is while the panel is open.
#[test]
fn the_view_panel_changes_nothing_by_itself() {
    for (lod_error_px, budget_ms) in [(9.25, 0.5), (1.3, 5000.0)] {
        let mut desk = Desk::new(vec2(1280.0, 720.0));
        desk.hud.panels.view = true;
        (desk.lod_error_px, desk.budget_ms) = (lod_error_px, Some(budget_ms));
        let before = desk.navigator.clone();
        desk.settled();
        assert_eq!((desk.lod_error_px, desk.budget_ms), (lod_error_px, Some(budget_ms)));
        assert!(desk.navigator == before);
    }
}

/// Work is looked at every few milliseconds: no frame is drawn only to turn a spinner.
#[test]
fn work_beside_the_picture_asks_for_no_frames_itself() {
    for progress in [None, Some(0.5)] {
        let mut desk = Desk::new(vec2(1280.0, 720.0));
        desk.work = Some(("Opening room.ply".into(), progress));
        let shapes = desk.settled();
        assert!(texts(&shapes).iter().any(|text| text == "Opening room.ply"));
        assert!(!desk.delay.is_zero(), "{progress:?}");
    }
}

#[test]
fn bytes_are_numbers_that_people_read() {
    let want = [
        (7, "7 B"),
        (999, "999 B"),
        (4_800_000, "4.8 MB"),
        (99_960, "100 kB"),
        (999_600, "1.0 MB"),
        (3 << 30, "3.2 GB"),
    ];
    want.into_iter().for_each(|(bytes, text)| assert_eq!(readable(bytes), text));
}
