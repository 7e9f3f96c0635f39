//! The start of a run: the dataset, and the first Gaussians or the newest checkpoint.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use instgs_io::checkpoint::{self, Checkpoint};
use instgs_io::dataset::{Dataset, MissingPhotos, Split, leave_out_missing, read_views};
use instgs_io::point_cloud::{advice_without_points, read_points};
use instgs_io::view_image::IGNORED;
use instgs_io::{Fingerprint, IoError, MaskFolder, View, load_scene};
use instgs_vk::gpu::Gpu;
use instgs_vk::kernels::Variant;
use instgs_vk::scene::instanced_scene::SAME_COLOR;
use instgs_vk::scene::{Camera, Gaussians, InstancedScene, PointCloud, SourceRange};

use super::config::{Init, Method, Strategy, TrainConfig};
use super::data_doubts::doubts;
use super::device_state::DeviceState;
use super::error::TrainError;
use super::exposures::FirstExposures;
use super::given::given_cloud;
use super::initial::{InitialShape, from_points, random_in_view, scene_extent};
use super::log_state::LogState;
use super::memory::picture_budget;
use super::observer::{TrainMessage, TrainObserver};
use super::same_data::{self, SameData};
use super::state_file::{densification_is_due, from_checkpoint, has_instances, restore, size_of_cloud};
use super::trainer::TrainJob;
use super::view_store::{self, PrefetchLimits};
use super::views::{TrainViews, ViewsPlan};

/// Sub-stream of the seed for random starts ("init" in ASCII).
const INIT_STREAM: u64 = 0x696e_6974;

/// A dataset, split into training and test views, with what training needs to know of it.
pub(super) struct TrainData {
    pub(super) train: Vec<View>,
    pub(super) test: Vec<View>,
    /// Point cloud; empty if the dataset has none.
    pub(super) points: PointCloud,
    /// Scene extent, scene units.
    pub(super) extent: f64,
    /// What tells this data set from another; filled before the first step.
    pub(super) print: Fingerprint,
    /// Warnings for the user before the first step, one line each.
    pub(super) warnings: Vec<String>,
}

/// The checkpoint that a run goes on from.
#[derive(Default)]
pub(super) struct Resumed {
    /// The checkpoint and its file; `None` for a run that starts from the beginning.
    found: Option<(PathBuf, Checkpoint)>,
    /// Warnings about newer checkpoints that cannot be used, one line each.
    warnings: Vec<String>,
}

/// The error for a data set whose views are all held out.
pub fn no_training_views(folder: &Path) -> IoError {
    let error = IoError::new(folder, "has no training views");
    error
        .advise("all views with a photo are for test: name some to train on in the camera files, or add missing photos")
}

/// Finds the newest undamaged checkpoint of the run folder, if the job resumes and there is one.
///
/// # Errors
/// The folder cannot be listed, or the configuration does not fit the checkpoint.
pub(super) fn find_checkpoint(job: &TrainJob) -> Result<Resumed, TrainError> {
    if !job.resume {
        return Ok(Resumed::default());
    }
    let newest = checkpoint::latest(&job.folder().checkpoints())?;
    if let Some((path, found)) = &newest.found {
        check_fits(found, path, &job.config)?;
    }
    let warnings = newest.skipped.iter().map(|e| format!("{e}; an older checkpoint is used")).collect();
    Ok(Resumed { found: newest.found, warnings })
}

/// Refuses to resume from a checkpoint that a run with this configuration cannot have written.
fn check_fits(checkpoint: &Checkpoint, path: &Path, config: &TrainConfig) -> Result<(), IoError> {
    let (degree, count) = size_of_cloud(checkpoint, path)?;
    let refuse = |what: String, advice: String| Err(IoError::new(path, what).advise(advice));
    if config.method == Method::Gaussians && has_instances(checkpoint) {
        let instanced = Method::Instanced.name();
        return refuse(
            format!("is of a scene with instances, the configuration has method = {}", config.method.name()),
            format!("continue with --method {instanced}, or train into another folder"),
        );
    }
    if degree != config.sh_degree {
        return refuse(
            format!("has SH degree {degree}, the configuration sh_degree = {}", config.sh_degree),
            format!("continue with --set sh_degree={degree}, or start a new run with --init and its scene"),
        );
    }
    if config.method == Method::Gaussians && count > config.max_gaussians as usize {
        return refuse(
            format!("has {count} Gaussians, the configuration max_gaussians = {}", config.max_gaussians),
            format!("continue with --max-gaussians {count} or more, or start a new run with --init and its scene"),
        );
    }
    if checkpoint.step > config.steps {
        let step = checkpoint.step;
        let flag = if config.method == Method::Instanced { "--joint-steps" } else { "--steps" };
        return refuse(
            format!("is of step {step}, the configuration has steps = {}", config.steps),
            format!("continue with {flag} {step} or more, or choose another folder for a shorter run"),
        );
    }
    Ok(())
}

