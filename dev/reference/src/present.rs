//! Twin of kernel `present`: turns a picture into the bytes of a window.

use glam::DVec3;

use crate::tile_surface::SurfacePoint;
use instgs_vk::math::heat::heat;
use instgs_vk::math::sh::widened;
use instgs_vk::scene::{InstancedScene, SourceRange};

/// The quantity that is shown for each pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Show {
    /// The colour over the background.
    #[default]
    Color,
    /// Alpha, 1 - T, in grey.
    Alpha,
    /// View depth in grey: white at the first of these depths, black at the second and in empty pixels.
    Depth([f64; 2]),
    /// A colour for each instance, black without one.
    Instances,
    /// A colour for each template, dark grey for the background's Gaussians, black in empty pixels.
    Templates,
    /// Heat map of the number of intersections of the pixel's tile; palest from this number on.
    TileLoad(f64),
    /// Heat map of the length of the surface Gaussian's position offset relative to the template's radius; palest from
    /// this ratio on.
    Offsets(f64),
    /// The marks that `tile_marks` drew.
    Marks,
}

/// The inputs, per pixel, row by row from the top. Those that `show` does not need may be empty.
#[derive(Clone, Default)]
pub struct Shown<'a> {
    /// Width and height, pixels.
    pub size_px: [usize; 2],
    /// Colour over the background (r, g, b) and alpha.
    pub colors: &'a [[f32; 4]],
    /// Expected view depth, scene units; 0 in empty pixels.
    pub depths: &'a [f32],
    /// The quantity that is shown.
    pub show: Show,
    /// The id buffer; empty if it is not known.
    pub surfaces: &'a [Option<SurfacePoint>],
    /// By instance: whether it is selected, and gets an outline.
    pub chosen: &'a [bool],
    /// The scene of the instances; needed with `surfaces`.
    pub scene: Option<&'a InstancedScene>,
    /// Side of a tile, pixels, and the number of intersections of each tile, row by row.
    pub tile_loads: (usize, &'a [u32]),
    /// Red, green and blue of the marks; `None` without a mark.
    pub marks: &'a [Option<[u8; 3]>],
}

/// Colour of the outline of selected instances.
const LINE_COLOR: [f64; 3] = [1.0, 0.72, 0.0];
/// A pixel is on the outline if this many of the 5x5 pixels around it are selected.
const LINE_COUNTS: std::ops::RangeInclusive<usize> = 8..=17;
/// Colour of the background's Gaussians among templates.
const BACKGROUND_GREY: [f64; 3] = [0.2; 3];

