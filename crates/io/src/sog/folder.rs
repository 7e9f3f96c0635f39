//! A scene as a folder of `.sog` files, for engines that place objects themselves: `template_N.sog` for each template that has
//! instances, in its own frame, `background.sog`, and `scene_graph.json`, which says where each instance of which template is.
//!
//! What instances have for themselves (offsets, own Gaussians, colour matrices) has no place there: they look like their template.

use std::borrow::Cow;
use std::collections::HashSet;
use std::path::{Path, PathBuf};

use super::read::is_own;
use super::{WrittenSog, write_sog};
use crate::{IoError, Place, read_groups, write_groups};
use instgs_vk::scene::{Gaussians, InstancedScene, PosedGroup, PosedInstance};

/// The file that places the instances.
const SCENE_GRAPH: &str = "scene_graph.json";
const BACKGROUND: &str = "background.sog";
/// Name of a template's file, around its number.
const TEMPLATE: &str = "template_";
const ENDING: &str = ".sog";

/// Writes the folder, which is made if it does not exist; files of these names in it are replaced. What an earlier scene
/// left there is removed: files that its `scene_graph.json` names, and its background, if this program wrote them. Returns
/// the sums of its `.sog` files, to whose bytes those of the scene graph are added.
///
/// # Errors
/// A value that is not finite, more than 65,535 instances, or a file that cannot be written.
pub fn write_sog_folder(folder: &Path, scene: &InstancedScene) -> Result<WrittenSog, IoError> {
    scene
        .validate()
        .map_err(|e| IoError::new(folder, format!("cannot write: {}", e.reason)).at(Place::Tensor(e.tensor)))?;
    std::fs::create_dir_all(folder).map_err(|e| IoError::os(folder, "cannot be made", &e))?;
    let groups = placed(scene);
    let antialias = scene.pixel_filter.antialias;
    let mut clouds: Vec<(String, Cow<'_, Gaussians>)> = groups
        .iter()
        .map(|group| {
            let range = scene.template_ranges[group.template_id as usize];
            (template_file(group), Cow::Owned(scene.templates.range(range)))
        })
        .collect();
    if !scene.background.is_empty() {
        clouds.push((BACKGROUND.to_owned(), Cow::Borrowed(&scene.background)));
    }
    let mut all = WrittenSog::default();
    for (name, cloud) in &clouds {
        let written = write_sog(&folder.join(name), cloud, antialias)?;
        all.gaussians += written.gaussians;
        all.bytes += written.bytes;
        all.moved.gaussians += written.moved.gaussians;
        all.moved.farthest = all.moved.farthest.max(written.moved.farthest);
    }
    // Found before the file that names them is replaced.
    let stale = stale_files(folder, &clouds.iter().map(|(name, _)| name.as_str()).collect());
    let graph = folder.join(SCENE_GRAPH);
    write_groups(&graph, &groups)?;
    all.bytes += std::fs::metadata(&graph).map_or(0, |file| file.len());
    for file in stale {
        std::fs::remove_file(&file).map_err(|e| IoError::os(&file, "cannot be removed", &e))?;
    }
    Ok(all)
}

/// Name of the file of a group's template.
fn template_file(group: &PosedGroup) -> String {
    format!("{TEMPLATE}{}{ENDING}", group.template_id)
}

/// The files that an earlier scene left in the folder and `kept` does not name. Other programs may use the same names: only
/// files beside a scene graph count, of templates those that it names, and only if this program wrote them.
fn stale_files(folder: &Path, kept: &HashSet<&str>) -> Vec<PathBuf> {
    // Where it is missing or of another program, nothing is known to be ours.
    let Ok(earlier) = read_groups(&folder.join(SCENE_GRAPH)) else { return Vec::new() };
    let names = earlier.iter().map(template_file).chain([BACKGROUND.to_owned()]);
    let stale = names.filter(|name| !kept.contains(name.as_str())).map(|name| folder.join(name));
    stale.filter(|file| is_own(file)).collect()
}

/// The instances of each template that has any and is not empty, as pruning may leave it: those show nothing. Their ids are those
/// of the masks, if all have one and no two the same; otherwise they are numbered from 1.
fn placed(scene: &InstancedScene) -> Vec<PosedGroup> {
    let labels = scene.instance_labels();
    let ids: HashSet<u32> = labels.iter().filter_map(|label| label.id).collect();
    let id = |k: usize| labels[k].id.filter(|_| ids.len() == labels.len()).unwrap_or(k as u32 + 1);
    let mut groups: Vec<PosedGroup> = (0..scene.template_ranges.len() as u32)
        .map(|template_id| {
            let named = scene.groups.iter().find(|group| group.template_id == template_id);
            PosedGroup {
                template_id,
                name: named.and_then(|group| group.name.clone()),
                score: None,
                instances: Vec::new(),
            }
        })
        .collect();
    for (k, instance) in scene.instances.iter().enumerate() {
        let placed = PosedInstance { id: id(k), world_from_template: instance.world_from_template };
        groups[instance.template as usize].instances.push(placed);
    }
    let is_empty = |group: &PosedGroup| scene.template_ranges[group.template_id as usize].count == 0;
    groups.retain(|group| !group.instances.is_empty() && !is_empty(group));
    groups
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{read_groups, read_sog};
    use instgs_samples::with_own;

    #[test]
    fn templates_and_background_are_files_and_instances_have_places() -> Result<(), IoError> {
        let folder = tempfile::tempdir().map_err(|e| IoError::os(Path::new("."), "no folder", &e))?;
        let folder = folder.path().join("parts");
        let mut scene = with_own();
        let written = write_sog_folder(&folder, &scene)?;
        let files = std::fs::read_dir(&folder).map_err(|e| IoError::os(&folder, "cannot read", &e))?;
        let lengths = files.flatten().map(|file| file.metadata().map_or(0, |file| file.len()));
        assert_eq!(written.bytes, lengths.sum::<u64>());
        let groups = read_groups(&folder.join(SCENE_GRAPH))?;
        let mut placed = vec![0; scene.template_ranges.len()];
        let mut gaussians = read_sog(&folder.join(BACKGROUND))?.gaussians.len();
        assert_eq!(gaussians, scene.background.len());
        for group in &groups {
            let template = group.template_id as usize;
            let cloud = read_sog(&folder.join(format!("template_{template}.sog")))?.gaussians;
            assert_eq!(cloud.len(), scene.template_ranges[template].count as usize);
            gaussians += cloud.len();
            let places: Vec<_> = group.instances.iter().map(|instance| instance.world_from_template).collect();
            let of_template = scene.instances.iter().filter(|instance| instance.template as usize == template);
            assert_eq!(places, of_template.map(|instance| instance.world_from_template).collect::<Vec<_>>());
            placed[template] = places.len();
        }
        assert_eq!((placed.iter().sum::<usize>(), written.gaussians), (scene.instances.len(), gaussians as u64));
        // Another scene in the same folder leaves nothing of this one, and takes nothing of other programs.
        let foreign = |name: &str| std::fs::write(folder.join(name), b"of another program");
        foreign("template_77.sog").map_err(|e| IoError::os(&folder, "cannot write", &e))?;
        let last = groups[groups.len() - 1].template_id;
        scene = InstancedScene { background: Gaussians::default(), groups: Vec::new(), ..scene };
        scene.instances.iter_mut().for_each(|instance| (instance.template, instance.first_offset) = (0, None));
        assert!(last > 0, "the sample has two templates");
        write_sog_folder(&folder, &scene)?;
        let is_there = |name: &str| folder.join(name).exists();
        assert!(is_there("template_0.sog") && !is_there(&format!("template_{last}.sog")) && !is_there(BACKGROUND));
        assert!(is_there("template_77.sog"));
        foreign(BACKGROUND).map_err(|e| IoError::os(&folder, "cannot write", &e))?;
        write_sog_folder(&folder, &scene)?;
        assert!(is_there(BACKGROUND));
        // Nor where nothing was exported before.
        write_sog(&folder.join(BACKGROUND), &scene.templates, false)?;
        std::fs::remove_file(folder.join(SCENE_GRAPH)).map_err(|e| IoError::os(&folder, "cannot be removed", &e))?;
        write_sog_folder(&folder, &scene)?;
        assert!(is_there(BACKGROUND));
        // An empty template has no file, and its instances, which show nothing, no place.
        scene.template_ranges[0].count = 0;
        write_sog_folder(&folder, &scene)?;
        assert!(!is_there("template_0.sog") && read_groups(&folder.join(SCENE_GRAPH))?.is_empty());
        Ok(())
    }
}
