//! The trained scenes of blocks: from run folders, or from scene files of any engine.

use std::path::{Path, PathBuf};

use instgs_io::{IoError, RunFolder, load_scene};
use instgs_vk::scene::InstancedScene;

use crate::plan::{PLAN, Plan, block_of};

/// The scenes of all blocks of one plan.
pub struct BlockRuns {
    /// The plan.
    pub plan: Plan,
    /// By block of the plan, its scene's file.
    pub files: Vec<PathBuf>,
    /// By block of the plan, its scene.
    pub scenes: Vec<InstancedScene>,
    /// Warnings of the readers, one line each.
    pub warnings: Vec<String>,
}

/// Reads the scenes of runs: folders with a trained scene, or scene files. Each lies in the folder of its block.
///
/// # Errors
/// A run has no scene or no block, two are of one block, they are of two plans, or a block of the plan has none.
pub fn read_runs(runs: &[PathBuf]) -> Result<BlockRuns, IoError> {
    let mut plan: Option<(PathBuf, Plan)> = None;
    let mut files: Vec<Option<PathBuf>> = Vec::new();
    for run in runs {
        let (folder, name) = block_of(run)?;
        if plan.is_none() {
            let read = Plan::read(&folder)?;
            files = vec![None; read.blocks.len()];
            plan = Some((folder.clone(), read));
        }
        let Some((of_first, read)) = &plan else { continue };
        if *of_first != folder {
            let error = IoError::new(run, format!("belongs to {}, not to {}", folder.display(), of_first.display()));
            return Err(error.advise("join the runs of one split"));
        }
        let Some(number) = read.blocks.iter().position(|block| block.name == name) else {
            let error =
                IoError::new(run, format!("lies in {name}, which is no block of {}", folder.join(PLAN).display()));
            return Err(error.advise("put it into the folder of its block"));
        };
        if let Some(other) = files[number].replace(scene_file(run)?) {
            let error = IoError::new(run, format!("is of {name}, and so is {}", other.display()));
            return Err(error.advise("give one run per block"));
        }
    }
    let Some((folder, plan)) = plan else {
        return Err(IoError::new(Path::new("."), "no run is given").advise("name the run of every block"));
    };
    let missing = plan.blocks.iter().zip(&files).find(|(_, file)| file.is_none());
    if let Some((block, _)) = missing {
        let error = IoError::new(&folder.join(&block.name), "no run of this block is given: its ground would be empty");
        return Err(error.advise("name the run of every block"));
    }
    let files: Vec<PathBuf> = files.into_iter().flatten().collect();
    let mut warnings = Vec::new();
    let mut scenes = Vec::with_capacity(files.len());
    for file in &files {
        let loaded = load_scene(file)?;
        warnings.extend(loaded.warnings().into_iter().map(|text| format!("{}: {text}", file.display())));
        scenes.push(loaded.scene);
    }
    Ok(BlockRuns { plan, files, scenes, warnings })
}

/// The scene of a run folder, or the file itself.
fn scene_file(run: &Path) -> Result<PathBuf, IoError> {
    if !run.is_dir() {
        return Ok(run.into());
    }
    let folder = RunFolder::new(run);
    if folder.scene().is_file() {
        return Ok(folder.scene());
    }
    let error = IoError::new(run, "has no trained scene (scene.instgs)");
    Err(error.advise("train the block to its end, or name a scene file"))
}