impl Shown<'_> {
    fn is_chosen(&self, x: i64, y: i64) -> bool {
        let inside = |v: i64, k: usize| v.clamp(0, self.size_px[k] as i64 - 1) as usize;
        let surface = self.surfaces[inside(y, 1) * self.size_px[0] + inside(x, 0)];
        surface.is_some_and(|s| self.chosen.get(s.instance as usize) == Some(&true))
    }

    /// True on the outline of the selection: a third to two thirds of the 5x5 pixels around belong to it.
    fn is_line(&self, x: i64, y: i64) -> bool {
        let around = (-2..=2).flat_map(|dy| (-2..=2).map(move |dx| (x + dx, y + dy)));
        !self.surfaces.is_empty() && LINE_COUNTS.contains(&around.filter(|&(x, y)| self.is_chosen(x, y)).count())
    }

    fn at(&self, x: usize, y: usize) -> [f64; 3] {
        let i = y * self.size_px[0] + x;
        if self.is_line(x as i64, y as i64) {
            return LINE_COLOR;
        }
        let surface = self.surfaces.get(i).copied().flatten();
        match self.show {
            Show::Color => [0, 1, 2].map(|c| f64::from(self.colors[i][c])),
            Show::Alpha => [f64::from(self.colors[i][3]); 3],
            Show::Depth(range) => depth_grey(f64::from(self.depths[i]), range),
            Show::Instances => surface.and_then(|s| self.instance_color(s)).unwrap_or_default(),
            Show::Templates => surface.map_or([0.0; 3], |s| self.template_color(s)),
            Show::Offsets(top) => surface.map_or([0.0; 3], |s| heat(self.offset_part(s) / top)),
            Show::Marks => self.marks[i].unwrap_or_default().map(|level| f64::from(level) / 255.0),
            Show::TileLoad(top) => {
                let (side, loads) = self.tile_loads;
                heat(f64::from(loads[y / side * self.size_px[0].div_ceil(side) + x / side]) / top)
            }
        }
    }

    /// Colour of the instance; `None` for the background.
    fn instance_color(&self, surface: SurfacePoint) -> Option<[f64; 3]> {
        ((surface.instance as usize) < self.scene?.instances.len()).then(|| color_of(surface.instance))
    }

    /// Length of the position offset relative to the template's radius; 0 without offsets.
    fn offset_part(&self, surface: SurfacePoint) -> f64 {
        let of_instance = |scene: &InstancedScene| {
            let instance = scene.instances.get(surface.instance as usize)?;
            let template = scene.template_ranges[instance.template as usize];
            // Own Gaussians come after the template's, and have no offsets.
            let local = (surface.local < template.count).then_some(surface.local)?;
            let offset = scene.offsets.means[(instance.first_offset? + local) as usize];
            Some((widened(offset).length(), radius(scene, template)))
        };
        let (moved, radius) = self.scene.and_then(of_instance).unwrap_or((0.0, 1.0));
        if moved > 0.0 { moved / radius } else { 0.0 }
    }

    fn template_color(&self, surface: SurfacePoint) -> [f64; 3] {
        let instance = self.scene.and_then(|scene| scene.instances.get(surface.instance as usize));
        instance.map_or(BACKGROUND_GREY, |instance| color_of(instance.template))
    }

    /// Red, green and blue of a window of `shown_px` pixels, interpolated from the picture; levels 0 to 255 before
    /// rounding.
    pub fn levels(&self, shown_px: [usize; 2]) -> Vec<[f64; 3]> {
        let axis = |k: usize, at: usize| {
            let place = (at as f64 + 0.5) * self.size_px[k] as f64 / shown_px[k] as f64 - 0.5;
            let place = place.clamp(0.0, (self.size_px[k] - 1) as f64);
            let low = place.floor() as usize;
            (low, (low + 1).min(self.size_px[k] - 1), place.fract())
        };
        let level = |i: usize| {
            let (left, right, part_x) = axis(0, i % shown_px[0]);
            let (top, bottom, part_y) = axis(1, i / shown_px[0]);
            let above = mix(self.at(left, top), self.at(right, top), part_x);
            let below = mix(self.at(left, bottom), self.at(right, bottom), part_x);
            let value: [f64; 3] = mix(above, below, part_y);
            value.map(|v| v.clamp(0.0, 1.0) * 255.0)
        };
        (0..shown_px[0] * shown_px[1]).map(level).collect()
    }
}

/// Radius of the ball around the centre of the template's bounding box that holds its means.
fn radius(scene: &InstancedScene, range: SourceRange) -> f64 {
    let means = &scene.templates.means[range.first as usize..][..range.count as usize];
    let all = || means.iter().map(|&mean| widened(mean));
    let low = all().fold(DVec3::INFINITY, DVec3::min);
    let middle = 0.5 * (low + all().fold(DVec3::NEG_INFINITY, DVec3::max));
    all().map(|mean| mean.distance(middle)).fold(0.0, f64::max)
}

fn depth_grey(depth: f64, [white, black]: [f64; 2]) -> [f64; 3] {
    [if depth > 0.0 { ((black - depth) / (black - white)).clamp(0.0, 1.0) } else { 0.0 }; 3]
}

fn mix(a: [f64; 3], b: [f64; 3], part: f64) -> [f64; 3] {
    std::array::from_fn(|c| a[c] + (b[c] - a[c]) * part)
}

/// The colours of Okabe and Ito without black (Color Universal Design, 2002, revised 2008: <https://jfly.uni-koeln.de/color/>).
const PALETTE: [[u8; 3]; 7] =
    [[230, 159, 0], [86, 180, 233], [0, 158, 115], [240, 228, 66], [0, 114, 178], [213, 94, 0], [204, 121, 167]];
