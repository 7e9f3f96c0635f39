//! Test views side by side: photo, 3DGS, InstGS, and the difference between InstGS and the photo.

use std::path::Path;

use crate::protocol::names;
use instgs_console::CliError;
use instgs_eval::Evaluated;
use instgs_io::picture_png::write_png;

/// Number of test views in the picture.
const SHOWN: usize = 4;
/// Factor that makes differences visible.
pub(super) const DIFFERENCE_GAIN: f32 = 4.0;

/// Test views side by side, one row per view.
#[derive(Default)]
pub(super) struct Grid {
    rows: Vec<GridRow>,
}

/// One view: photo, 3DGS, InstGS.
struct GridRow {
    name: String,
    size: (u32, u32),
    photo: Vec<[f32; 3]>,
    renders: Vec<Vec<[f32; 3]>>,
}

impl Grid {
    /// Adds a rendering if `scene` is one of the two that are shown.
    pub(super) fn add(&mut self, scene: &str, view: &Evaluated<'_>) {
        if ![names::SAME_TIME, names::OURS].contains(&scene) {
            return;
        }
        let render = view.pair.render().to_vec();
        if let Some(row) = self.rows.iter_mut().find(|row| row.name == view.name) {
            row.renders.push(render);
        } else if self.rows.len() < SHOWN {
            let size = (view.pair.width(), view.pair.height());
            let photo = view.pair.target().to_vec();
            self.rows.push(GridRow { name: view.name.into(), size, photo, renders: vec![render] });
        }
    }

    /// Writes the picture: columns photo, 3DGS, InstGS, and the difference between InstGS and the photo.
    pub(super) fn write(&self, path: &Path) -> Result<(), CliError> {
        let Some(&GridRow { size: (width, height), .. }) = self.rows.first() else { return Ok(()) };
        let columns = 4;
        let mut pixels = Vec::new();
        for row in self.rows.iter().filter(|row| row.size == (width, height) && row.renders.len() == 2) {
            let difference: Vec<[f32; 3]> =
                row.photo.iter().zip(&row.renders[1]).map(|(a, b)| differ(*a, *b)).collect();
            for y in 0..height as usize {
                let line = y * width as usize..(y + 1) * width as usize;
                for picture in [&row.photo, &row.renders[0], &row.renders[1], &difference] {
                    pixels.extend(picture[line.clone()].iter().flatten().map(|v| (v.clamp(0.0, 1.0) * 255.0) as u8));
                }
            }
        }
        let rows = pixels.len() as u32 / (3 * columns * width);
        Ok(write_png(path, &pixels, (columns * width, rows))?)
    }
}

/// Amplified difference of two colours.
fn differ(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|c| DIFFERENCE_GAIN * (a[c] - b[c]).abs())
}

#[cfg(test)]
mod tests {
    use super::*;
    use instgs_eval::{Extras, Metrics, PicturePair};

    /// Two views of 2x1 pixels: four columns, one row each; a view with a rendering of only one scene is left out.
    #[test]
    fn pictures_stand_side_by_side() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("grid.png");
        let mut grid = Grid::default();
        let target = [[0.5f32; 3]; 2];
        for (scene, value) in [(names::START, 0.0f32), (names::SAME_TIME, 0.25), (names::OURS, 0.625)] {
            let views: &[&str] = if scene == names::OURS { &["a", "b", "c"] } else { &["a", "b"] };
            for name in views {
                let pair = PicturePair::new((2, 1), &[[value; 3]; 2], &target, None)?;
                let metrics = Metrics::of(&pair, Extras::default())?;
                grid.add(scene, &Evaluated { name, pair: &pair, metrics, visible: 1 });
            }
        }
        grid.write(&path)?;
        let picture = image::open(&path)?.into_rgb8();
        assert_eq!(picture.dimensions(), (8, 2));
        let row: Vec<u8> = (0..8).map(|x| picture.get_pixel(x, 1).0[0]).collect();
        assert_eq!(row, [127, 127, 63, 63, 159, 159, 127, 127]);
        Ok(())
    }
}
