//! Writes the data sets of blocks.

use std::path::{Path, PathBuf};

use instgs_io::nerf_write::Frame;
use instgs_io::point_cloud::advice_without_points;
use instgs_io::{Dataset, IoError, MaskFolder, read_points, read_views, run_folder, write_frames, write_points};
use instgs_vk::scene::PointCloud;

use crate::divide::{DivideOptions, Division, divide};
use crate::links::{link_folder, real_path, relative_path, relative_text};
use crate::plan::{PLAN, Plan};

/// Name of a block's points, which its `transforms.json` names.
const POINTS: &str = "points3d.ply";

/// A plan whose blocks have been written.
pub struct Written {
    /// The plan.
    pub plan: Plan,
    /// Folder of the plan, absolute.
    pub folder: PathBuf,
    /// What the reader of the data set has to say, one line each.
    pub notes: Vec<String>,
}

/// Divides the data set in `data` and writes a folder per block into `out`, with the plan beside them. A block has a
/// `transforms.json` that refers to the photos of the whole data set, its points, and a link to the data set's masks. The plan is
/// written last.
///
/// # Errors
/// The data set is damaged, cannot be divided so, or `out` holds another plan.
pub fn split(data: &Path, out: &Path, options: &DivideOptions) -> Result<Written, IoError> {
    let dataset = read_views(data)?;
    let mut notes = dataset.notes.clone();
    let Some(loaded) = read_points(data)? else {
        let error = IoError::new(data, "has no point cloud, by which it could be divided");
        return Err(error.advise(advice_without_points(data)));
    };
    notes.extend(loaded.notes);
    let real_data = std::fs::canonicalize(data).map_err(|e| IoError::os(data, "cannot find", &e))?;
    let division = divide(&real_data, &dataset, &loaded.points, options)?;
    if out.join(PLAN).exists() && Plan::read(out)? != division.plan {
        let error = IoError::new(out, "holds blocks of another data set, or divided in another way");
        return Err(error.advise("choose another folder"));
    }
    run_folder::create(out)?;
    let folder = std::fs::canonicalize(out).map_err(|e| IoError::os(out, "cannot find", &e))?;
    for number in 0..division.plan.blocks.len() {
        write_block(&folder, &real_data, number, &division, &dataset, &loaded.points)?;
    }
    division.plan.write(&folder)?;
    Ok(Written { plan: division.plan, folder, notes })
}

fn write_block(
    folder: &Path,
    data: &Path,
    number: usize,
    division: &Division,
    dataset: &Dataset,
    points: &PointCloud,
) -> Result<(), IoError> {
    let own = folder.join(&division.plan.blocks[number].name);
    run_folder::create(&own)?;
    let frame = |&v: &usize| {
        let view = &dataset.views[v];
        let mask = view.mask_path.as_deref().map(real_path).transpose()?;
        Ok(Frame {
            camera: &view.camera,
            file: relative_text(&own, &real_path(&view.image_path)?),
            distortion: view.distortion,
            mask: mask.map(|path| relative_text(&own, &path)),
            split: Some(view.split),
        })
    };
    let frames = division.views[number].iter().map(frame).collect::<Result<Vec<_>, IoError>>()?;
    let mut cloud = PointCloud::default();
    for &i in &division.points[number] {
        cloud.positions.push(points.positions[i]);
        cloud.colors.push(points.colors[i]);
    }
    write_points(&own.join(POINTS), &cloud)?;
    if let Some(masks) = MaskFolder::default_for(data) {
        let link = own.join("masks");
        link_folder(&relative_path(&own, &masks), &link)?;
    }
    write_frames(&own.join("transforms.json"), &frames, Some(POINTS))
}
