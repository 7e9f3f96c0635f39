//! Whether a run that is resumed has the data set that it began with.

use std::collections::BTreeMap;

use instgs_io::checkpoint::{self, Checkpoint};
use instgs_io::{Fingerprint, IoError};

use super::config::Method;
use super::error::TrainError;
use super::start::{TrainData, read_data};
use super::trainer::TrainJob;

/// Metadata of a checkpoint: the fingerprint of its data set, as JSON. Older versions wrote none.
const DATA_SET: &str = "data_set";
/// What messages call the scene that the joint phase starts from.
const INITIAL_SCENE: &str = "initial scene";

/// A data set that may be gone on with.
#[derive(Debug, Default)]
pub(super) struct SameData {
    /// If the data set changed: for each training view its index before, unless it is new or has another photo.
    pub(super) places: Option<Vec<Option<usize>>>,
    /// A line for the user about a change that is accepted.
    pub(super) warning: Option<String>,
}

/// The fingerprint of what the training of `job` is given.
///
/// # Errors
/// A photo, a mask or the initial scene cannot be read.
pub(super) fn fingerprint(job: &TrainJob, data: &TrainData) -> Result<Fingerprint, IoError> {
    let initial = job.folder().initial_scene();
    let files = match job.config.method {
        Method::Gaussians => &[][..],
        Method::Instanced => &[(INITIAL_SCENE, initial.as_path())],
    };
    Fingerprint::of(&data.train, &data.test, data.extent, files)
}

/// Writes a fingerprint into the metadata of a checkpoint.
pub(super) fn put(print: &Fingerprint, metadata: &mut BTreeMap<String, String>) {
    // Numbers, strings and lists: all of it can be written.
    if let Ok(text) = serde_json::to_string(print) {
        metadata.insert(DATA_SET.into(), text);
    }
}

/// Compares the data set with that of a checkpoint, if the checkpoint knows it.
///
/// # Errors
/// The data set changed, and the job does not accept that.
pub(super) fn check(job: &TrainJob, checkpoint: &Checkpoint, now: &Fingerprint) -> Result<SameData, TrainError> {
    let Some(text) = checkpoint.metadata.get(DATA_SET) else { return Ok(SameData::default()) };
    let earlier: Fingerprint = serde_json::from_str(text)
        .map_err(|e| IoError::new(&job.folder().checkpoints(), format!("cannot use a fingerprint: {e}")))?;
    let changes = now.changes_since(&earlier);
    let Some(first) = changes.first().cloned() else { return Ok(SameData::default()) };
    let count = changes.len();
    if !job.accept_changed_data {
        return Err(TrainError::DataChanged { change: first, count, step: checkpoint.step });
    }
    let more = if count > 1 { format!(" ({count} changes)") } else { String::new() };
    let warning = format!("{first}; continuing on the changed data set{more}");
    Ok(SameData { places: Some(now.places_in(&earlier)), warning: Some(warning) })
}

/// Compares the data set of a finished training, which is not repeated, with that of its last checkpoint; returns a warning
/// about a change that is accepted.
///
/// # Errors
/// The data set cannot be read, or it changed and the job does not accept that.
pub fn check_finished(job: &TrainJob) -> Result<Option<String>, TrainError> {
    let Some((_, checkpoint)) = checkpoint::latest(&job.folder().checkpoints())?.found else { return Ok(None) };
    if !checkpoint.metadata.contains_key(DATA_SET) {
        return Ok(None);
    }
    let data = read_data(&job.data, &job.config, false)?;
    Ok(check(job, &checkpoint, &fingerprint(job, &data)?)?.warning)
}
