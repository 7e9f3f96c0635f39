//! The views of a scene: names, keys, legends, and the menu that selects one.

use super::texts;
use instgs_vk::math::heat::heat;
use instgs_vk::render::Show;
use instgs_vk::render::show::{ELLIPSE_ALPHA, OFFSET_TOP, TILE_LOAD_TOP};

/// The depth view is black from this multiple of the target distance on.
const DEPTH_OF_DISTANCE: f32 = 3.0;
/// Width and height of the colour bar, points.
const BAR: [f32; 2] = [240.0, 10.0];
/// Patches of the colour bar: fine enough for its width.
const PATCHES: u16 = 120;

/// A view, without its adjustable value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum View {
    /// Colours of the splats; see [`Show::Color`].
    Color,
    /// Coverage, 1 - transmittance; see [`Show::Alpha`].
    Alpha,
    /// Depth as a grey value; see [`Show::Depth`].
    Depth,
    /// One colour per instance; see [`Show::Instances`].
    Instances,
    /// One colour per template; see [`Show::Templates`].
    Templates,
    /// Intersections per tile; see [`Show::TileLoad`].
    TileLoad,
    /// Length of position offsets; see [`Show::Offsets`].
    Offsets,
    /// Centres of the splats; see [`Show::Points`].
    Points,
    /// Outlines of the splats; see [`Show::Ellipses`].
    Ellipses,
}

impl View {
    /// All views: the keys 1 to 9 select them in this order.
    pub const ALL: [Self; 9] = [
        Self::Color,
        Self::Alpha,
        Self::Depth,
        Self::Instances,
        Self::Templates,
        Self::TileLoad,
        Self::Offsets,
        Self::Points,
        Self::Ellipses,
    ];

    /// The view of a setting, without its value.
    pub fn of(show: Show) -> Self {
        match show {
            Show::Color => Self::Color,
            Show::Alpha => Self::Alpha,
            Show::Depth(_) => Self::Depth,
            Show::Instances => Self::Instances,
            Show::Templates => Self::Templates,
            Show::TileLoad(_) => Self::TileLoad,
            Show::Offsets(_) => Self::Offsets,
            Show::Points => Self::Points,
            Show::Ellipses(_) => Self::Ellipses,
        }
    }

    /// Like [`View::show`], with an explicit value; `None` if the view has none.
    pub fn show_at(self, distance: f64, value: f32) -> Option<Show> {
        let mut show = self.show(distance);
        level(&mut show).map(|(level, ..)| *level = value)?;
        Some(show)
    }

    /// The view with its default value; `distance` is that to the target, scene units.
    pub fn show(self, distance: f64) -> Show {
        match self {
            Self::Color => Show::Color,
            Self::Alpha => Show::Alpha,
            Self::Depth => Show::Depth([0.0, DEPTH_OF_DISTANCE * distance as f32]),
            Self::Instances => Show::Instances,
            Self::Templates => Show::Templates,
            Self::TileLoad => Show::TileLoad(TILE_LOAD_TOP),
            Self::Offsets => Show::Offsets(OFFSET_TOP),
            Self::Points => Show::Points,
            Self::Ellipses => Show::Ellipses(ELLIPSE_ALPHA),
        }
    }
}

/// The menu of views, with legend and slider. `distance` as in [`View::show`], `slabs` is the number of depth slabs of the frame.
pub(super) fn choose(ui: &mut egui::Ui, show: &mut Show, distance: f64, slabs: u32) {
    let chosen = View::of(*show);
    ui.horizontal(|ui| {
        egui::ComboBox::from_id_salt("view").selected_text(texts::view_name(chosen)).show_ui(ui, |ui| {
            for (key, view) in (1..).zip(View::ALL) {
                if ui.selectable_label(view == chosen, format!("{key}  {}", texts::view_name(view))).clicked() {
                    *show = view.show(distance);
                }
            }
        });
        ui.label(texts::SHOWN);
    });
    if matches!(show, Show::TileLoad(_) | Show::Offsets(_)) {
        bar(ui);
    }
    if let Some((level, range, name)) = level(show) {
        let slider = egui::Slider::new(level, range).logarithmic(true).clamping(egui::SliderClamping::Never);
        ui.add(slider.text(name));
    }
    ui.label(texts::legend(*show, slabs));
}

/// The adjustable value of a view, the range of its slider, and its label.
fn level(show: &mut Show) -> Option<(&mut f32, std::ops::RangeInclusive<f32>, &'static str)> {
    match show {
        Show::TileLoad(top) => Some((top, 1.0..=65536.0, texts::TOP_OF_SCALE)),
        Show::Offsets(top) => Some((top, 0.001..=10.0, texts::TOP_OF_SCALE)),
        Show::Ellipses(alpha) => Some((alpha, 0.004..=1.0, texts::LEAST_ALPHA)),
        _ => None,
    }
}

/// Draws the colour bar of the heat map.
fn bar(ui: &mut egui::Ui) {
    let (rect, _) = ui.allocate_exact_size(BAR.into(), egui::Sense::hover());
    let width = rect.width() / f32::from(PATCHES);
    for k in 0..PATCHES {
        let [r, g, b] = heat(f64::from(k) / f64::from(PATCHES - 1)).map(|v| (255.0 * v) as u8);
        let left = rect.left() + f32::from(k) * width;
        let patch = egui::Rect::from_min_size(egui::pos2(left, rect.top()), egui::vec2(width + 0.5, rect.height()));
        ui.painter().rect_filled(patch, 0.0, egui::Color32::from_rgb(r, g, b));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_view_has_its_own_name_and_legend_and_is_found_again() {
        let told = |view: &View| (texts::view_name(*view), texts::legend(view.show(2.0), 1));
        let mut all: Vec<_> = View::ALL.iter().map(told).collect();
        all.sort();
        all.dedup_by(|a, b| a.0 == b.0);
        assert!(all.len() == View::ALL.len() && all.iter().all(|(_, legend)| legend.len() > 5), "{all:?}");
        assert!(View::ALL.iter().all(|view| View::of(view.show(2.0)) == *view));
        assert_eq!(View::Depth.show(2.0), Show::Depth([0.0, 6.0]));
        assert!(texts::legend(Show::TileLoad(64.0), 3).contains("last of 3"));
        assert_eq!(View::Offsets.show_at(2.0, 0.5), Some(Show::Offsets(0.5)));
        assert_eq!(View::Points.show_at(2.0, 0.5), None);
    }
}
