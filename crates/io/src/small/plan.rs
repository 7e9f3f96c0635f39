//! The rounding of a scene, fixed before it is written, so that the scene can be trained to look right when it is rounded.

use std::path::Path;

use super::coded_tables;
use super::field::Part;
use super::sensitivity::SmallOptions;
use super::source::{Field, Orders, Table, tables};
use super::steps::{self, TableSteps};
use crate::error::IoError;
use crate::scene_file::parse_scene_file;
use crate::scene_write::planned_scene_file_bytes;
use instgs_vk::scene::instanced_scene::{ForeignTensor, InstancedScene};

/// How `--pack small` rounds a scene, and the order of its rows. It holds for scenes with as many rows of everything, whose values can
/// be rounded where those of the plan's could.
#[derive(Debug)]
pub struct SmallPlan {
    orders: Orders,
    steps: Vec<TableSteps>,
}

impl SmallPlan {
    /// The plan of a scene for pictures as close as asked for; `path` is only used in messages.
    ///
    /// # Errors
    /// The sensitivity is of another scene, or its views show nothing of this one.
    pub fn new(scene: &InstancedScene, options: &SmallOptions<'_>, path: &Path) -> Result<Self, IoError> {
        if !options.sensitivity.fits(scene) {
            return Err(IoError::new(path, "cannot write: the sensitivity was measured on another scene"));
        }
        if !options.sensitivity.shows_anything() {
            let what = "cannot write: the views that say how precise it is to be show nothing of the scene";
            return Err(IoError::new(path, what).advise("give the data set of the scene"));
        }
        let orders = Orders::of(scene);
        let tables = tables(scene, &orders, Some(options.sensitivity));
        let steps = steps::plan(&tables, Some(options.picture_psnr_db));
        let steps: Vec<TableSteps> =
            steps.into_iter().zip(&tables).map(|(steps, table)| steps.fixed_for(table)).collect();
        Ok(Self { orders, steps })
    }

    /// The tensors of a scene by name; `path` is only used in messages.
    ///
    /// # Errors
    /// The scene has other numbers of rows than the plan's, or values that are not finite in a field that was finite.
    pub(crate) fn tensors(&self, scene: &InstancedScene, path: &Path) -> Result<Vec<(String, ForeignTensor)>, IoError> {
        let orders = [(&self.orders.own, &scene.own), (&self.orders.background, &scene.background)];
        let has_rows =
            orders.iter().all(|(order, cloud)| order.as_ref().is_none_or(|order| order.len() == cloud.len()));
        let tables = if has_rows { tables(scene, &self.orders, None) } else { Vec::new() };
        let fits = |(table, steps): (&Table, &TableSteps)| {
            let columns = |field: &Field| field.parts.iter().map(|part| part.columns).sum::<usize>();
            let planned = |parts: &Vec<Part>| parts.iter().map(|part| part.columns).sum::<usize>();
            // Shapes that cannot be coded as logarithms of covariances are other fields.
            let same_fields = table.fields.iter().map(columns).eq(steps.parts.iter().map(planned));
            let mut rounds = table.fields.iter().zip(&steps.centres);
            let still_rounds = rounds.all(|(field, centres)| field.can_be_coded || centres.is_empty());
            table.rows == steps.classes.shape.len() && same_fields && still_rounds
        };
        if tables.len() != self.steps.len() || !tables.iter().zip(&self.steps).all(fits) {
            let what =
                "cannot write: the plan is that of another scene, or of this one while all of its values were finite";
            return Err(IoError::new(path, what).advise("make a plan of this one"));
        }
        Ok(coded_tables(&tables, &self.steps))
    }

    /// The scene as its file would have it, but with rows in the order of `scene`. Rotations have the axes that the file gives them:
    /// another choice of a Gaussian's axes may have the same covariance. `path` is only used in messages.
    ///
    /// # Errors
    /// The scene is inconsistent, or the plan is of another.
    pub fn rounded(&self, scene: &InstancedScene, path: &Path) -> Result<InstancedScene, IoError> {
        let mut out = parse_scene_file(&planned_scene_file_bytes(scene, self, path)?, path)?;
        let clouds = [(&mut out.own, &self.orders.own), (&mut out.background, &self.orders.background)];
        for (cloud, order) in clouds {
            if let Some(order) = order {
                cloud.reorder(&inverse(order));
            }
        }
        out.own_ranges.clone_from(&scene.own_ranges);
        Ok(out)
    }
}

/// Where each index stands in an order.
fn inverse(order: &[u32]) -> Vec<u32> {
    let mut out = vec![0; order.len()];
    (0..).zip(order).for_each(|(place, &i)| out[i as usize] = place);
    out
}
