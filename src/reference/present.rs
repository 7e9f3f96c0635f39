//! Twin of kernel `present`: a picture as the bytes of a window.

/// What is shown of each pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Show {
    /// Colour over the background.
    Color,
    /// 1 - T, grey.
    Alpha,
    /// View depth, grey: white at the first of these depths, black at the second and where nothing is.
    Depth([f64; 2]),
    /// A colour for each instance, black where there is none.
    Instances,
}

/// A picture by pixel, row by row from the top.
pub struct Shown<'a> {
    /// Width and height, pixels.
    pub size_px: [usize; 2],
    /// rgb over the background, and alpha.
    pub colors: &'a [[f32; 4]],
    /// Expected view depth; 0 where nothing is.
    pub depths: &'a [f32],
    /// What is shown.
    pub show: Show,
    /// Instance at the surface; empty if it is not known.
    pub surfaces: &'a [Option<u32>],
    /// By instance: around what is chosen there is a line.
    pub chosen: &'a [bool],
}

/// Of the line around what is chosen.
const LINE_COLOR: [f64; 3] = [1.0, 0.72, 0.0];

impl Shown<'_> {
    fn is_chosen(&self, x: i64, y: i64) -> bool {
        let inside = |v: i64, k: usize| v.clamp(0, self.size_px[k] as i64 - 1) as usize;
        let instance = self.surfaces[inside(y, 1) * self.size_px[0] + inside(x, 0)];
        instance.is_some_and(|k| self.chosen.get(k as usize) == Some(&true))
    }

    /// On the inner side of the outline of what is chosen, two pixels wide.
    fn is_line(&self, x: i64, y: i64) -> bool {
        let around = (-2..=2).flat_map(|dy| (-2..=2).map(move |dx| (x + dx, y + dy)));
        !self.surfaces.is_empty() && self.is_chosen(x, y) && around.into_iter().any(|(x, y)| !self.is_chosen(x, y))
    }

    fn at(&self, x: usize, y: usize) -> [f64; 3] {
        let i = y * self.size_px[0] + x;
        if self.is_line(x as i64, y as i64) {
            return LINE_COLOR;
        }
        let [r, g, b, a] = self.colors[i].map(f64::from);
        match self.show {
            Show::Instances => {
                let known = self.surfaces.get(i).copied().flatten();
                known.filter(|&k| (k as usize) < self.chosen.len()).map_or([0.0; 3], color_of)
            }
            Show::Color => [r, g, b],
            Show::Alpha => [a; 3],
            Show::Depth([white, black]) => {
                let depth = f64::from(self.depths[i]);
                [if depth > 0.0 { ((black - depth) / (black - white)).clamp(0.0, 1.0) } else { 0.0 }; 3]
            }
        }
    }

    /// Red, green and blue of a window of `shown_px`, levels 0 to 255 before rounding.
    pub fn levels(&self, shown_px: [usize; 2]) -> Vec<[f64; 3]> {
        let axis = |k: usize, at: usize| {
            let place = (at as f64 + 0.5) * self.size_px[k] as f64 / shown_px[k] as f64 - 0.5;
            let place = place.clamp(0.0, (self.size_px[k] - 1) as f64);
            let low = place.floor() as usize;
            (low, (low + 1).min(self.size_px[k] - 1), place.fract())
        };
        let mix = |a: [f64; 3], b: [f64; 3], part: f64| std::array::from_fn(|c| a[c] + (b[c] - a[c]) * part);
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

/// Neighbours in number far apart in hue: steps of the golden angle around the colour circle.
fn color_of(instance: u32) -> [f64; 3] {
    // As the device has it: the product is f32.
    let turn = f64::from((instance as f32 * 0.618_034).fract());
    [0.0, 2.0 / 3.0, 1.0 / 3.0].map(|shift| {
        let place = (turn + shift).fract() * 6.0 - 3.0;
        0.15 + 0.85 * (place.abs() - 1.0).clamp(0.0, 1.0)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scaling_by_hand() {
        let colors = [[0.0, 0.0, 0.0, 1.0], [1.0, 0.5, 2.0, 0.5]];
        let shown =
            |show| Shown { size_px: [2, 1], colors: &colors, depths: &[0.0, 3.0], show, surfaces: &[], chosen: &[] };
        assert_eq!(shown(Show::Color).levels([2, 1]), vec![[0.0; 3], [255.0, 127.5, 255.0]]);
        // Four pixels: a quarter and three quarters of the way between the centres, and the ends.
        let reds: Vec<f64> = shown(Show::Color).levels([4, 1]).iter().map(|c| c[0]).collect();
        assert_eq!(reds, [0.0, 63.75, 191.25, 255.0]);
        // One pixel: half way.
        assert_eq!(shown(Show::Alpha).levels([1, 3]), vec![[191.25; 3]; 3]);
        assert_eq!(shown(Show::Depth([2.0, 4.0])).levels([2, 1]), vec![[0.0; 3], [127.5; 3]]);
    }

    #[test]
    fn a_line_runs_inside_what_is_chosen() {
        let surfaces: Vec<Option<u32>> = (0..7).map(|x| (x > 0).then_some(u32::from(x == 6))).collect();
        let (colors, depths) = ([[0.0; 4]; 7], [0.0; 7]);
        let chosen = [true, false];
        let shown = Shown {
            size_px: [7, 1],
            colors: &colors,
            depths: &depths,
            show: Show::Instances,
            surfaces: &surfaces,
            chosen: &chosen,
        };
        let line = LINE_COLOR.map(|v| v * 255.0);
        let [none, first, second] = [[0.0; 3], color_of(0).map(|v| v * 255.0), color_of(1).map(|v| v * 255.0)];
        assert_eq!(shown.levels([7, 1]), [none, line, line, first, line, line, second]);
    }
}