/// Factor of the second seven colours, and part of white in the third seven.
const DARKER: f64 = 0.6;
const LIGHTER: f64 = 0.5;

/// A colour for each number: seven that people with any colour vision tell apart, the same darker, the same lighter, and again.
fn color_of(number: u32) -> [f64; 3] {
    PALETTE[number as usize % 7].map(f64::from).map(|level| level / 255.0).map(|v| match number / 7 % 3 {
        0 => v,
        1 => DARKER * v,
        _ => v + LIGHTER * (1.0 - v),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use instgs_vk::math::similarity::Similarity;
    use instgs_vk::scene::Instance;

    fn scene_of(templates: &[u32]) -> InstancedScene {
        let instance =
            |&template: &u32| Instance { template, world_from_template: Similarity::IDENTITY, first_offset: None };
        InstancedScene { instances: templates.iter().map(instance).collect(), ..InstancedScene::default() }
    }

    fn surface(instance: u32) -> Option<SurfacePoint> {
        Some(SurfacePoint { instance, local: 0 })
    }

    fn levels(color: [f64; 3]) -> [f64; 3] {
        color.map(|v| v * 255.0)
    }

    #[test]
    fn scaling_by_hand() {
        let colors = [[0.0, 0.0, 0.0, 1.0], [1.0, 0.5, 2.0, 0.5]];
        let depths = [0.0, 3.0];
        let shown = |show| Shown { size_px: [2, 1], colors: &colors, depths: &depths, show, ..Shown::default() };
        assert_eq!(shown(Show::Color).levels([2, 1]), vec![[0.0; 3], [255.0, 127.5, 255.0]]);
        // Four pixels: interpolated at a quarter and at three quarters between the centres, clamped at the ends.
        let reds: Vec<f64> = shown(Show::Color).levels([4, 1]).iter().map(|c| c[0]).collect();
        assert_eq!(reds, [0.0, 63.75, 191.25, 255.0]);
        // One pixel: half way between the centres.
        assert_eq!(shown(Show::Alpha).levels([1, 3]), vec![[191.25; 3]; 3]);
        assert_eq!(shown(Show::Depth([2.0, 4.0])).levels([2, 1]), vec![[0.0; 3], [127.5; 3]]);
    }

    #[test]
    fn a_line_runs_along_the_edge_of_what_is_chosen() {
        let surfaces: Vec<_> = (0..7).map(|x| surface(u32::from(x == 6)).filter(|_| x > 0)).collect();
        let scene = scene_of(&[0, 0]);
        let shown = Shown {
            size_px: [7, 1],
            show: Show::Instances,
            surfaces: &surfaces,
            chosen: &[true, false],
            scene: Some(&scene),
            ..Shown::default()
        };
        let line = levels(LINE_COLOR);
        let first = levels(color_of(0));
        assert_eq!(shown.levels([7, 1]), [line, line, first, first, first, line, line]);
    }

    /// Single selected pixels, and single unselected ones within the selection, have no outline.
    #[test]
    fn speckles_have_no_line() {
        for (rest, speckle) in [(0, 1), (1, 0)] {
            let surfaces: Vec<_> = (0..49).map(|i| surface(if i == 24 { speckle } else { rest })).collect();
            let scene = scene_of(&[0, 0]);
            let shown = Shown {
                size_px: [7, 7],
                show: Show::Instances,
                surfaces: &surfaces,
                chosen: &[true, false],
                scene: Some(&scene),
                ..Shown::default()
            };
            assert!(!shown.levels([7, 7]).contains(&levels(LINE_COLOR)));
        }
    }

    #[test]
    fn templates_share_a_color_and_the_background_is_grey() {
        let scene = scene_of(&[1, 0, 1]);
        let surfaces = [surface(0), surface(1), surface(2), surface(3), None];
        let shown = Shown {
            size_px: [5, 1],
            show: Show::Templates,
            surfaces: &surfaces,
            scene: Some(&scene),
            ..Shown::default()
        };
        let [first, second] = [levels(color_of(0)), levels(color_of(1))];
        assert_eq!(shown.levels([5, 1]), [second, first, second, levels(BACKGROUND_GREY), [0.0; 3]]);
    }

    /// Two Gaussians two units apart, with offsets of a quarter and of half a radius; an instance without offsets; the
    /// background.
    #[test]
    fn offsets_by_hand() {
        let mut scene = scene_of(&[0, 0]);
        scene.templates.means = vec![[1.0, 5.0, 0.0], [3.0, 5.0, 0.0]];
        scene.template_ranges = vec![SourceRange { first: 0, count: 2 }];
        scene.instances[1].first_offset = Some(1);
        scene.offsets.means = vec![[9.0; 3], [0.0, 0.25, 0.0], [0.3, 0.0, -0.4]];
        let point = |instance, local| Some(SurfacePoint { instance, local });
        let surfaces = [point(0, 1), point(1, 0), point(1, 1), point(2, 0), None];
        let (size_px, show) = ([5, 1], Show::Offsets(0.5));
        let shown = Shown { size_px, show, surfaces: &surfaces, scene: Some(&scene), ..Shown::default() };
        let [none, half, full] = [0.0, 0.5, 1.0].map(|part| levels(heat(part)));
        assert_eq!(shown.levels([5, 1]), [none, half, full, none, none]);
    }

    #[test]
    fn tile_loads_by_hand() {
        let show = Show::TileLoad(8.0);
        let shown = Shown { size_px: [3, 3], show, tile_loads: (2, &[0, 2, 8, 9]), ..Shown::default() };
        let [none, quarter, full] = [0.0, 0.25, 1.0].map(|part| levels(heat(part)));
        let want = [none, none, quarter, none, none, quarter, full, full, full];
        assert_eq!(shown.levels([3, 3]), want);
    }

    /// What people with each kind of colour vision see, linear rgb: usual, without the red, the green, the blue cones (Machado et
    /// al. 2009, severity 1).
    const VISIONS: [[[f64; 3]; 3]; 4] = [
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
        [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
    ];

    /// CIE L*a*b* of an sRGB colour as one of `VISIONS` sees it.
    fn lab(color: [f64; 3], vision: &[[f64; 3]; 3]) -> DVec3 {
        let dot = |row: &[f64; 3], v: [f64; 3]| (0..3).map(|k| row[k] * v[k]).sum::<f64>();
        let linear = color.map(|v| if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) });
        let seen = [0, 1, 2].map(|k| dot(&vision[k], linear).clamp(0.0, 1.0));
        let xyz = [[0.4339, 0.3763, 0.1899], [0.2126, 0.7152, 0.0722], [0.0177, 0.1095, 0.8729]];
        let [x, y, z] =
            xyz.map(|row| dot(&row, seen)).map(|t| if t > 0.008856 { t.cbrt() } else { 7.787 * t + 16.0 / 116.0 });
        DVec3::new(116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z))
    }

    /// Least distance in L*a*b* between two of some colours, in any colour vision.
    fn least_difference(colors: &[[f64; 3]]) -> f64 {
        let of_vision = |vision: &[[f64; 3]; 3]| {
            let seen: Vec<DVec3> = colors.iter().map(|&color| lab(color, vision)).collect();
            let pairs = (0..seen.len()).flat_map(|a| (0..a).map(move |b| (a, b)));
            pairs.map(|(a, b)| seen[a].distance(seen[b])).fold(f64::INFINITY, f64::min)
        };
        VISIONS.iter().map(of_vision).fold(f64::INFINITY, f64::min)
    }

    /// A difference of 2 is just noticed side by side.
    #[test]
    fn colors_of_numbers_differ_in_every_colour_vision() {
        let colors: Vec<[f64; 3]> = (0..21).map(color_of).collect();
        assert!(least_difference(&colors[..7]) > 15.0 && least_difference(&colors) > 5.0);
        assert_eq!(color_of(21), colors[0]);
        // Hues alone, evenly around the circle, do not.
        let hue = |k: u32| {
            [0.0, 4.0, 2.0].map(|at| ((f64::from(k) / 3.5 + at) % 6.0 - 3.0).abs() - 1.0).map(|v| v.clamp(0.0, 1.0))
        };
        let hues: Vec<[f64; 3]> = (0..21).map(hue).collect();
        assert!(least_difference(&hues) < 2.0);
    }
}
