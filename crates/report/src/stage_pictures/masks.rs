//! Masks painted over their photo.

use super::colors::luminance;
use crate::Rgb8;
use instgs_io::Mask;

/// Opacity of a mask's colour over the grey photo.
const INSIDE: f32 = 0.62;
/// Brightness of the photo outside of masks.
const OUTSIDE: f32 = 0.55;
/// Width of the stripes of masks that were not used, pixels.
const STRIPE_PX: u32 = 4;

/// How a mask's pixels are painted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Paint {
    /// No object: the photo, darkened.
    Nothing,
    /// The colour of an object, sRGB.
    Color([u8; 3]),
    /// A mask that belongs to no object: stripes.
    Unused,
}

/// The photo in grey with its mask over it, outlined. The mask may have another size than the photo.
pub(super) fn painted(photo: &Rgb8, mask: &Mask, paint: impl Fn(u16) -> Paint) -> Rgb8 {
    let (width, height) = (photo.width, photo.height);
    let mask = mask.resized(width, height);
    let at = |x: u32, y: u32| mask.ids[(y * width + x) as usize];
    let mut pixels = Vec::with_capacity(photo.pixels.len());
    for (i, pixel) in (0..).zip(photo.pixels.as_chunks::<3>().0) {
        let (x, y) = (i % width, i / width);
        let id = at(x, y);
        let is_edge = (x + 1 < width && at(x + 1, y) != id) || (y + 1 < height && at(x, y + 1) != id);
        let grey = luminance(pixel.map(f32::from));
        let color = match paint(id) {
            Paint::Nothing => [OUTSIDE * grey; 3],
            Paint::Color(color) => mixed(grey, color, if is_edge { 1.0 } else { INSIDE }),
            Paint::Unused if ((x + y) / STRIPE_PX).is_multiple_of(2) => mixed(grey, [255; 3], INSIDE),
            Paint::Unused => mixed(grey, [0; 3], INSIDE),
        };
        pixels.extend(color.map(|c| c.round() as u8));
    }
    Rgb8 { width, height, pixels }
}

fn mixed(grey: f32, color: [u8; 3], part: f32) -> [f32; 3] {
    color.map(|c| (1.0 - part) * grey + part * f32::from(c))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::super::colors::Colors;
    use super::super::object_paint;
    use super::*;
    use instgs_objects::segment::IdTable;

    fn grey(width: u32, height: u32) -> Rgb8 {
        Rgb8 { width, height, pixels: vec![100; (3 * width * height) as usize] }
    }

    fn pixel(picture: &Rgb8, i: usize) -> [u8; 3] {
        [0, 1, 2].map(|c| picture.pixels[3 * i + c])
    }

    #[test]
    fn objects_keep_their_colour_though_ids_change() {
        // The same two objects; ids are swapped in the second view, in which a third mask shows no object.
        let mask = |ids: [u16; 4]| Mask { width: 4, height: 1, ids: ids.into() };
        let views = [mask([1, 1, 2, 2]), mask([2, 2, 1, 7])];
        let table = IdTable::PerView(vec![BTreeMap::from([(1, 5), (2, 6)]), BTreeMap::from([(2, 5), (1, 6)])]);
        let colors = Colors::of_ids([5, 6]);
        let pictures =
            [0, 1].map(|view| painted(&grey(4, 1), &views[view], |id| object_paint(&table, view, id, &colors)));
        assert_eq!(pixel(&pictures[0], 0), pixel(&pictures[1], 0), "object 5");
        let expected = mixed(100.0, colors.of(5).unwrap(), INSIDE).map(|c| c.round() as u8);
        assert_eq!(pixel(&pictures[0], 0), expected);
        assert_ne!(pixel(&pictures[0], 0), pixel(&pictures[0], 3), "another object");
        assert_eq!(object_paint(&table, 1, 7, &colors), Paint::Unused);
        assert_eq!(object_paint(&table, 1, 0, &colors), Paint::Nothing);
    }

    #[test]
    fn masks_fit_photos_of_any_size_and_have_outlines() {
        let mask = Mask { width: 2, height: 1, ids: vec![0, 9] };
        let picture =
            painted(&grey(8, 2), &mask, |id| if id == 9 { Paint::Color([255, 0, 0]) } else { Paint::Nothing });
        assert_eq!((picture.width, picture.height, picture.pixels.len()), (8, 2, 48));
        assert_eq!(pixel(&picture, 0), [55; 3]);
        assert_eq!(pixel(&picture, 12), mixed(100.0, [255, 0, 0], INSIDE).map(|c| c.round() as u8));
        let edge = painted(&grey(2, 1), &Mask { width: 2, height: 1, ids: vec![9, 0] }, |id| match id {
            0 => Paint::Nothing,
            _ => Paint::Color([255, 0, 0]),
        });
        assert_eq!(pixel(&edge, 0), [255, 0, 0]);
    }
}
