//! The plan of a division: `blocks.json`, beside the blocks' folders.

use std::path::{Path, PathBuf};

use instgs_io::IoError;
use instgs_io::json::{read_json, write_json};
use serde::{Deserialize, Serialize};

use crate::cell::{Cell, Ground};
use crate::links::{relative_text, without_dots};

/// Name of the plan's file.
pub const PLAN: &str = "blocks.json";
/// The version of the file that this program writes and reads.
const FORMAT: &str = "instgs-blocks/1";

/// How a data set is divided.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    /// Version of the file.
    format: String,
    /// Folder of the whole data set, absolute. The file has it relative to the plan's folder, so that both can be moved together.
    pub data: PathBuf,
    /// The ground that cells lie on.
    pub ground: Ground,
    /// The blocks; together their cells are all of the ground.
    pub blocks: Vec<Block>,
}

/// One block of a plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Block {
    /// Name of the block's folder, beside the plan.
    pub name: String,
    /// The part of the ground that the block owns.
    pub cell: Cell,
    /// How far the block's own points reach beyond its cell, by axis, scene units.
    pub margin: [f64; 2],
    /// Number of its training views.
    pub train_views: usize,
    /// Number of its test views.
    pub test_views: usize,
    /// Number of its points within cell and margin.
    pub points: usize,
    /// Number of its points farther away.
    pub far_points: usize,
}

impl Plan {
    /// A plan of this version.
    pub(crate) fn new(data: PathBuf, ground: Ground, blocks: Vec<Block>) -> Self {
        Self { format: FORMAT.into(), data, ground, blocks }
    }

    /// Reads the plan in a folder. Older plans have absolute paths, which are taken as they are.
    ///
    /// # Errors
    /// It is missing, damaged, or of another version.
    pub fn read(folder: &Path) -> Result<Self, IoError> {
        let path = folder.join(PLAN);
        let mut plan: Self = read_json(&path)?;
        if plan.format != FORMAT {
            let what = format!("is of version \"{}\", and this program reads {FORMAT}", plan.format);
            return Err(IoError::new(&path, what).advise("split the data set again with this program"));
        }
        if plan.blocks.is_empty() {
            return Err(IoError::new(&path, "has no blocks").advise("split the data set again"));
        }
        if plan.data.is_relative() {
            let named = without_dots(&real(folder).join(&plan.data));
            plan.data = real(&named);
        }
        Ok(plan)
    }

    /// Writes the plan into a folder.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn write(&self, folder: &Path) -> Result<(), IoError> {
        let data = relative_text(&real(folder), &self.data).into();
        write_json(&folder.join(PLAN), &Self { data, ..self.clone() })
    }

    /// Index of the block that owns a point of the ground.
    pub fn owner(&self, at: [f64; 2]) -> Option<usize> {
        self.blocks.iter().position(|block| block.cell.owns(at))
    }
}

/// A folder without links or dots; if it is missing, its path as it stands.
fn real(folder: &Path) -> PathBuf {
    std::fs::canonicalize(folder).unwrap_or_else(|_| folder.into())
}

/// The folder with the plan above a run or a scene that lies in a block's folder, and the block's name. The folder is without
/// links or dots; the run itself may be a link to elsewhere.
///
/// # Errors
/// No folder above has a plan.
pub fn block_of(run: &Path) -> Result<(PathBuf, String), IoError> {
    let full = std::path::absolute(run).map_err(|e| IoError::os(run, "cannot find", &e))?;
    let mut below: Option<&Path> = None;
    for folder in full.ancestors() {
        if let Some(name) = below.and_then(Path::file_name)
            && folder.join(PLAN).is_file()
        {
            // Runs of one split may be named in several ways; they are compared by this folder.
            return Ok((real(folder), name.to_string_lossy().into_owned()));
        }
        below = Some(folder);
    }
    let error = IoError::new(run, format!("no folder above it has a {PLAN}, so its block is not known"));
    Err(error.advise("put the run or the scene into the folder of its block, as split made it"))
}

/// A plan for tests, of blocks on level ground in the plane z = 0.
#[cfg(test)]
pub(crate) fn on_level_ground(cells: impl IntoIterator<Item = Cell>, margin: [f64; 2]) -> Plan {
    let ground = Ground { axes: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], up: [0.0, 0.0, 1.0] };
    let block = |(number, cell): (usize, Cell)| Block {
        name: format!("block_0{number}"),
        cell,
        margin,
        train_views: 2,
        test_views: 0,
        points: 1,
        far_points: 0,
    };
    Plan::new("/data".into(), ground, cells.into_iter().enumerate().map(block).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_knows_its_block_and_a_plan_its_version() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let run = folder.path().join("block_01/deep/run");
        std::fs::create_dir_all(&run)?;
        assert!(block_of(&run).is_err_and(|e| e.to_string().contains(PLAN)));
        let ground = Ground { axes: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], up: [0.0, 0.0, 1.0] };
        let cells = Cell::default().cut(1, 0.5);
        let block = |cell| Block {
            name: "b".into(),
            cell,
            margin: [0.1, 0.2],
            train_views: 3,
            test_views: 1,
            points: 9,
            far_points: 2,
        };
        let mut plan = Plan::new("/data".into(), ground, cells.map(block).to_vec());
        plan.write(folder.path())?;
        let text = std::fs::read_to_string(folder.path().join(PLAN))?;
        assert!(text.contains("\"../") && !text.contains("\"/data\""), "{text}");
        assert_eq!(Plan::read(folder.path())?, plan);
        // As it was written before.
        write_json(&folder.path().join(PLAN), &plan)?;
        assert_eq!(Plan::read(folder.path())?, plan);
        assert_eq!(plan.owner([3.0, 0.4]), Some(0));
        assert_eq!(block_of(&run)?, (std::fs::canonicalize(folder.path())?, "block_01".to_owned()));
        plan.format = "instgs-blocks/9".into();
        plan.write(folder.path())?;
        assert!(Plan::read(folder.path()).is_err_and(|e| e.to_string().contains("instgs-blocks/9")));
        Ok(())
    }
}