/// True if a run cannot start without the dataset's points.
pub(super) fn needs_points(config: &TrainConfig, resumed: &Resumed) -> bool {
    config.method == Method::Gaussians
        && config.init_scene.is_none()
        && config.init == Init::Points
        && resumed.found.is_none()
}

/// Reads cameras and points of a dataset. Points that are not needed may be missing or damaged; then the scene's extent
/// is that of the cameras.
///
/// # Errors
/// A file that is damaged or missing; no training views; no points although they are needed.
pub(super) fn read_data(folder: &Path, config: &TrainConfig, needs_points: bool) -> Result<TrainData, TrainError> {
    let dataset = read_dataset(folder, config)?;
    let of = |split| -> Vec<View> { Dataset::split(&dataset, split).cloned().collect() };
    let (train, test) = (of(Split::Train), of(Split::Test));
    if train.is_empty() {
        return Err(no_training_views(folder).into());
    }
    let mut warnings = dataset.notes;
    let points = match read_points(folder) {
        Err(error) if needs_points => return Err(error.into()),
        Err(error) => {
            // For a random start the advice would be to do what is done.
            let advice = error.advice.filter(|_| config.init != Init::Random);
            warnings.push(format!("{}; continuing without points", IoError { advice, ..error }));
            PointCloud::default()
        }
        Ok(Some(loaded)) => {
            if loaded.dropped_non_finite > 0 {
                let (path, n) = (loaded.path.display(), loaded.dropped_non_finite);
                warnings.push(format!("{path}: dropped {n} points that are not finite"));
            }
            warnings.extend(loaded.notes);
            loaded.points
        }
        Ok(None) if needs_points => {
            let error = IoError::new(folder, "has no point cloud to start from");
            return Err(error.advise(advice_without_points(folder)).into());
        }
        Ok(None) => PointCloud::default(),
    };
    let cameras: Vec<Camera> = train.iter().map(|v| v.camera.clone()).collect();
    let extent = scene_extent(&cameras, &points);
    Ok(TrainData { train, test, points, extent, print: Fingerprint::default(), warnings })
}

/// Reads the views that a run trains on and is judged by: those with photos, and with the masks of pixels that the
/// configuration names.
///
/// # Errors
/// Camera files that are damaged or missing, or too many photos that are missing.
pub fn read_dataset(folder: &Path, config: &TrainConfig) -> Result<Dataset, IoError> {
    let mut dataset = read_views(folder)?;
    let may_be_missing = if config.skip_missing { MissingPhotos::Skip } else { MissingPhotos::Few };
    dataset.notes.extend(leave_out_missing(&mut dataset.views, may_be_missing)?);
    if let Some(masks) = &config.pixel_masks {
        dataset.notes.extend(put_pixel_masks(&mut dataset.views, masks)?);
    }
    Ok(dataset)
}

/// Gives views the masks of a folder; returns a note about those that have none.
///
/// # Errors
/// The folder cannot be read, holds two masks of a view, or none of any.
pub fn put_pixel_masks(views: &mut [View], folder: &Path) -> Result<Option<String>, IoError> {
    let masks = MaskFolder::open(folder, views)?;
    let mut without = 0;
    for view in views.iter_mut() {
        view.mask_path = masks.file_of(view)?.map(Path::to_path_buf);
        without += usize::from(view.mask_path.is_none());
    }
    if without == views.len() {
        let error = IoError::new(folder, "has no mask of any photo");
        return Err(error.advise("a mask is named like its photo: a.png or a.jpg.png for a.jpg"));
    }
    Ok((without > 0).then(|| {
        format!("{}: {without} of {} photos have no mask: all of their pixels count", folder.display(), views.len())
    }))
}

