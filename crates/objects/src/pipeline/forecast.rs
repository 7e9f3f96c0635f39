//! What a run would use, found out without training and without a device: cameras, points, masks, memory.

use std::collections::BTreeSet;
use std::path::PathBuf;

use super::error::PipelineError;
use super::job::PipelineJob;
use super::label_gaussians::training_views;
use super::make_masks::training_boxes;
use super::mask_check::check_masks;
use super::mask_source::MaskSource;
use instgs_io::{IoError, MaskFolder, Split, View, read_groups, read_points};
use instgs_train::config::{Init, Method};
use instgs_train::facts::MemoryUse;
use instgs_train::given::given_cloud;
use instgs_train::memory::planned_uses;
use instgs_train::{first_count, no_training_views, read_dataset, unused_masks};
use instgs_vk::scene::PosedGroup;

/// What a run would use; see [`forecast`].
#[derive(Clone, Debug, PartialEq)]
pub struct Forecast {
    /// Number of training views with photos.
    pub train_views: usize,
    /// Number of test views with photos.
    pub test_views: usize,
    /// Width and height of the smallest and of the largest training picture, pixels.
    pub pictures_px: [[u32; 2]; 2],
    /// Number of training views whose lens distortion is removed.
    pub distorted: usize,
    /// Where the first Gaussians come from.
    pub start: StartForecast,
    /// What is known of the objects; `None` for a plain cloud.
    pub objects: Option<ObjectForecast>,
    /// Device memory that is known before, with as many Gaussians as may be drawn; see [`planned_uses`].
    pub memory: Vec<MemoryUse>,
    /// Warnings for the user, one line each.
    pub notes: Vec<String>,
}

/// Where the first Gaussians of a run come from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum StartForecast {
    /// So many points of the data set, of which there may be more.
    Points(usize),
    /// So many random ones.
    Random(u32),
    /// This scene.
    Scene(PathBuf),
}

/// What is known of a run's objects before it is trained.
#[derive(Clone, Debug, PartialEq)]
pub struct ObjectForecast {
    /// Where masks come from.
    pub masks: MaskForecast,
    /// The groups with poses that are given; `None` if they are to be found.
    pub groups: Option<GroupForecast>,
}

/// What is known of the masks.
#[derive(Clone, Debug, PartialEq)]
pub enum MaskForecast {
    /// Masks that exist.
    Folder {
        /// Folder of the masks.
        folder: PathBuf,
        /// Number of training views that have one.
        views: usize,
        /// Largest number of objects in one view.
        most_in_view: usize,
        /// Number of different ids in all: the number of objects if ids are the same from view to view.
        ids: usize,
    },
    /// Masks are made from boxes after the plain cloud.
    Boxes {
        /// The file.
        file: PathBuf,
        /// Number of boxes in the world.
        in_world: usize,
        /// Number of boxes in training photos.
        in_photos: usize,
    },
    /// Masks are made from words before anything is trained.
    Prompt {
        /// What is detected.
        prompt: String,
        /// Folder of the models.
        models: PathBuf,
    },
}

/// Groups that are given.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GroupForecast {
    /// The file.
    pub file: PathBuf,
    /// Number of groups.
    pub groups: usize,
    /// Number of instances in all groups.
    pub instances: usize,
}

/// Finds out what a run would use. Cameras, points, a given scene, masks, boxes and groups are read, photos are not; nothing is written.
/// `heap_bytes` is the memory of the device.
///
/// # Errors
/// Those of the run before its first step, but for damaged photos, models and devices.
pub fn forecast(job: &PipelineJob, heap_bytes: u64) -> Result<Forecast, PipelineError> {
    let config = &job.config.train;
    let dataset = read_dataset(&job.data, config)?;
    let (views, cameras) = training_views(job)?;
    let sizes: Vec<[u32; 2]> = cameras.iter().map(|camera| [camera.width, camera.height]).collect();
    let area = |size: &&[u32; 2]| u64::from(size[0]) * u64::from(size[1]);
    let (Some(smallest), Some(largest)) = (sizes.iter().min_by_key(area), sizes.iter().max_by_key(area)) else {
        return Err(no_training_views(&job.data).into());
    };
    let mut notes = dataset.notes.clone();
    notes.extend(unused_masks(&job.data, config, &dataset.views));
    let objects = match config.method {
        Method::Gaussians => None,
        Method::Instanced => {
            // Masks from words do not exist before the run.
            if !matches!(MaskSource::of(job)?, MaskSource::Prompt { .. }) {
                notes.extend(check_masks(job)?);
            }
            Some(objects(job, &views)?)
        }
    };
    Ok(Forecast {
        train_views: views.len(),
        test_views: dataset.split(Split::Test).count(),
        pictures_px: [*smallest, *largest],
        distorted: views.iter().filter(|view| view.distortion.is_some()).count(),
        start: start(job, &mut notes)?,
        objects,
        memory: planned_uses(config, &sizes, heap_bytes),
        notes,
    })
}

