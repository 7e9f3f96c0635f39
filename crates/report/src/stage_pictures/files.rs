//! The pictures as PNG files in `RUN/stages/`, numbered by stage, so that listings are in the order of the stages.

use rayon::prelude::*;

use crate::{Rgb8, StagePictures};
use instgs_io::{IoError, atomic_write};
use instgs_objects::pipeline::PipelineJob;

/// Writes all pictures; files of the same name are replaced.
pub(super) fn write(job: &PipelineJob, pictures: &StagePictures) -> Result<(), IoError> {
    let folder = job.folder().stage_pictures();
    instgs_io::run_folder::create(&folder)?;
    named(pictures).par_iter().try_for_each(|(name, picture)| {
        let path = folder.join(format!("{name}.png"));
        let bytes = picture.png().map_err(|error| IoError::new(&path, error.to_string()))?;
        atomic_write(&path, |out| out.write_all(&bytes))
    })
}

/// All pictures with the names of their files.
fn named(pictures: &StagePictures) -> Vec<(String, &Rgb8)> {
    let mut out = Vec::new();
    for view in &pictures.views {
        let name = &view.name;
        out.extend(view.given.as_ref().map(|picture| (format!("1_masks_{name}"), picture)));
        out.extend(view.objects.as_ref().map(|picture| (format!("2_objects_{name}"), picture)));
        out.push((format!("3_labels_{name}"), &view.labels));
    }
    for tile in pictures.overlays.iter().flat_map(|group| &group.tiles) {
        let id = tile.id;
        out.extend(tile.own.as_ref().map(|picture| (format!("4_pose_{id}_alone"), picture)));
        let sides = ["over", "over_side"].iter().zip(&tile.over);
        out.extend(sides.map(|(side, picture)| (format!("4_pose_{id}_{side}"), picture)));
    }
    for (t, template) in pictures.templates.iter().enumerate() {
        for (state, sides) in [("merged", &template.merged), ("trained", &template.trained)] {
            let names = ["front", "behind"].iter().zip(sides);
            out.extend(names.map(|(side, picture)| (format!("5_template_{t}_{state}_{side}"), picture)));
        }
    }
    out
}
