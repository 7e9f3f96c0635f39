//! Instanced scenes.

use std::path::Path;

use arbitrary::Unstructured;
use instgs_io::scene_file::parse_scene_file;
use instgs_io::scene_write::{paged_scene_file_bytes, scene_file_bytes};
use instgs_io::{Pack, PagedFile};
use instgs_vk::math::rng::Rng;
use instgs_vk::scene::InstancedScene;

use crate::seeds::scenes as files;
use crate::{Seed, SeedError, Target, must, path, properties, random_scene, repair, taken};

pub(super) const TARGETS: &[Target] = &[
    Target { name: "instgs", seeds: plain_seeds, repair: Some(repair::safetensors), read: read_scene },
    Target { name: "instgs_packed", seeds: packed_seeds, repair: Some(repair::safetensors), read: read_scene },
    Target { name: "instgs_pages", seeds: paged_seeds, repair: Some(repair::safetensors), read: read_pages },
    Target { name: "scene_values", seeds: value_seeds, repair: None, read: write_scene },
];

fn plain_seeds() -> Result<Vec<Seed>, SeedError> {
    let small = scene_file_bytes(&files::scene(), path())?;
    Ok(vec![Seed::new("f32", small), Seed::new("all tensors", files::packed(Pack::F32)?)])
}

fn packed_seeds() -> Result<Vec<Seed>, SeedError> {
    Ok(vec![
        Seed::new("f16", files::packed(Pack::F16)?),
        Seed::new("q8", files::packed(Pack::Q8)?),
        Seed::new("small", files::packed(Pack::Small)?),
        Seed::new("older", files::OLDER),
        Seed::new("older coded", files::OLDER_CODED),
        Seed::new("older offsets", files::OLDER_SCENES[0]),
        Seed::new("older own", files::OLDER_SCENES[1]),
    ])
}

fn read_scene(bytes: &[u8], folder: &Path) -> bool {
    let scene = taken(parse_scene_file(bytes, path()));
    scene
        .map(|scene| {
            must(scene.validate(), "a scene that was read is inconsistent");
            properties::scene(scene, folder);
        })
        .is_some()
}

fn paged_seeds() -> Result<Vec<Seed>, SeedError> {
    let background = instgs_samples::sample(1, 700);
    let scene = InstancedScene { background, ..files::scene() };
    let bytes = |pack| paged_scene_file_bytes(&scene, pack, path());
    Ok(vec![Seed::new("f32", bytes(Pack::F32)?), Seed::new("f16", bytes(Pack::F16)?)])
}

/// Opens a file with pages and reads all of them.
fn read_pages(bytes: &[u8], folder: &Path) -> bool {
    let path = folder.join("pages.instgs");
    must(std::fs::write(&path, bytes), "the file cannot be written");
    let Some(mut file) = taken(PagedFile::open(&path)).flatten() else { return false };
    must(file.scene.validate(), "a scene that was opened is inconsistent");
    must(file.table.check(), "a table that was opened is inconsistent");
    for page in file.table.pages() {
        let rows = must(file.read(&page), "a page cannot be read");
        assert_eq!(rows.len(), page.rows() as usize);
        assert!(rows.wrong_length().is_none());
    }
    true
}

fn value_seeds() -> Result<Vec<Seed>, SeedError> {
    let bytes = |seed: u64| {
        let mut rng = Rng::new(seed);
        (0..3000).map(|_| rng.next_u32() as u8).collect::<Vec<_>>()
    };
    Ok(vec![Seed::new("a", bytes(1)), Seed::new("b", bytes(2)), Seed::new("c", bytes(3)), Seed::new("d", bytes(4))])
}

/// Not a file, but bytes that a scene in memory is made of: it is refused with a reason, or written and read.
fn write_scene(bytes: &[u8], folder: &Path) -> bool {
    let Ok(scene) = random_scene::scene(&mut Unstructured::new(bytes)) else { return false };
    if taken(scene.validate()).is_none() {
        return false;
    }
    properties::scene(scene, folder);
    true
}
