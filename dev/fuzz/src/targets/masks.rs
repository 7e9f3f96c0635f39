//! Masks of objects.

use std::fs;
use std::path::Path;

use instgs_io::masks::{coco, labelme, read_categories};
use instgs_io::{mask_png, write_categories};

use crate::seeds::masks as files;
use crate::{Seed, SeedError, Target, must, path, repair, taken};

pub(super) const TARGETS: &[Target] = &[
    Target { name: "mask", seeds: png_seeds, repair: Some(|bytes| repair::png(bytes)), read: read_mask },
    Target { name: "coco", seeds: coco_seeds, repair: None, read: read_coco },
    Target { name: "labelme", seeds: labelme_seeds, repair: None, read: read_labelme },
    Target { name: "categories", seeds: category_seeds, repair: None, read: read_all_categories },
];

/// Most pixels of a side of a mask that is drawn.
const MOST_SIDE: u32 = 64;

fn png_seeds() -> Result<Vec<Seed>, SeedError> {
    let of_palette = Seed::new("palette", files::palette_png()?);
    Ok(vec![Seed::new("grey", files::mask_png()?), of_palette, Seed::new("colour", files::color_png()?)])
}

fn read_mask(bytes: &[u8], _: &Path) -> bool {
    let Some(mask) = taken(mask_png::parse_mask(bytes, path())) else { return false };
    assert_eq!(mask.ids.len(), mask.width as usize * mask.height as usize);
    assert_eq!(mask.resized(3, 2).ids.len(), 6);
    let again = must(mask_png::mask_bytes(&mask, path()), "a mask that was read is not written");
    let again = must(mask_png::parse_mask(&again, path()), "a mask that was written is not read");
    assert!(again == mask, "a mask does not come back");
    true
}

fn coco_seeds() -> Result<Vec<Seed>, SeedError> {
    Ok(vec![Seed::new("all kinds", files::COCO)])
}

fn read_coco(bytes: &[u8], _: &Path) -> bool {
    taken(coco::parse_coco(bytes, path()).and_then(|masks| masks.draw_all(MOST_SIDE))).is_some()
}

fn labelme_seeds() -> Result<Vec<Seed>, SeedError> {
    Ok(vec![Seed::new("all kinds", files::LABELME)])
}

fn read_labelme(bytes: &[u8], _: &Path) -> bool {
    taken(labelme::parse_labelme(bytes, path()).and_then(|masks| masks.draw_all(MOST_SIDE))).is_some()
}

fn category_seeds() -> Result<Vec<Seed>, SeedError> {
    Ok(vec![Seed::new("two", files::CATEGORIES)])
}

fn read_all_categories(bytes: &[u8], folder: &Path) -> bool {
    let (given, again) = (folder.join("categories.json"), folder.join("again.json"));
    must(fs::write(&given, bytes), "the scratch folder");
    let Some(categories) = taken(read_categories(&given)) else { return false };
    must(write_categories(&again, &categories), "categories that were read are not written");
    assert!(must(read_categories(&again), "categories that were written are not read") == categories);
    true
}