/// A note about masks of pixels in the data set's `masks/` that a plain cloud is not trained with.
pub fn unused_masks(data: &Path, config: &TrainConfig, views: &[View]) -> Option<String> {
    let folder = MaskFolder::default_for(data)?;
    let is_used = config.method == Method::Instanced
        || config.pixel_masks.is_some()
        || views.iter().any(|view| view.mask_path.is_some());
    let masks = MaskFolder::open(&folder, views).ok().filter(|masks| !is_used && masks.categories.is_empty())?;
    // Masks of objects are of no use to a plain cloud, and nobody expects it.
    let of_pixels = views.iter().find_map(|view| masks.of_view(view).ok().flatten()).is_some_and(|mask| {
        let ids = mask.ids_present();
        !ids.is_empty() && ids.keys().all(|&id| id == u16::from(u8::MAX) || id == u16::MAX)
    });
    of_pixels.then(|| {
        let folder = folder.display();
        format!("{folder} is not used: --pixel-masks {folder} trains only on the pixels that its masks leave")
    })
}

/// Everything that is read before the first step.
pub(super) struct Loaded {
    pub(super) data: TrainData,
    pub(super) variant: Variant,
    pub(super) start: Start,
    pub(super) views: TrainViews,
}

/// Reads cameras, points, pictures and the state to start from; `observer` receives the warnings, and the progress through
/// the photos.
///
/// # Errors
/// Damaged or missing input, or more than the device holds.
pub(super) fn load_all(gpu: &Arc<Gpu>, job: &TrainJob, observer: &mut dyn TrainObserver) -> Result<Loaded, TrainError> {
    let config = &job.config;
    let resumed = find_checkpoint(job)?;
    let mut data = read_data(&job.data, config, needs_points(config, &resumed))?;
    data.print = same_data::fingerprint(job, &data)?;
    let same = match &resumed.found {
        Some((_, checkpoint)) => same_data::check(job, checkpoint, &data.print)?,
        None => SameData::default(),
    };
    data.warnings.extend(same.warning);
    let places = same.places.as_deref();
    let variant = Variant::for_training(gpu.caps());
    let mut start = match config.method {
        Method::Gaussians => first_state(gpu, config, resumed, &mut data, places, variant.workgroup_size)?,
        Method::Instanced => first_instanced(gpu, job, resumed, &mut data, places, variant.workgroup_size)?,
    };
    if places.is_some() {
        // They count by the views of before.
        start.log.losses.clear();
    }
    let cameras: Vec<Camera> = data.train.iter().map(|v| v.camera.clone()).collect();
    data.warnings.extend(doubts(&cameras, &data.points, data.extent, config.near));
    data.warnings.iter().try_for_each(|warning| observer.notify(TrainMessage::Warning(warning)))?;
    let budget_bytes = picture_budget(config, gpu.device_heap_bytes());
    let width = (config.width > 0).then_some(config.width);
    let plan = ViewsPlan { views: &data.train, width, budget_bytes, seed: config.seed, first_step: start.step };
    let (mut done, total) = (0, data.train.len() + data.test.len());
    let mut on_read = || {
        done += 1;
        observer.notify(TrainMessage::PhotoRead { done, total })
    };
    let views = TrainViews::load(gpu, &plan, &mut on_read)?;
    // Test pictures are checked too: a damaged one should be found now, not after hours.
    let masked = leave_out_masked(&mut data.test, width, &mut on_read)?;
    let warnings = [views.without_pixels(), masked];
    warnings.iter().flatten().try_for_each(|warning| observer.notify(TrainMessage::Warning(warning)))?;
    Ok(Loaded { data, variant, start, views })
}

/// Removes views whose masks leave no pixel to compare, and returns a warning about them. Decodes all views, and calls
/// `on_read` after each.
///
/// # Errors
/// The first picture that cannot be read; the first error of `on_read`.
pub fn leave_out_masked(
    views: &mut Vec<View>,
    width: Option<u32>,
    on_read: &mut dyn FnMut() -> Result<(), IoError>,
) -> Result<Option<String>, IoError> {
    let mut is_shown = Vec::new();
    view_store::load_all::<IoError>(views, width, PrefetchLimits::default(), &mut |_, view| {
        is_shown.push(view.image.rgba.iter().any(|rgba| rgba[3] != IGNORED));
        on_read()
    })?;
    let masked = views.iter().zip(&is_shown).find(|(_, shown)| !**shown);
    let warning = masked.map(|(view, _)| {
        let (count, path) = (is_shown.iter().filter(|shown| !**shown).count(), view.image_path.display());
        let left_out = if count == 1 { "it is left out".into() } else { format!("{count} such views are left out") };
        format!("{path}: its mask leaves nothing to compare; {left_out}")
    });
    let mut shown = is_shown.into_iter();
    views.retain(|_| shown.next() == Some(true));
    Ok(warning)
}

