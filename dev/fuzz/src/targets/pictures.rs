//! Photos, and pictures of floats.

use std::fs;
use std::path::Path;

use instgs_io::{Split, View, ktx2, load_view};
use instgs_vk::math::distortion::Distortion;
use instgs_vk::scene::Camera;

use crate::seeds::pictures as files;
use crate::{Seed, SeedError, Target, must, path, repair, taken};

pub(super) const TARGETS: &[Target] = &[
    Target { name: "jpeg", seeds: jpeg_seeds, repair: None, read: read_photo },
    Target { name: "png", seeds: png_seeds, repair: Some(|bytes| repair::png(bytes)), read: read_photo },
    Target { name: "ktx2", seeds: ktx2_seeds, repair: None, read: read_ktx2 },
];

fn jpeg_seeds() -> Result<Vec<Seed>, SeedError> {
    Ok(vec![Seed::new("rgb", files::jpeg()?)])
}

fn png_seeds() -> Result<Vec<Seed>, SeedError> {
    Ok(vec![Seed::new("rgb", files::png()?), Seed::new("rgba", files::png_with_alpha()?)])
}

/// A photo of a view whose camera has the size that the file has, as far as that is small; one in four through a lens.
fn read_photo(bytes: &[u8], folder: &Path) -> bool {
    const MOST_PIXELS: u64 = 1 << 20;
    let file = folder.join("photo.png");
    must(fs::write(&file, bytes), "the scratch folder");
    let size = image::ImageReader::open(&file).ok().and_then(|reader| reader.with_guessed_format().ok());
    let (width, height) = size.and_then(|reader| reader.into_dimensions().ok()).unwrap_or((12, 9));
    if u64::from(width) * u64::from(height) > MOST_PIXELS || width == 0 || height == 0 {
        return false;
    }
    let (w, h) = (f64::from(width), f64::from(height));
    let rows = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];
    let camera =
        Camera { name: "a".into(), width, height, fx: w, fy: w, cx: w / 2.0, cy: h / 2.0, view_from_world: rows };
    let lens = Distortion { k1: 0.1, k2: -0.02, p1: 0.001, ..Distortion::default() };
    let distortion = bytes.len().is_multiple_of(4).then_some(lens);
    let view = View { camera, image_path: file, split: Split::Train, distortion, mask_path: None };
    let Some(loaded) = taken(load_view(&view, Some(5))) else { return false };
    let pixels = loaded.image.width as usize * loaded.image.height as usize;
    assert_eq!((loaded.image.rgba.len(), loaded.camera.width), (pixels, loaded.image.width));
    true
}

fn ktx2_seeds() -> Result<Vec<Seed>, SeedError> {
    Ok(vec![Seed::new("four channels", files::ktx2()?)])
}

fn read_ktx2(bytes: &[u8], _: &Path) -> bool {
    let Some(picture) = taken(ktx2::parse_ktx2(bytes, path())) else { return false };
    // A picture without pixels is read, but not written.
    let Some(again) = taken(ktx2::ktx2_bytes(&picture, path())) else { return true };
    let again = must(ktx2::parse_ktx2(&again, path()), "a picture that was written is not read");
    assert!(again.values.iter().map(|v| v.to_bits()).eq(picture.values.iter().map(|v| v.to_bits())));
    true
}
