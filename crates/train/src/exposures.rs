//! The exposures of the training photos through a run: where they start, in checkpoints, and the file that is left.

use std::path::Path;
use std::sync::Arc;

use instgs_io::checkpoint::Checkpoint;
use instgs_io::{IoError, PhotoExposure, RunFolder, View, read_exposures, write_exposures};
use instgs_vk::gpu::Gpu;
use instgs_vk::gpu::staging::{download, write};
use instgs_vk::optim::{Exposures, NO_EXPOSURE};

use super::config::TrainConfig;
use super::error::TrainError;
use super::step_runner::StepRunner;

/// Tensors of a checkpoint: rows of the exposures and their moments, by photo.
const TENSORS: [&str; 2] = ["exposure.photo_from_scene", "moment.exposure"];

/// What the exposures of a run begin with.
#[derive(Debug, Default)]
pub(super) enum FirstExposures {
    /// Photos are as the scene is.
    #[default]
    Unchanged,
    /// Those of an earlier phase, by name.
    Named(Vec<PhotoExposure>),
    /// The tensors of a checkpoint: [`TENSORS`].
    Saved([Vec<f32>; 2]),
}

impl FirstExposures {
    /// Takes those of a checkpoint out of it, one for each of `photos`; `path` is for messages. If the data set changed, `places`
    /// has for each photo its index in the checkpoint, and photos without one start unchanged.
    ///
    /// # Errors
    /// A tensor is damaged, or of another number of photos.
    pub(super) fn take(
        checkpoint: &mut Checkpoint,
        photos: usize,
        places: Option<&[Option<usize>]>,
        path: &Path,
    ) -> Result<Self, IoError> {
        if !checkpoint.tensors.contains_key(TENSORS[0]) {
            return Ok(Self::Unchanged);
        }
        let [rows, moments] = TENSORS;
        let saved: [Vec<f32>; 2] = [checkpoint.take(rows, &[12], path)?, checkpoint.take(moments, &[24], path)?];
        if let Some(places) = places {
            return Ok(Self::Saved(replaced(&saved, places)));
        }
        if [saved[0].len() / 12, saved[1].len() / 24] != [photos; 2] {
            let what = format!("has exposures of {} photos, but the data set has {photos}", saved[0].len() / 12);
            return Err(
                IoError::new(path, what).advise("restore the photos that it was trained with, or start a new run")
            );
        }
        Ok(Self::Saved(saved))
    }

    /// Those that the plain cloud of a run ended with, if it learned any.
    pub(super) fn of_plain_cloud(folder: &RunFolder) -> Result<Self, IoError> {
        let path = folder.plain_cloud_run().exposures();
        if path.is_file() { Ok(Self::Named(read_exposures(&path)?)) } else { Ok(Self::Unchanged) }
    }

    /// The exposures on the device, `None` if the configuration has none.
    ///
    /// # Errors
    /// The device's memory is full.
    pub(super) fn upload(
        self,
        gpu: &Arc<Gpu>,
        config: &TrainConfig,
        runner: &StepRunner,
        photos: &[View],
        largest_px: [u32; 2],
    ) -> Result<Option<Exposures>, TrainError> {
        if config.exposure.rate == 0.0 {
            return Ok(None);
        }
        let frame = runner.frame();
        let mut out = Exposures::new(gpu, frame.pipeline_cache(), frame.variant(), photos.len(), largest_px)?;
        match self {
            Self::Unchanged => {}
            Self::Named(named) => {
                let of = |view: &View| named.iter().find(|exposure| exposure.view == view.camera.name);
                let exposures: Vec<_> =
                    photos.iter().map(|view| of(view).map_or(NO_EXPOSURE, |found| found.photo_from_scene)).collect();
                out.set(gpu, &exposures)?;
            }
            Self::Saved(tensors) => {
                for ((buffer, _), values) in out.state().into_iter().zip(&tensors) {
                    write(gpu, buffer, values)?;
                }
            }
        }
        Ok(Some(out))
    }
}

/// Rows of exposures and their moments in another order of photos; those of no photo before are as at the start.
fn replaced([rows, moments]: &[Vec<f32>; 2], places: &[Option<usize>]) -> [Vec<f32>; 2] {
    let unchanged = NO_EXPOSURE.as_flattened();
    let row = |place: &Option<usize>| place.and_then(|k| rows.get(12 * k..12 * k + 12)).unwrap_or(unchanged).to_vec();
    let moment =
        |place: &Option<usize>| place.and_then(|k| moments.get(24 * k..24 * k + 24)).unwrap_or(&[0.0; 24]).to_vec();
    [places.iter().flat_map(row).collect(), places.iter().flat_map(moment).collect()]
}

/// Puts exposures into a checkpoint. The device must be idle.
pub(super) fn put(gpu: &Arc<Gpu>, exposures: &mut Exposures, checkpoint: &mut Checkpoint) -> Result<(), TrainError> {
    let photos = exposures.views();
    for ((buffer, each), name) in exposures.state().into_iter().zip(TENSORS) {
        checkpoint.put(name, &[photos, each], download(gpu, buffer, each * photos)?);
    }
    Ok(())
}

/// Writes the exposures of the photos to the run folder. The device must be idle.
pub(super) fn save(
    gpu: &Arc<Gpu>,
    exposures: &Exposures,
    photos: &[View],
    folder: &RunFolder,
) -> Result<(), TrainError> {
    let rows = exposures.download(gpu)?;
    let named = photos.iter().zip(rows);
    let named: Vec<PhotoExposure> = named
        .map(|(view, photo_from_scene)| PhotoExposure { view: view.camera.name.clone(), photo_from_scene })
        .collect();
    Ok(write_exposures(&folder.exposures(), &named)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exposures_stay_with_their_photos() -> Result<(), Box<dyn std::error::Error>> {
        let sample = || {
            let mut checkpoint = Checkpoint::default();
            checkpoint.put(TENSORS[0], &[2, 12], (0u8..24).map(f32::from).collect());
            checkpoint.put(TENSORS[1], &[2, 24], (0u8..48).map(f32::from).collect());
            checkpoint
        };
        let path = Path::new("c");
        let error = FirstExposures::take(&mut sample(), 3, None, path).expect_err("another number of photos");
        assert!(error.to_string().contains("exposures of 2 photos, but the data set has 3"), "{error}");
        // The first photo was the second, one is new, and the place of the last is damaged.
        let places = [Some(1), None, Some(0), Some(2)];
        let taken = FirstExposures::take(&mut sample(), 4, Some(&places), path)?;
        let FirstExposures::Saved([rows, moments]) = taken else { panic!("{taken:?}") };
        assert_eq!((rows.len(), moments.len()), (4 * 12, 4 * 24));
        assert_eq!(([rows[0], rows[24]], [moments[0], moments[48]]), ([12.0, 0.0], [24.0, 0.0]));
        let unchanged = NO_EXPOSURE.as_flattened();
        assert!(rows[12..24] == *unchanged && rows[36..] == *unchanged);
        assert!(moments[24..48].iter().chain(&moments[72..]).all(|moment| *moment == 0.0));
        Ok(())
    }
}
