//! Writes the data sets of blocks.

use std::path::{Path, PathBuf};

use instgs_io::nerf_write::Frame;
use instgs_io::point_cloud::advice_without_points;
use instgs_io::{Dataset, IoError, MaskFolder, read_points, read_views, run_folder, write_frames, write_points};
use instgs_vk::scene::PointCloud;

use crate::divide::{DivideOptions, Division, divide};
use crate::links::{DataFolder, link_folder, relative_path, relative_text};
use crate::plan::{PLAN, Plan};

/// Name of a block's points, which its `transforms.json` names.
const POINTS: &str = "points3d.ply";

/// A plan whose blocks have been written.
pub struct Written {
    /// The plan.
    pub plan: Plan,
    /// Folder of the plan, absolute.
    pub folder: PathBuf,
    /// What the reader of the data set has to say, and which views no block has enough of; one line each.
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
    if loaded.dropped_non_finite > 0 {
        let (path, count) = (loaded.path.display(), loaded.dropped_non_finite);
        notes.push(format!("{path}: dropped {count} points that are not finite"));
    }
    notes.extend(loaded.notes);
    let data = DataFolder::new(data)?;
    let division = divide(&data.real, &dataset, &loaded.points, options)?;
    notes.extend_from_slice(&division.notes);
    if out.join(PLAN).exists() && Plan::read(out)? != division.plan {
        let error = IoError::new(out, "holds blocks of another data set, or divided in another way");
        return Err(error.advise("choose another folder"));
    }
    run_folder::create(out)?;
    let folder = std::fs::canonicalize(out).map_err(|e| IoError::os(out, "cannot find", &e))?;
    for number in 0..division.plan.blocks.len() {
        write_block(&folder, &data, number, &division, &dataset, &loaded.points)?;
    }
    division.plan.write(&folder)?;
    Ok(Written { plan: division.plan, folder, notes })
}

fn write_block(
    folder: &Path,
    data: &DataFolder<'_>,
    number: usize,
    division: &Division,
    dataset: &Dataset,
    points: &PointCloud,
) -> Result<(), IoError> {
    let own = folder.join(&division.plan.blocks[number].name);
    run_folder::create(&own)?;
    let frame = |&v: &usize| {
        let view = &dataset.views[v];
        let mask = view.mask_path.as_deref().map(|mask| data.path_of(mask)).transpose()?;
        Ok(Frame {
            camera: &view.camera,
            file: relative_text(&own, &data.path_of(&view.image_path)?),
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
    if let Some(masks) = MaskFolder::default_for(&data.real) {
        let link = own.join("masks");
        link_folder(&relative_path(&own, &masks), &link)?;
    }
    write_frames(&own.join("transforms.json"), &frames, Some(POINTS))
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use crate::cell::{Cell, Ground};
    use crate::plan::Block;
    use glam::DVec3;
    use instgs_vk::scene::Camera;

    type Test = Result<(), Box<dyn std::error::Error>>;

    /// A data set of eight views along x, one of the sky, and a point that is no number.
    fn row(data: &Path) -> Test {
        let camera = |i: u32| {
            let eye = DVec3::new(f64::from(i), 0.0, 2.0);
            let target = eye + DVec3::new(0.0, 0.5, if i == 8 { 1.0 } else { -1.0 });
            Camera::look_at(&format!("{i}"), eye, target, DVec3::Z, 0.9, (32, 32))
        };
        let cameras: Vec<Camera> = (0..9).map(camera).collect();
        let frame = |camera| Frame {
            camera,
            file: format!("images/{}.png", camera.name),
            distortion: None,
            mask: None,
            split: Some(instgs_io::Split::Train),
        };
        let mut cloud = PointCloud::default();
        for i in 0..400u16 {
            cloud.positions.push([f32::from(i % 100) * 0.08, f32::from(i / 100), 0.0]);
            cloud.colors.push([9; 3]);
        }
        cloud.positions[7][1] = f32::NAN;
        write_points(&data.join(POINTS), &cloud)?;
        let frames: Vec<Frame<'_>> = cameras.iter().map(frame).collect();
        Ok(write_frames(&data.join("transforms.json"), &frames, Some(POINTS))?)
    }

    #[test]
    fn what_is_left_out_is_noted_and_the_folders_can_be_moved_together() -> Test {
        let folder = tempfile::tempdir()?;
        let (before, after) = (folder.path().join("before"), folder.path().join("after"));
        std::fs::create_dir_all(before.join("data"))?;
        row(&before.join("data"))?;
        let options = DivideOptions::default();
        let written = split(&before.join("data"), &before.join("blocks"), &options)?;
        let all = written.notes.join("\n");
        assert!(all.contains("dropped 1 points that are not finite") && all.contains("views (8): none"), "{all}");
        // The same data set, wherever both are: splitting again is no other division.
        std::fs::rename(&before, &after)?;
        assert_eq!(Plan::read(&after.join("blocks"))?.data, std::fs::canonicalize(after.join("data"))?);
        let again = split(&after.join("data"), &after.join("blocks"), &options)?;
        assert_eq!(again.plan.blocks, written.plan.blocks);
        Ok(())
    }

    /// Photos of two cameras, whose folders are links: views are named by the links, as their masks are.
    #[test]
    fn views_of_a_block_have_the_names_that_they_have_in_the_whole() -> Test {
        let folder = tempfile::tempdir()?;
        let (data, blocks) = (folder.path().join("data"), folder.path().join("blocks"));
        std::fs::create_dir_all(data.join("images"))?;
        for (camera, link) in [("a", "left"), ("b", "right")] {
            let photos = folder.path().join("disk").join(camera);
            std::fs::create_dir_all(&photos)?;
            std::os::unix::fs::symlink(photos, data.join("images").join(link))?;
        }
        let frame = |link: &str| {
            let pose = "[[1,0,0,1],[0,1,0,2],[0,0,1,3],[0,0,0,1]]";
            format!(r#"{{"file_path":"images/{link}/1.png","transform_matrix":{pose}}}"#)
        };
        let text = format!(r#"{{"w":2,"h":2,"fl_x":1,"frames":[{},{}]}}"#, frame("left"), frame("right"));
        std::fs::write(data.join("transforms.json"), text)?;
        let dataset = read_views(&data)?;
        let block = Block {
            name: "block_00".into(),
            cell: Cell::default(),
            margin: [0.0; 2],
            train_views: 2,
            test_views: 0,
            points: 0,
            far_points: 0,
        };
        let ground = Ground { axes: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], up: [0.0, 0.0, 1.0] };
        let plan = Plan::new(data.clone(), ground, vec![block]);
        let division = Division { plan, views: vec![vec![0, 1]], points: vec![vec![]], notes: vec![] };
        run_folder::create(&blocks)?;
        let blocks = std::fs::canonicalize(&blocks)?;
        write_block(&blocks, &DataFolder::new(&data)?, 0, &division, &dataset, &PointCloud::default())?;
        let names = |dataset: &Dataset| dataset.views.iter().map(|v| v.camera.name.clone()).collect::<Vec<_>>();
        assert_eq!(names(&dataset), ["left_1", "right_1"]);
        assert_eq!(names(&read_views(&blocks.join("block_00"))?), names(&dataset));
        Ok(())
    }
}
