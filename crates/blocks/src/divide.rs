//! Which part of the ground each block owns, and which views and points it is trained on.

use glam::DVec3;
use instgs_io::{Dataset, IoError, Split};
use instgs_vk::math::sh::widened;
use instgs_vk::scene::{Camera, PointCloud, UpAxes};
use rayon::prelude::*;
use std::path::Path;

use crate::cell::{Cell, Ground};
use crate::far::Surroundings;
use crate::plan::{Block, Plan};
use crate::shares::{Shares, is_framed};

/// Part of the points at each end of an axis that do not count for the extent of a block: strays.
const STRAYS: f64 = 0.02;
/// Least number of points that views show per block.
const FEWEST_POINTS: usize = 16;
/// Least number of training views of a block.
const FEWEST_VIEWS: usize = 2;

/// How a data set is to be divided.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DivideOptions {
    /// Number of blocks, 2 or more.
    pub blocks: usize,
    /// Margin on each side of a block, as a part of the block's extent along that axis.
    pub overlap: f64,
    /// A view belongs to a block if at least this part of the points in its frame lie within the block and its margin.
    pub least_share: f64,
}

impl Default for DivideOptions {
    fn default() -> Self {
        Self { blocks: 2, overlap: 0.15, least_share: 0.15 }
    }
}

/// A plan, and what each block gets.
pub struct Division {
    /// What is written beside the blocks, and read again by `join`.
    pub plan: Plan,
    /// By block, indices of its views in the data set.
    pub views: Vec<Vec<usize>>,
    /// By block, indices of its points: first those within cell and margin, then those farther away.
    pub points: Vec<Vec<usize>>,
    /// Views that no block has enough of, one line each for the user.
    pub notes: Vec<String>,
}

/// Divides the views and points of the data set in folder `data`, an absolute path. The ground is cut in two, along the longer
/// extent of the points that training views show, so that the parts have points in proportion to their blocks, and so on. A view
/// that shows enough of no block is given to the one that it shows most, so that only views without a point are left out.
///
/// # Errors
/// There are too few points or views for so many blocks, or no ground: its points lie in no plane that cameras look down on,
/// and these agree on no up axis.
pub fn divide(
    data: &Path,
    dataset: &Dataset,
    points: &PointCloud,
    options: &DivideOptions,
) -> Result<Division, IoError> {
    let world: Vec<DVec3> = points.positions.iter().map(|&p| widened(p)).collect();
    let training: Vec<Camera> = dataset.split(Split::Train).map(|view| view.camera.clone()).collect();
    let shown: Vec<usize> = in_frames(&training, &world);
    if shown.len() < options.blocks * FEWEST_POINTS {
        let what = format!("its training views show {} points, too few for {} blocks", shown.len(), options.blocks);
        return Err(IoError::new(data, what).advise("give a denser point cloud, or fewer blocks"));
    }
    let shown_points: Vec<DVec3> = shown.iter().map(|&i| world[i]).collect();
    // On a flight what the cameras agree on is the north. A facade that is seen straight is divided along and across as well.
    let UpAxes { level, straight } = UpAxes::of(&training, shown.iter().map(|&i| points.positions[i]));
    let up = straight.or(level).ok_or_else(|| {
        IoError::new(data, "its cameras do not agree on what is up, so there is no ground to divide")
            .advise("blocks are for captures whose cameras are about level, or look down on flat ground")
    })?;
    let ground = Ground::of_points(up, &shown_points);
    let mut flat: Vec<[f64; 2]> = shown_points.iter().map(|&p| ground.flat(p)).collect();
    let mut parts = Vec::new();
    bisect(&mut flat, Cell::default(), options.blocks, &mut parts);
    let grown: Vec<Cell> = parts.iter().map(|part| part.cell.grown(part.margin(options.overlap))).collect();
    let given = Shares::new(&dataset.views, &shown_points, ground, &grown).given(&dataset.views, options.least_share);
    let plan = Plan::new(data.into(), ground, Vec::new());
    let mut division = Division { plan, views: vec![], points: vec![], notes: given.notes };
    let digits = (parts.len() - 1).to_string().len().max(2);
    for (number, ((part, grown), views)) in parts.iter().zip(&grown).zip(given.views).enumerate() {
        let margin = part.margin(options.overlap);
        let train_views = views.iter().filter(|&&v| dataset.views[v].split == Split::Train).count();
        if train_views < FEWEST_VIEWS {
            let what = format!("block {number} of {} would have {train_views} training views", options.blocks);
            return Err(IoError::new(data, what).advise("give fewer blocks, or a lower --least-share"));
        }
        let (near, far): (Vec<usize>, Vec<usize>) = (0..world.len()).partition(|&i| grown.owns(ground.flat(world[i])));
        let cameras: Vec<&Camera> = views.iter().map(|&v| &dataset.views[v].camera).collect();
        let low = [0, 1].map(|axis: usize| part.low[axis] - margin[axis]);
        let high = [0, 1].map(|axis: usize| part.high[axis] + margin[axis]);
        let around = Surroundings::new(ground, low, high);
        let in_view = |&i: &usize| cameras.iter().any(|camera| is_framed(camera, world[i]));
        let far = around.thinned(&world, far.into_iter().filter(in_view));
        division.plan.blocks.push(Block {
            name: format!("block_{number:0digits$}"),
            cell: part.cell,
            margin,
            train_views,
            test_views: views.len() - train_views,
            points: near.len(),
            far_points: far.len(),
        });
        division.views.push(views);
        division.points.push([near, far].concat());
    }
    Ok(division)
}

