//! Which views belong to which blocks, by the points that they show.

use glam::DVec3;
use instgs_io::View;
use instgs_vk::scene::Camera;
use rayon::prelude::*;

use crate::cell::{Cell, Ground};

/// Most points that views are compared by; of more, every k-th counts.
const SAMPLED: usize = 60_000;
/// Most names of views in a note.
const NAMED: usize = 5;

/// How much of what every view shows lies in each block and its margin.
pub(crate) struct Shares {
    blocks: usize,
    of_view: Vec<Share>,
}

/// The points in the frame of one view.
struct Share {
    /// Number of the sampled points that the view has in its frame.
    shown: usize,
    /// The blocks that have some of them, in ascending order. Margins overlap, so a point may be of several blocks.
    in_blocks: Vec<InBlock>,
}

/// The points in the frame of a view that lie in one block and its margin.
#[derive(Clone, Copy)]
struct InBlock {
    block: usize,
    points: usize,
}

/// A point, and the blocks that have it in their cell or margin.
struct Sample {
    point: DVec3,
    blocks: Vec<usize>,
}

/// The views of every block.
pub(crate) struct Given {
    /// By block, indices of its views, in ascending order.
    pub views: Vec<Vec<usize>>,
    /// Views that no block has enough of, one line each for the user.
    pub notes: Vec<String>,
}

/// True if a point is in the frame of a camera.
pub(crate) fn is_framed(camera: &Camera, point: DVec3) -> bool {
    camera.pixel_of(point).is_some_and(|at| camera.has_pixel(at))
}

impl Shares {
    /// Counts the points in every view's frame by block; `grown` are the blocks' cells with their margins. Only the counts are
    /// kept, so that memory does not grow with views times points.
    pub(crate) fn new(views: &[View], points: &[DVec3], ground: Ground, grown: &[Cell]) -> Self {
        let sample = |&point: &DVec3| {
            let at = ground.flat(point);
            let blocks = (0..grown.len()).filter(|&block| grown[block].owns(at)).collect();
            Sample { point, blocks }
        };
        let every = points.len().div_ceil(SAMPLED).max(1);
        let samples: Vec<Sample> = points.par_iter().step_by(every).map(sample).collect();
        let share = |view: &View| {
            let share = Share::of(view, samples.iter(), grown.len());
            if share.shown > 0 || every == 1 {
                return share;
            }
            // It may show a few of the points that were passed over.
            let framed = points.iter().filter(|&&point| is_framed(&view.camera, point)).map(sample);
            Share::of(view, &framed.collect::<Vec<_>>(), grown.len())
        };
        Self { blocks: grown.len(), of_view: views.par_iter().map(share).collect() }
    }

    /// Gives each view to the blocks with at least the part `least` of its points, or else to the one with most of them. Views
    /// that show no point are of no block.
    pub(crate) fn given(&self, named: &[View], least: f64) -> Given {
        let mut views = vec![Vec::new(); self.blocks];
        let (mut spread, mut empty) = (Vec::new(), Vec::new());
        for (view, share) in self.of_view.iter().enumerate() {
            let is_enough = |of: &&InBlock| of.points as f64 >= least * share.shown as f64;
            let enough: Vec<InBlock> = share.in_blocks.iter().filter(is_enough).copied().collect();
            // The first of several equal ones.
            let most = share.in_blocks.iter().rev().max_by_key(|of| of.points);
            match (enough.as_slice(), most) {
                ([], None) => empty.push(view),
                ([], Some(most)) => {
                    spread.push(view);
                    views[most.block].push(view);
                }
                (enough, _) => enough.iter().for_each(|of| views[of.block].push(view)),
            }
        }
        let all = named.len();
        let names = |some: &[usize]| {
            let shown: Vec<&str> = some.iter().take(NAMED).map(|&view| named[view].camera.name.as_str()).collect();
            let more = if some.len() > NAMED { ", ..." } else { "" };
            format!("{} of {all} views ({}{more})", some.len(), shown.join(", "))
        };
        let mut notes = Vec::new();
        if !spread.is_empty() {
            let percent = 100.0 * least;
            notes.push(format!(
                "{}: no block has {percent:.0} % of the points in the frame (--least-share); each view is in the block with most \
                 of them",
                names(&spread)
            ));
        }
        if !empty.is_empty() {
            notes.push(format!("{}: none of the points is in the frame, so no block has these views", names(&empty)));
        }
        Given { views, notes }
    }
}

impl Share {
    fn of<'a>(view: &View, samples: impl IntoIterator<Item = &'a Sample>, blocks: usize) -> Self {
        let (mut shown, mut counts) = (0, vec![0; blocks]);
        for sample in samples.into_iter().filter(|sample| is_framed(&view.camera, sample.point)) {
            shown += 1;
            sample.blocks.iter().for_each(|&block| counts[block] += 1);
        }
        let in_blocks = counts.into_iter().enumerate().filter(|&(_, points)| points > 0);
        Self { shown, in_blocks: in_blocks.map(|(block, points)| InBlock { block, points }).collect() }
    }
}
