//! What must hold of everything that a reader accepts.

use std::path::Path;

use glam::DVec3;
use instgs_io::scene_file::parse_scene_file;
use instgs_io::scene_write::{packed_scene_file_bytes, scene_file_bytes};
use instgs_io::{Pack, ply, sog, spz, write_glb};
use instgs_vk::scene::edit::{Edit, Keep, Selector, apply};
use instgs_vk::scene::{Gaussians, InstancedScene, PixelFilter};

use crate::{must, path, taken};

/// Beyond these numbers a scene is only checked, so that an input takes milliseconds.
const MOST_GAUSSIANS: u64 = 2000;
const MOST_INSTANCES: usize = 200;

/// Asserts that a cloud is consistent, and that its file as PLY has the same bits.
pub(crate) fn cloud(cloud: &Gaussians) {
    assert!(cloud.wrong_length().is_none(), "{:?}", cloud.wrong_length());
    if cloud.means.is_empty() || cloud.len() as u64 > MOST_GAUSSIANS {
        return;
    }
    let bytes = ply::ply_bytes(cloud, PixelFilter::default());
    let again = must(ply::parse_ply(&bytes, path()), "a PLY that was written is not read").gaussians;
    assert!(bits_of_cloud(&again) == bits_of_cloud(cloud), "a PLY does not come back bit by bit");
}

/// Asserts that a consistent scene survives every way to write it, every edit, and what is done to scenes on the way to a picture.
pub(crate) fn scene(mut scene: InstancedScene, folder: &Path) {
    // Files hold levels of detail of the templates as they are, and no others.
    scene.drop_stale_levels();
    let expanded = scene.expanded_len();
    let is_large = expanded + scene.templates.len() as u64 + scene.background.len() as u64 > MOST_GAUSSIANS;
    if is_large || scene.instances.len() > MOST_INSTANCES {
        return;
    }
    let bytes = must(scene_file_bytes(&scene, path()), "a scene that was read is not written");
    let again = must(parse_scene_file(&bytes, path()), "a scene that was written is not read");
    assert!(bits_of_scene(&again) == bits_of_scene(&scene), "the tensors do not come back bit by bit");
    // Numbers that are none differ from themselves, and were compared; the rest compares as values.
    assert!(without_tensors(&again) == without_tensors(&scene), "what is beside the tensors does not come back");

    let mut finite = scene;
    finite.drop_non_finite();
    consistent(&finite, "without what is not finite");
    for pack in [Pack::F16, Pack::Q8, Pack::Small] {
        if let Some(bytes) = taken(packed_scene_file_bytes(&finite, pack, path())) {
            let again = must(parse_scene_file(&bytes, path()), "a packed scene is not read");
            assert_eq!(again.expanded_len(), finite.expanded_len(), "{pack:?}");
        }
    }
    taken(write_glb(&folder.join("x.glb"), &finite, DVec3::Y));
    exports(&finite);
    edits(&finite);
    let mut changed = finite.clone();
    changed.prune_transparent(0.3);
    consistent(&changed, "pruned");
    let mut changed = finite;
    changed.recentre_offsets();
    consistent(&changed, "with offsets recentred");
}

fn consistent(scene: &InstancedScene, what: &str) {
    must(scene.validate(), &format!("the scene is inconsistent {what}"));
}

/// The expanded cloud in the formats of clouds.
fn exports(scene: &InstancedScene) {
    let flat = scene.flatten();
    assert_eq!(flat.len() as u64, scene.expanded_len());
    cloud(&flat);
    if let Some(bytes) = taken(spz::spz_bytes(&flat, false, path())) {
        must(spz::parse_spz(&bytes, path()), "an SPZ that was written is not read");
    }
    if let Some(bytes) = taken(sog::sog_bytes(&flat, false, path())) {
        must(sog::parse_sog(&bytes, path()), "a SOG that was written is not read");
    }
}

/// Every kind of edit leaves a consistent scene, or the same one.
fn edits(scene: &InstancedScene) {
    let first = || Selector::Index(0);
    let all = [
        Edit::Duplicate { which: first(), by: DVec3::Y, turn: None },
        Edit::Recolour { which: first(), rgb: [0.1, 0.2, 0.3] },
        Edit::Scale { which: Selector::Template(0), by: 1.5 },
        Edit::MoveTo { which: first(), to: DVec3::ZERO },
        Edit::Swap { which: first(), template: 1 },
        Edit::Crop { template: 0, corners: [DVec3::splat(-1.0), DVec3::INFINITY], keep: Keep::Inside },
        Edit::Erase { template: 0, centres: vec![DVec3::Y], radius: 0.5 },
        Edit::Delete { which: first() },
    ];
    for edit in all {
        let mut changed = scene.clone();
        match apply(&mut changed, &edit) {
            Ok(_) => consistent(&changed, "after an edit"),
            Err(error) => {
                taken::<(), _>(Err(error));
                assert!(bits_of_scene(&changed) == bits_of_scene(scene), "a refused edit changed the scene");
            }
        }
    }
}

fn bits(values: &[f32]) -> impl Iterator<Item = u32> + '_ {
    values.iter().map(|value| value.to_bits())
}

fn bits_of_cloud(cloud: &Gaussians) -> Vec<u32> {
    let shape = [cloud.len() as u32, if cloud.means.is_empty() { 0 } else { cloud.sh_degree }];
    let (means, quats) = (cloud.means.as_flattened(), cloud.quats.as_flattened());
    let (scales, sh) = (cloud.log_scales.as_flattened(), cloud.sh.as_flattened());
    shape
        .into_iter()
        .chain([means, quats, scales, cloud.opacity_logits.as_slice(), sh].into_iter().flat_map(bits))
        .collect()
}

fn bits_of_scene(scene: &InstancedScene) -> Vec<u32> {
    let offsets = &scene.offsets;
    let more = [
        offsets.means.as_flattened(),
        offsets.sh_dc.as_flattened(),
        offsets.opacity_logits.as_slice(),
        offsets.sh_rest.as_flattened(),
        offsets.log_scales.as_flattened(),
        offsets.quats.as_flattened(),
        scene.color_from_template.as_flattened().as_flattened(),
    ];
    let clouds = [&scene.templates, &scene.own, &scene.background].into_iter().flat_map(bits_of_cloud);
    let places = scene.instances.iter().flat_map(|instance| instance.world_from_template.rows().into_iter().flatten());
    clouds.chain(more.into_iter().flat_map(bits)).chain(places.map(f32::to_bits)).collect()
}

/// The scene without what [`bits_of_scene`] compares.
fn without_tensors(scene: &InstancedScene) -> InstancedScene {
    InstancedScene {
        templates: Gaussians::default(),
        own: Gaussians::default(),
        background: Gaussians::default(),
        offsets: Default::default(),
        color_from_template: Vec::new(),
        ..scene.clone()
    }
}