/// A part of the ground, and where its points lie without strays.
struct Part {
    cell: Cell,
    low: [f64; 2],
    high: [f64; 2],
}

impl Part {
    /// The margin on each side, by axis, scene units; `overlap` as in [`DivideOptions`].
    fn margin(&self, overlap: f64) -> [f64; 2] {
        [0, 1].map(|axis: usize| overlap * (self.high[axis] - self.low[axis]))
    }
}

/// Cuts a cell into `count` parts by the points in it.
fn bisect(flat: &mut [[f64; 2]], cell: Cell, count: usize, out: &mut Vec<Part>) {
    let ranges = [0, 1].map(|axis: usize| extent(flat, axis));
    if count == 1 {
        out.push(Part { cell, low: ranges.map(|r| r[0]), high: ranges.map(|r| r[1]) });
        return;
    }
    let length = ranges.map(|[low, high]| high - low);
    let axis = usize::from(length[1] > length[0]);
    flat.sort_by(|a, b| a[axis].total_cmp(&b[axis]));
    let below = count / 2;
    let middle = flat.len() * below / count;
    let at = 0.5 * (flat[middle.saturating_sub(1)][axis] + flat[middle][axis]);
    let [low_cell, high_cell] = cell.cut(axis, at);
    let (low_part, high_part) = flat.split_at_mut(middle);
    bisect(low_part, low_cell, below, out);
    bisect(high_part, high_cell, count - below, out);
}

/// Least and largest coordinate along an axis without strays.
fn extent(flat: &[[f64; 2]], axis: usize) -> [f64; 2] {
    let mut values: Vec<f64> = flat.iter().map(|p| p[axis]).collect();
    values.sort_by(f64::total_cmp);
    let stray = (STRAYS * values.len() as f64) as usize;
    [values[stray], values[values.len() - 1 - stray]]
}