/// The state before the first step of a run.
pub(super) struct Start {
    pub(super) state: DeviceState,
    /// Number of finished steps.
    pub(super) step: u64,
    /// Whether the work between the last finished step and the next one is still to be done.
    pub(super) due: bool,
    /// What the exposures of the photos begin with.
    pub(super) exposures: FirstExposures,
    /// What the log goes on from.
    pub(super) log: LogState,
}

/// Makes the device state that a run starts from; `places` as in [`SameData`].
pub(super) fn first_state(
    gpu: &Arc<Gpu>,
    config: &TrainConfig,
    resumed: Resumed,
    data: &mut TrainData,
    places: Option<&[Option<usize>]>,
    chunk_size: u32,
) -> Result<Start, TrainError> {
    data.warnings.extend(resumed.warnings);
    if let Some((path, mut found)) = resumed.found {
        let (step, due) = (found.step, densification_is_due(&found));
        let log = LogState::take(&mut found, &path)?;
        let exposures = FirstExposures::take(&mut found, data.train.len(), places, &path)?;
        let state = from_checkpoint(gpu, found, &path, chunk_size)?;
        return Ok(Start { state, step, due, exposures, log });
    }
    let (degree, shape) = (config.sh_degree, InitialShape::new(config));
    let cloud = match (&config.init_scene, config.init) {
        (Some(scene), _) => {
            let given = given_cloud(scene, config)?;
            data.warnings.extend(given.warnings);
            given.cloud
        }
        (None, Init::Points) => from_points(&data.points, degree, shape),
        (None, Init::Random) => {
            let cameras: Vec<Camera> = data.train.iter().map(|v| v.camera.clone()).collect();
            let seed = instgs_vk::math::rng::Rng::new(config.seed).fork(INIT_STREAM).next_u64();
            random_in_view(&cameras, config.init_count as usize, seed, degree, shape)
        }
    };
    let cloud = capped(cloud, config, &mut data.warnings);
    let state = DeviceState::new(gpu, &InstancedScene::from_cloud(cloud), chunk_size)?;
    Ok(Start { state, step: 0, due: false, exposures: FirstExposures::Unchanged, log: LogState::default() })
}

/// The merged scene that the joint phase starts from, with the checkpoint's values if there is one; `places` as in
/// [`SameData`].
fn first_instanced(
    gpu: &Arc<Gpu>,
    job: &TrainJob,
    resumed: Resumed,
    data: &mut TrainData,
    places: Option<&[Option<usize>]>,
    chunk_size: u32,
) -> Result<Start, TrainError> {
    data.warnings.extend(resumed.warnings);
    let path = job.folder().initial_scene();
    let mut scene = load_scene(&path)?.scene;
    // A cloud without Gaussians is read as one of degree 0.
    for cloud in [&mut scene.templates, &mut scene.own, &mut scene.background] {
        if cloud.is_empty() {
            cloud.sh_degree = job.config.sh_degree;
        }
    }
    let degrees = [&scene.templates, &scene.background].map(|cloud| cloud.sh_degree);
    if degrees != [job.config.sh_degree; 2] {
        let [templates, background] = degrees;
        let what = format!("has templates of SH degree {templates} and a background of {background}");
        let advice = format!("train with --set sh_degree={}", templates.max(background));
        return Err(IoError::new(&path, what).advise(advice).into());
    }
    if job.config.joint.color_matrix_rate > 0.0 && scene.color_from_template.is_empty() {
        scene.color_from_template = vec![SAME_COLOR; scene.instances.len()];
    }
    if job.config.joint.own_share > 0.0 && scene.own_ranges.is_empty() {
        scene.own_ranges = vec![SourceRange::default(); scene.instances.len()];
    }
    // Copies of an instance learn on their own.
    let scene = scene.with_unshared_offsets(usize::MAX);
    let mut state = DeviceState::new(gpu, &scene, chunk_size)?;
    let Some((path, mut found)) = resumed.found else {
        let exposures = FirstExposures::of_plain_cloud(&job.folder())?;
        return Ok(Start { state, step: 0, due: false, exposures, log: LogState::default() });
    };
    let (step, due) = (found.step, densification_is_due(&found));
    let log = LogState::take(&mut found, &path)?;
    let exposures = FirstExposures::take(&mut found, data.train.len(), places, &path)?;
    restore(gpu, &mut state, found, &path)?;
    Ok(Start { state, step, due, exposures, log })
}