/// What the run starts from; tells what it would say of that.
fn start(job: &PipelineJob, notes: &mut Vec<String>) -> Result<StartForecast, IoError> {
    let config = &job.config.train;
    let mut kept = |count: usize| {
        let (kept, warning) = first_count(count, config);
        notes.extend(warning);
        kept
    };
    Ok(match (&config.init_scene, config.init) {
        (Some(scene), _) if !scene.is_file() && !scene.is_dir() => {
            return Err(IoError::new(scene, "does not exist").advise("--init takes a scene file"));
        }
        (Some(scene), _) => {
            let given = given_cloud(scene, config)?;
            // Objects are found in a given cloud as it is.
            if config.method == Method::Gaussians {
                kept(given.cloud.len());
            }
            notes.extend(given.warnings);
            StartForecast::Scene(scene.clone())
        }
        (None, Init::Random) => StartForecast::Random(kept(config.init_count as usize) as u32),
        (None, Init::Points) => match read_points(&job.data)? {
            Some(loaded) => StartForecast::Points(kept(loaded.points.positions.len())),
            None => {
                let error = IoError::new(&job.data, "has no point cloud to start from");
                return Err(error.advise(instgs_io::point_cloud::advice_without_points(&job.data)));
            }
        },
    })
}

fn objects(job: &PipelineJob, views: &[View]) -> Result<ObjectForecast, IoError> {
    let masks = match MaskSource::of(job)? {
        MaskSource::Folder(folder) => masks_in(folder, views)?,
        MaskSource::Boxes(file) => {
            let boxes = training_boxes(job, &file)?;
            let of_photos = views.iter().filter_map(|view| boxes.views.get(&view.camera.name));
            let in_photos = of_photos.map(Vec::len).sum();
            MaskForecast::Boxes { file, in_world: boxes.objects.len(), in_photos }
        }
        MaskSource::Prompt { prompt, models } => MaskForecast::Prompt { prompt, models },
    };
    let groups = job.config.pipeline.groups.as_ref().map(|file| {
        let groups = read_groups(file)?;
        let instances = |group: &PosedGroup| group.instances.len();
        Ok::<_, IoError>(GroupForecast {
            file: file.clone(),
            groups: groups.len(),
            instances: groups.iter().map(instances).sum(),
        })
    });
    Ok(ObjectForecast { masks, groups: groups.transpose()? })
}

fn masks_in(folder: PathBuf, views: &[View]) -> Result<MaskForecast, IoError> {
    let masks = MaskFolder::open(&folder, views)?;
    let (mut with_mask, mut most_in_view, mut all) = (0, 0, BTreeSet::new());
    for view in views {
        let Some(mask) = masks.of_view(view)? else { continue };
        let ids = mask.ids_present();
        with_mask += 1;
        most_in_view = most_in_view.max(ids.len());
        all.extend(ids.into_keys());
    }
    Ok(MaskForecast::Folder { folder, views: with_mask, most_in_view, ids: all.len() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::config::ConfigBuilder;

    type Test = Result<(), Box<dyn std::error::Error>>;

    /// Two photos' cameras without photos, or no folder at all, are the run's own errors.
    #[test]
    fn what_a_run_would_refuse_is_refused() -> Test {
        let data = tempfile::tempdir()?;
        let job = PipelineJob {
            data: data.path().into(),
            out: "run".into(),
            config: ConfigBuilder::new().file("quick")?.finish()?,
            resume: false,
            accept_changed_data: false,
        };
        let error = forecast(&job, 1 << 30).map_err(|e| e.to_string());
        assert!(error.as_ref().is_err_and(|e| e.contains("has no cameras")), "{error:?}");
        Ok(())
    }
}