/// Indices of the points in the frame of at least one camera.
fn in_frames(cameras: &[Camera], points: &[DVec3]) -> Vec<usize> {
    let seen = |&i: &usize| cameras.iter().any(|camera| is_framed(camera, points[i]));
    (0..points.len()).into_par_iter().filter(seen).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use instgs_io::View;

    /// A street along x, 40 by 4, seen straight down by a camera every two metres.
    fn street() -> (Dataset, PointCloud) {
        let view = |i: u32| {
            let eye = DVec3::new(2.0 * f64::from(i), 0.0, 6.0);
            let target = eye + DVec3::new(0.0, 2.0, -6.0);
            View {
                camera: Camera::look_at(&format!("{i:02}"), eye, target, DVec3::Z, 0.9, (64, 64)),
                image_path: format!("{i:02}.png").into(),
                split: if i.is_multiple_of(4) { Split::Test } else { Split::Train },
                distortion: None,
                mask_path: None,
            }
        };
        let mut cloud = PointCloud::default();
        for i in 0..400u16 {
            for j in 0..4u16 {
                cloud.positions.push([0.1 * f32::from(i), f32::from(j), 0.0]);
                cloud.colors.push([9; 3]);
            }
        }
        (Dataset { views: (0..21).map(view).collect(), notes: Vec::new() }, cloud)
    }

    #[test]
    fn a_street_is_cut_across_into_parts_of_equal_points() -> Result<(), Box<dyn std::error::Error>> {
        let (dataset, cloud) = street();
        let options = DivideOptions { blocks: 3, ..DivideOptions::default() };
        let division = divide(Path::new("/street"), &dataset, &cloud, &options)?;
        let blocks = &division.plan.blocks;
        assert_eq!(blocks.iter().map(|b| b.name.as_str()).collect::<Vec<_>>(), ["block_00", "block_01", "block_02"]);
        let ground = division.plan.ground;
        let mut owned = [0usize; 3];
        for position in &cloud.positions {
            owned[division.plan.owner(ground.flat(widened(*position))).ok_or("no owner")?] += 1;
        }
        assert!(owned.iter().all(|&n| (480..=590).contains(&n)), "{owned:?}");
        // The cut is across the street: the first axis is the street's, and the second is not bounded.
        assert!(ground.axes[0][0].abs() > 0.999 && blocks.iter().all(|b| b.cell.low[1].is_none()));
        for (b, views) in division.views.iter().enumerate() {
            let own = &blocks[b];
            assert_eq!(views.len(), own.train_views + own.test_views);
            assert!(views.len() >= 7 && views.len() < 15, "{b}: {}", views.len());
            // Whoever stands in the middle of the block sees it.
            let near = division.points[b][..own.points].iter().map(|&i| f64::from(cloud.positions[i][0]));
            let middle = near.sum::<f64>() / own.points as f64;
            let nearest = (middle / 2.0).round() as usize;
            assert!(views.contains(&nearest), "{b}: {nearest} of {views:?}");
            assert!(own.points > 530 && own.far_points > 0 && own.far_points < 530, "{own:?}");
        }
        // Every view belongs to a block.
        assert!((0..21).all(|v| division.views.iter().any(|views| views.contains(&v))));
        assert_eq!(division.notes, Vec::<String>::new());
        Ok(())
    }

    /// On a flight there and back that looks straight down, the upper edges of pictures agree on nothing, but the ground is flat.
    #[test]
    fn a_flight_over_a_field_is_divided_along_and_across() -> Result<(), Box<dyn std::error::Error>> {
        let (_, mut cloud) = street();
        cloud.positions.iter_mut().for_each(|p| p[1] *= 8.0);
        let view = |i: u32| {
            let eye = DVec3::new(f64::from(i % 10) * 4.0, f64::from(i / 10) * 5.0, 6.0);
            let up = if (i / 10).is_multiple_of(2) { DVec3::X } else { DVec3::NEG_X };
            View {
                camera: Camera::look_at(&format!("{i:02}"), eye, eye + DVec3::NEG_Z, up, 0.9, (64, 64)),
                image_path: format!("{i:02}.png").into(),
                split: Split::Train,
                distortion: None,
                mask_path: None,
            }
        };
        let dataset = Dataset { views: (0..60).map(view).collect(), notes: Vec::new() };
        let options = DivideOptions { blocks: 4, ..DivideOptions::default() };
        let division = divide(Path::new("/field"), &dataset, &cloud, &options)?;
        assert!(division.plan.ground.up[2] > 0.999, "{:?}", division.plan.ground);
        let is_cut = |axis: usize| division.plan.blocks.iter().any(|b| b.cell.low[axis].is_some());
        assert!(is_cut(0) && is_cut(1));
        Ok(())
    }

    /// Of a square in 16 blocks an overview shows a sixteenth in each, less than is enough: one block has it nevertheless. A view
    /// of the sky is of no block, and its name is said.
    #[test]
    fn no_view_is_left_out_silently() -> Result<(), Box<dyn std::error::Error>> {
        let view = |name: String, eye: DVec3, down: f64| View {
            camera: Camera::look_at(&name, eye, eye + DVec3::new(0.0, 0.3, -down), DVec3::Z, 0.9, (64, 64)),
            image_path: format!("{name}.png").into(),
            split: Split::Train,
            distortion: None,
            mask_path: None,
        };
        let low = (0..256u32).map(|i| {
            let eye = DVec3::new(f64::from(i % 16) + 0.5, f64::from(i / 16) + 0.5, 2.0);
            view(format!("low_{i:03}"), eye, 1.0)
        });
        let high =
            (0..20u32).map(|i| view(format!("high_{i:02}"), DVec3::new(7.9 + 0.01 * f64::from(i), 1.5, 22.0), 1.0));
        let sky = view("sky".into(), DVec3::new(8.0, 8.0, 2.0), -1.0);
        let views: Vec<View> = low.chain(high).chain([sky]).collect();
        let mut cloud = PointCloud::default();
        for i in 0..6400u16 {
            cloud.positions.push([f32::from(i % 80) * 0.2 + 0.1, f32::from(i / 80) * 0.2 + 0.1, 0.0]);
            cloud.colors.push([9; 3]);
        }
        let dataset = Dataset { views, notes: Vec::new() };
        let options = DivideOptions { blocks: 16, ..DivideOptions::default() };
        let division = divide(Path::new("/square"), &dataset, &cloud, &options)?;
        let blocks_of = |v: usize| division.views.iter().filter(|views| views.contains(&v)).count();
        assert!((0..256).all(|v| blocks_of(v) >= 1));
        assert_eq!((256..276).map(blocks_of).collect::<Vec<_>>(), [1; 20]);
        assert_eq!(blocks_of(276), 0);
        let [spread, empty] = division.notes.as_slice() else { return Err(format!("{:?}", division.notes).into()) };
        assert!(
            spread.starts_with("20 of 277 views (high_00, high_01, high_02, high_03, high_04, ...): no block has 15 %")
        );
        assert!(empty.starts_with("1 of 277 views (sky): none of the points is in the frame"), "{empty}");
        // The counts of the plan are with them.
        let counted: usize = division.plan.blocks.iter().map(|block| block.train_views).sum();
        assert_eq!(counted, division.views.iter().map(Vec::len).sum::<usize>());
        Ok(())
    }

    #[test]
    fn too_many_blocks_are_refused() {
        let (dataset, cloud) = street();
        let text = |blocks| {
            let options = DivideOptions { blocks, ..DivideOptions::default() };
            divide(Path::new("/street"), &dataset, &cloud, &options).err().map(|e| e.to_string()).unwrap_or_default()
        };
        assert!(text(400).contains("too few for 400 blocks"), "{}", text(400));
        let few = Dataset { views: dataset.views[..2].to_vec(), notes: Vec::new() };
        let options = DivideOptions { blocks: 2, ..DivideOptions::default() };
        let error = divide(Path::new("/street"), &few, &cloud, &options).err().map(|e| e.to_string());
        assert!(error.is_some_and(|text| text.contains("training views")));
    }
}