/// The largest number of Gaussians that training may start from. If the strategy adds Gaussians, points give at most
/// half of `max_gaussians`, since without room to grow no detail can be added. See docs/measurements.md.
fn most_at_first(config: &TrainConfig) -> usize {
    let most = config.max_gaussians as usize;
    let grows = config.strategy != Strategy::None && config.init_scene.is_none();
    if grows { most.div_ceil(2) } else { most }
}

/// How many of `count` Gaussians training starts from, and a warning if they are fewer.
pub fn first_count(count: usize, config: &TrainConfig) -> (usize, Option<String>) {
    let most = most_at_first(config);
    if count <= most {
        return (count, None);
    }
    let why = match config.max_gaussians as usize {
        max if max > most => "half of max_gaussians, so that it can grow",
        _ => "max_gaussians",
    };
    (most, Some(format!("the start has {count} Gaussians; {most} of them are kept ({why})")))
}

/// Keeps every k-th Gaussian, so that there are no more than at first may be.
fn capped(cloud: Gaussians, config: &TrainConfig, warnings: &mut Vec<String>) -> Gaussians {
    let count = cloud.len();
    let (most, warning) = first_count(count, config);
    if warning.is_none() {
        return cloud;
    }
    warnings.extend(warning);
    // Evenly distributed: i is kept where i * most / count increases.
    cloud.filtered(|i| (i + 1) * most / count > i * most / count)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{ConfigBuilder, ConfigError};
    use instgs_io::checkpoint::save;

    type Test = Result<(), Box<dyn std::error::Error>>;

    fn with(sets: &[&str]) -> Result<TrainConfig, ConfigError> {
        sets.iter().try_fold(ConfigBuilder::new(), |builder, set| builder.set(set))?.finish()
    }

    /// A checkpoint after 500 steps, of degree 2, with 40 Gaussians: the parts that are read without a device.
    fn sample() -> Checkpoint {
        let mut out = Checkpoint { step: 500, ..Checkpoint::default() };
        out.metadata.insert("sh_degree".into(), "2".into());
        out.put("parameter.opacity_logits", &[40, 1], vec![0.0f32; 40]);
        out
    }

    #[test]
    fn a_configuration_that_does_not_fit_the_checkpoint_is_refused_in_one_line() -> Test {
        let error = |sets: &[&str]| {
            let config = with(&[&["sh_degree=2"], sets].concat())?;
            let result = check_fits(&sample(), Path::new("c.safetensors"), &config);
            Ok::<_, ConfigError>(result.err().map(|e| e.to_string()).unwrap_or_default())
        };
        for (set, words) in [
            ("sh_degree=3", ["SH degree 2", "sh_degree = 3", "--set sh_degree=2", "--init"]),
            ("sh_degree=1", ["SH degree 2", "sh_degree = 1", "--set sh_degree=2", "--init"]),
            ("max_gaussians=39", ["40 Gaussians", "max_gaussians = 39", "--max-gaussians 40", "--init"]),
            ("steps=499", ["step 500", "steps = 499", "--steps 500", "another folder"]),
        ] {
            let text = error(&[set])?;
            assert!(text.starts_with("c.safetensors: ") && text.lines().count() == 1, "{text}");
            words.iter().for_each(|word| assert!(text.contains(word), "{word}: {text}"));
        }
        // Values at the limits are accepted.
        assert_eq!(error(&["max_gaussians=40", "steps=500"])?, "");
        assert_eq!(error(&[])?, "");
        let unnamed = Checkpoint { metadata: Default::default(), ..sample() };
        assert!(check_fits(&unnamed, Path::new("c"), &with(&[])?).is_err_and(|e| e.to_string().contains("sh_degree")));
        Ok(())
    }

    #[test]
    fn a_start_of_points_leaves_room_to_grow() -> Test {
        let most = |sets: &[&str]| Ok::<_, ConfigError>(most_at_first(&with(sets)?));
        assert_eq!(most(&["max_gaussians=41"])?, 21);
        // A strategy that adds none may start with all, and a given cloud is kept whole.
        assert_eq!(most(&["max_gaussians=41", "strategy=none"])?, 41);
        assert_eq!(most(&["max_gaussians=41", "init_scene=a.ply"])?, 41);
        Ok(())
    }

    #[test]
    fn views_that_are_all_masked_are_left_out_and_told_of() -> Test {
        let folder = tempfile::tempdir()?;
        let view = |name: &str, mask: &[u8]| {
            let [image_path, mask_path] = ["png", "mask.png"].map(|end| folder.path().join(format!("{name}.{end}")));
            image::RgbImage::from_pixel(2, 1, image::Rgb([9; 3])).save(&image_path)?;
            image::GrayImage::from_vec(2, 1, mask.into()).ok_or("size")?.save(&mask_path)?;
            let pose = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];
            let sides = Camera {
                name: name.into(),
                width: 2,
                height: 1,
                fx: 1.0,
                fy: 1.0,
                cx: 1.0,
                cy: 0.5,
                view_from_world: pose,
            };
            let split = instgs_io::Split::Test;
            Ok::<_, Box<dyn std::error::Error>>(View {
                camera: sides,
                image_path,
                split,
                distortion: None,
                mask_path: Some(mask_path),
            })
        };
        let mut views = vec![view("half", &[0, 255])?, view("none", &[0, 0])?, view("all", &[255, 255])?];
        let warning = leave_out_masked(&mut views, None, &mut || Ok(()))?.ok_or("no warning")?;
        assert!(warning.contains("none.png") && warning.contains("it is left out"), "{warning}");
        assert_eq!(views.iter().map(|view| view.camera.name.as_str()).collect::<Vec<_>>(), ["half", "all"]);
        assert_eq!(leave_out_masked(&mut views, None, &mut || Ok(()))?, None);
        Ok(())
    }

    #[test]
    fn points_are_needed_only_by_a_run_that_starts_from_them() -> Test {
        let folder = tempfile::tempdir()?;
        let out = folder.path().to_path_buf();
        let needs = |sets: &[&str], resume: bool| {
            let config = with(&[&["sh_degree=2"], sets].concat())?;
            let job = TrainJob {
                data: out.clone(),
                out: out.clone(),
                config,
                config_file: None,
                resume,
                accept_changed_data: false,
            };
            Ok::<_, Box<dyn std::error::Error>>(needs_points(&job.config, &find_checkpoint(&job)?))
        };
        assert!(needs(&[], false)? && needs(&[], true)?);
        assert!(!needs(&["init=random"], false)? && !needs(&["init_scene=a.ply"], false)?);
        let path = save(&instgs_io::RunFolder::new(&out).checkpoints(), &sample())?;
        // Without --resume the checkpoint has no influence, whatever its state.
        assert!(needs(&[], false)? && needs(&["sh_degree=3"], false)?);
        assert!(!needs(&[], true)?);
        assert!(needs(&["sh_degree=3"], true).is_err_and(|e| e.to_string().contains("sh_degree = 3")));
        // A damaged checkpoint gives a warning, and points are needed again.
        std::fs::write(&path, "x")?;
        assert!(needs(&[], true)?);
        let config = with(&[])?;
        let job =
            TrainJob { data: out.clone(), out, config, config_file: None, resume: true, accept_changed_data: false };
        assert_eq!(find_checkpoint(&job)?.warnings.len(), 1);
        Ok(())
    }

    #[test]
    fn missing_or_damaged_points_matter_only_where_they_are_needed() -> Test {
        let folder = tempfile::tempdir()?;
        let frame = |n: u32| {
            let pose = format!("[[1,0,0,{n}],[0,1,0,0],[0,0,1,0],[0,0,0,1]]");
            format!(r#"{{"file_path":"{n}.png","transform_matrix":{pose}}}"#)
        };
        let text = format!(r#"{{"w":2,"h":2,"fl_x":1,"frames":[{},{},{}]}}"#, frame(0), frame(1), frame(5));
        std::fs::write(folder.path().join("transforms.json"), text)?;
        let config = with(&[])?;
        let read = |needs| read_data(folder.path(), &config, needs);
        let text_of = |needs| read(needs).err().map(|e| e.to_string()).unwrap_or_default();
        assert!(text_of(false).contains("2 of the other 2 photos"), "{}", text_of(false));
        (0..6).try_for_each(|n| std::fs::write(folder.path().join(format!("{n}.png")), ""))?;
        assert!(text_of(true).contains("no point cloud") && text_of(true).contains("--init"));
        assert!(read(false)?.warnings.is_empty());
        std::fs::write(folder.path().join("points3d.ply"), "no ply")?;
        assert!(text_of(true).contains("points3d.ply"), "{}", text_of(true));
        let data = read(false)?;
        assert!(data.points.is_empty() && data.warnings.len() == 1, "{:?}", data.warnings);
        // Training cameras at 1 and 5: 1.1 times their largest distance from the mean, 2.
        assert!((data.extent - 2.2).abs() < 1e-9, "{}", data.extent);
        Ok(())
    }
}