/// Checks that there is a scene per block, and that all were trained for one way of drawing.
pub(super) fn check_alike(plan: &Plan, scenes: &[InstancedScene]) -> Result<(), IoError> {
    let (Some(first), Some(last)) = (plan.blocks.first(), plan.blocks.last()) else {
        return Err(IoError::new(Path::new(PLAN), "has no blocks"));
    };
    if scenes.len() != plan.blocks.len() {
        let what = format!("{} blocks and {} scenes", plan.blocks.len(), scenes.len());
        return Err(IoError::new(Path::new(PLAN), what).advise("give one scene per block"));
    }
    // Clouds without Gaussians have any degree.
    let degrees = |scene: &InstancedScene| {
        let clouds = [&scene.background, &scene.templates, &scene.own];
        clouds.into_iter().filter(|cloud| !cloud.is_empty()).map(|cloud| cloud.sh_degree).collect::<Vec<u32>>()
    };
    let Some(degree) = scenes.iter().flat_map(degrees).next() else { return Ok(()) };
    let drawn_with = |scene: &InstancedScene| (scene.pixel_filter, scene.near_plane);
    let (filter, near) = drawn_with(&scenes[0]);
    let fits =
        |scene: &InstancedScene| drawn_with(scene) == (filter, near) && degrees(scene).iter().all(|&d| d == degree);
    let Some((scene, block)) = scenes.iter().zip(&plan.blocks).find(|(scene, _)| !fits(scene)) else { return Ok(()) };
    let what = format!(
        "has SH degrees {:?}, {:?} and {:?}, where other blocks have {degree}, {filter:?} and {near:?}",
        degrees(scene),
        scene.pixel_filter,
        scene.near_plane
    );
    let advice = format!("train all blocks, {} to {}, with one configuration", first.name, last.name);
    Err(IoError::new(Path::new(&block.name), what).advise(advice))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell::Cell;
    use crate::plan::on_level_ground;
    use instgs_io::write_scene_file;
    use instgs_vk::scene::Gaussians;

    fn plan(folder: &Path) -> Result<Plan, IoError> {
        let plan = on_level_ground(Cell::default().cut(0, 0.0), [0.5; 2]);
        plan.write(folder)?;
        Ok(plan)
    }

    fn one(degree: u32) -> InstancedScene {
        let mut cloud = Gaussians::with_capacity(degree, 1);
        cloud.means.push([0.5; 3]);
        cloud.quats.push([1.0, 0.0, 0.0, 0.0]);
        cloud.log_scales.push([0.0; 3]);
        cloud.opacity_logits.push(0.0);
        cloud.sh.resize(cloud.sh_coefficients(), [0.0; 3]);
        InstancedScene::from_cloud(cloud)
    }

    #[test]
    fn every_block_has_one_run_of_the_same_split() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        plan(folder.path())?;
        let block = |number: usize| folder.path().join(format!("block_0{number}"));
        let text = |runs: &[PathBuf]| read_runs(runs).err().map(|e| e.to_string()).unwrap_or_default();
        std::fs::create_dir_all(block(0).join("run"))?;
        std::fs::create_dir_all(block(1))?;
        assert!(text(&[block(0).join("run")]).contains("has no trained scene"));
        write_scene_file(&RunFolder::new(block(0).join("run")).scene(), &one(1))?;
        assert!(text(&[block(0).join("run")]).contains("no run of this block"));
        let file = block(1).join("mine.instgs");
        write_scene_file(&file, &one(1))?;
        // In any order; a folder and a file.
        let read = read_runs(&[file.clone(), block(0).join("run")])?;
        assert_eq!((read.scenes.len(), read.files[1].clone()), (2, std::path::absolute(&file)?));
        check_alike(&read.plan, &read.scenes)?;
        assert!(text(&[file.clone(), file.clone()]).contains("is of block_01, and so is"));
        let stray = folder.path().join("other/x.instgs");
        assert!(text(&[stray]).contains("no block of"));
        let error = check_alike(&read.plan, &[one(1), one(2)]).err().map(|e| e.to_string()).unwrap_or_default();
        assert!(error.starts_with("block_01: has SH degrees [2]"), "{error}");
        Ok(())
    }

    #[test]
    #[cfg(unix)]
    fn runs_of_one_split_may_be_named_in_several_ways() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let blocks = folder.path().join("blocks");
        for block in ["block_00", "block_01"] {
            std::fs::create_dir_all(blocks.join(block))?;
            write_scene_file(&blocks.join(block).join("x.instgs"), &one(0))?;
        }
        plan(&blocks)?;
        std::os::unix::fs::symlink(&blocks, folder.path().join("link"))?;
        // A run of which only a link is in the block's folder, too.
        let elsewhere = RunFolder::new(folder.path().join("disk"));
        elsewhere.create()?;
        write_scene_file(&elsewhere.scene(), &one(0))?;
        std::os::unix::fs::symlink(elsewhere.path(), blocks.join("block_01/run"))?;
        let path = |name: &str| folder.path().join(name);
        for second in ["blocks/block_01/x.instgs", "link/block_01/x.instgs", "blocks/block_00/../block_01/x.instgs"]
            .into_iter()
            .chain(["link/../blocks/block_01/run", "link/block_01/run"])
        {
            let read = read_runs(&[path("blocks/block_00/x.instgs"), path(second)])?;
            assert_eq!((read.scenes.len(), read.files[1].starts_with(path(second))), (2, true), "{second}");
        }
        Ok(())
    }
}
