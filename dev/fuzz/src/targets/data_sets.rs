//! Cameras, views, groups and boxes.

use std::fs;
use std::path::Path;

use instgs_io::view_image::camera_at_width;
use instgs_io::{
    camera_file, colmap, groups, nerf, read_boxes, read_points, read_views, write_boxes, write_cameras, write_groups,
};

use crate::seeds::data_sets as files;
use crate::{Seed, SeedError, Target, must, path, taken};

pub(super) const TARGETS: &[Target] = &[
    Target { name: "cameras", seeds: camera_seeds, repair: None, read: read_cameras },
    Target { name: "transforms", seeds: transform_seeds, repair: None, read: read_transforms },
    Target { name: "colmap_cameras_bin", seeds: cameras_bin_seeds, repair: None, read: read_cameras_bin },
    Target { name: "colmap_images_bin", seeds: images_bin_seeds, repair: None, read: read_images_bin },
    Target { name: "colmap_cameras_txt", seeds: cameras_txt_seeds, repair: None, read: read_cameras_txt },
    Target { name: "colmap_images_txt", seeds: images_txt_seeds, repair: None, read: read_images_txt },
    Target { name: "groups", seeds: group_seeds, repair: None, read: read_groups },
    Target { name: "boxes", seeds: box_seeds, repair: None, read: read_all_boxes },
];

fn camera_seeds() -> Result<Vec<Seed>, SeedError> {
    Ok(vec![Seed::new("one", files::CAMERAS)])
}

fn read_cameras(bytes: &[u8], folder: &Path) -> bool {
    let Some(cameras) = taken(camera_file::parse_cameras(bytes, path())) else { return false };
    for camera in &cameras {
        let _ = (camera.world_from_view(), camera.position_world(), camera.resized(3, 5));
    }
    let again = folder.join("cameras.json");
    must(write_cameras(&again, &cameras), "cameras that were read are not written");
    let again = must(camera_file::read_cameras(&again), "cameras that were written are not read");
    assert!(again == cameras, "cameras do not come back");
    true
}

fn transform_seeds() -> Result<Vec<Seed>, SeedError> {
    Ok(vec![Seed::new("one", files::TRANSFORMS), Seed::new("many keys", files::TRANSFORMS_OF_MANY_KEYS)])
}

/// As a file alone, and as the data set that its folder is.
fn read_transforms(bytes: &[u8], folder: &Path) -> bool {
    let alone = taken(nerf::parse_transforms(bytes, path())).is_some();
    must(fs::write(folder.join("transforms.json"), bytes), "the scratch folder");
    if let Some(data) = taken(read_views(folder)) {
        data.views.iter().for_each(|view| must(camera_at_width(&view.camera, Some(7)).validate(), "a camera"));
    }
    taken(read_points(folder));
    alone
}

fn cameras_bin_seeds() -> Result<Vec<Seed>, SeedError> {
    Ok(vec![Seed::new("one", files::colmap_bin().0)])
}

fn read_cameras_bin(bytes: &[u8], _: &Path) -> bool {
    taken(colmap::parse_colmap_bin(bytes, &files::colmap_bin().1, path())).is_some()
}

fn images_bin_seeds() -> Result<Vec<Seed>, SeedError> {
    Ok(vec![Seed::new("one", files::colmap_bin().1)])
}

fn read_images_bin(bytes: &[u8], _: &Path) -> bool {
    taken(colmap::parse_colmap_bin(&files::colmap_bin().0, bytes, path())).is_some()
}

fn cameras_txt_seeds() -> Result<Vec<Seed>, SeedError> {
    Ok(vec![Seed::new("one", files::COLMAP_CAMERAS)])
}

fn read_cameras_txt(bytes: &[u8], _: &Path) -> bool {
    taken(colmap::parse_colmap_txt(bytes, files::COLMAP_IMAGES.as_bytes(), path())).is_some()
}

fn images_txt_seeds() -> Result<Vec<Seed>, SeedError> {
    Ok(vec![Seed::new("two", files::COLMAP_IMAGES)])
}

fn read_images_txt(bytes: &[u8], _: &Path) -> bool {
    taken(colmap::parse_colmap_txt(files::COLMAP_CAMERAS.as_bytes(), bytes, path())).is_some()
}

fn group_seeds() -> Result<Vec<Seed>, SeedError> {
    Ok(vec![Seed::new("one", files::GROUPS)])
}

fn read_groups(bytes: &[u8], folder: &Path) -> bool {
    let Some(found) = taken(groups::parse_groups(bytes, path())) else { return false };
    let again = folder.join("groups.json");
    must(write_groups(&again, &found), "groups that were read are not written");
    let again = must(groups::read_groups(&again), "groups that were written are not read");
    assert_eq!(again.len(), found.len());
    true
}

fn box_seeds() -> Result<Vec<Seed>, SeedError> {
    Ok(vec![Seed::new("both kinds", files::BOXES)])
}

fn read_all_boxes(bytes: &[u8], folder: &Path) -> bool {
    let (given, again) = (folder.join("boxes.json"), folder.join("again.json"));
    must(fs::write(&given, bytes), "the scratch folder");
    let Some(boxes) = taken(read_boxes(&given)) else { return false };
    must(write_boxes(&again, &boxes), "boxes that were read are not written");
    must(read_boxes(&again), "boxes that were written are not read");
    true
}
