//! Pictures of the results of each stage from masks to templates, for the page and as PNG files in `RUN/stages/`. They
//! are made from the stages' files, so a resumed run has them too.

pub mod colors;
pub mod data;
mod files;
mod framing;
mod inputs;
mod labels;
mod masks;
pub mod overlay;
pub mod painter;
mod review;
mod template;
mod tiles;

use std::sync::Arc;

use super::{ReportError, Rgb8};
use colors::Colors;
use data::{ObjectColor, StagePictures, StageView, TemplatePictures};
use inputs::Inputs;
use instgs_eval::composited;
use instgs_io::json::read_json;
use instgs_io::view_image::load_view;
use instgs_io::{IoError, Mask, MaskFolder, View, load_scene};
use instgs_objects::pipeline::{PipelineJob, Prepared, mask_folder, training_views};
use instgs_objects::segment::{Consensus, IdTable};
use instgs_objects::template::GroupReport;
use instgs_train::eval_options;
use instgs_vk::gpu::Gpu;
use instgs_vk::math::similarity::Similarity;
use instgs_vk::render::{RenderError, RenderOptions};
use instgs_vk::scene::{Camera, InstancedScene};
use masks::{Paint, painted};
use overlay::{Objects, group_name};
use painter::{GROUND, Painter, rgb8};

pub use review::review;

/// Number of views whose masks and labels are shown: enough to see all sides, and few enough for one glance.
const VIEWS: usize = 4;
/// Width of their pictures, pixels: four side by side are 280 px wide each, and screens have up to twice as many.
const VIEW_WIDTH_PX: u32 = 400;

/// Draws the masks, the objects, the labelled Gaussians, the registered poses and the merged templates of a run after
/// its preparation, and writes the pictures to `RUN/stages/`.
///
/// # Errors
/// A file of an earlier stage or a photo that is missing or damaged, or a device that fails.
pub fn draw(gpu: &Arc<Gpu>, job: &PipelineJob, prepared: &Prepared) -> Result<StagePictures, ReportError> {
    let inputs = Inputs::read(job)?;
    let mut painter = painter(gpu, job)?;
    let ids = inputs.labels.iter().copied().chain(prepared.consensus.objects.iter().map(|o| o.id));
    let colors = Colors::of_ids(ids);
    let objects = Objects::new(&inputs.cloud, &inputs.labels, &inputs.cameras, &colors);
    let mut out = StagePictures {
        notes: inputs.notes(prepared, &colors),
        objects: legend(prepared, &colors),
        views: views(&mut painter, &inputs, &objects, &colors)?,
        overlays: tiles::overlays(&mut painter, &objects, &inputs.groups, prepared)?,
        groups_left_out: inputs.groups.len().saturating_sub(tiles::GROUPS),
        ..StagePictures::default()
    };
    let merged = load_scene(&job.folder().initial_scene())?.scene;
    let pictures = template::pictures(&mut painter, &merged, &merged, &inputs.cameras)?;
    out.templates = (0..).zip(pictures).map(|(t, pictures)| template(t, pictures, &merged, prepared)).collect();
    out.templates_left_out = merged.template_ranges.len() - out.templates.len();
    files::write(job, &out)?;
    Ok(out)
}

/// Adds pictures of the templates after the joint phase, from `scene.instgs`.
///
/// # Errors
/// A scene that is missing or damaged, or a device that fails.
pub fn add_trained_templates(
    gpu: &Arc<Gpu>,
    job: &PipelineJob,
    pictures: &mut StagePictures,
) -> Result<(), ReportError> {
    let merged = load_scene(&job.folder().initial_scene())?.scene;
    let trained = load_scene(&job.folder().scene())?.scene;
    let cameras = inputs::cameras(job)?;
    let trained = template::pictures(&mut painter(gpu, job)?, &trained, &merged, &cameras)?;
    pictures.templates.iter_mut().zip(trained).for_each(|(template, trained)| template.trained = trained);
    Ok(files::write(job, pictures)?)
}

/// Writes `review.html` in the folder of a job whose objects are known: every training view with its masks and the
/// objects that they show.
///
/// # Errors
/// A mask, a photo or a file of the stage that is missing or damaged.
pub fn review_segments(job: &PipelineJob) -> Result<(), IoError> {
    let (views, _) = training_views(job)?;
    let found: Consensus = read_json(&job.folder().consensus())?;
    review(&job.folder().review(), &views, &MaskFolder::open(&mask_folder(job)?, &views)?, Some(&found))
}

fn painter(gpu: &Arc<Gpu>, job: &PipelineJob) -> Result<Painter, RenderError> {
    let options = RenderOptions { background: [GROUND; 3], ..eval_options(&job.config.train) };
    Painter::new(gpu, options)
}

fn legend(prepared: &Prepared, colors: &Colors) -> Vec<ObjectColor> {
    let name = |id: u32| {
        let of_masks = prepared.consensus.objects.iter().find(|o| o.id == id).and_then(|o| o.category.clone());
        let with = |g: &&GroupReport| g.instances.iter().any(|i| i.id == id);
        of_masks.or_else(|| prepared.groups.iter().find(with)?.name.clone())
    };
    let entry = |id| Some(ObjectColor { id, name: name(id), color: colors.of(id)? });
    colors.ids().filter_map(entry).collect()
}

fn views(
    painter: &mut Painter,
    inputs: &Inputs,
    objects: &Objects<'_>,
    colors: &Colors,
) -> Result<Vec<StageView>, ReportError> {
    let chosen = inputs.choose_views(objects, VIEWS);
    let mut masks = Vec::with_capacity(chosen.len());
    for &view in &chosen {
        masks.push(inputs.mask_of(view)?);
    }
    let given = given_colors(inputs, &masks, colors);
    let cameras: Vec<_> = chosen.iter().map(|&view| inputs.camera_at_width(view, VIEW_WIDTH_PX)).collect();
    let colored = labels::colored(&inputs.cloud, &inputs.labels, colors);
    let labelled = painter.pictures(colored, Similarity::IDENTITY, &cameras)?;
    let mut out = Vec::with_capacity(chosen.len());
    for (((&view, mask), camera), labelled) in chosen.iter().zip(masks).zip(&cameras).zip(&labelled) {
        let photo = photo(&inputs.views[view], camera)?;
        let as_given = |id: u16| given.of(u32::from(id)).map_or(Paint::Nothing, Paint::Color);
        out.push(StageView {
            name: camera.name.clone(),
            given: mask.as_ref().map(|mask| painted(&photo, mask, as_given)),
            objects: mask
                .as_ref()
                .map(|mask| painted(&photo, mask, |id| object_paint(&inputs.table, view, id, colors))),
            labels: rgb8(labelled),
            photo,
        });
    }
    Ok(out)
}

/// The photo of a view at the size of the camera; areas it does not cover are black.
fn photo(view: &View, camera: &Camera) -> Result<Rgb8, IoError> {
    let image = load_view(view, Some(camera.width))?.image;
    let colors = image.rgba.iter().flat_map(|&pixel| composited(pixel, [0.0; 3]));
    // Adding 0.5 rounds, as no channel is negative.
    let pixels = colors.map(|c| (c * 255.0 + 0.5) as u8).collect();
    let photo = Rgb8 { width: image.width, height: image.height, pixels };
    photo.resized(camera.width, camera.height).map_err(|error| IoError::new(&view.image_path, error.to_string()))
}

/// Colours of the mask ids: those of the objects where the ids are the objects' ids.
fn given_colors(inputs: &Inputs, masks: &[Option<Mask>], colors: &Colors) -> Colors {
    if inputs.table == IdTable::Same {
        return colors.clone();
    }
    Colors::of_ids(masks.iter().flatten().flat_map(|mask| mask.ids_present().into_keys()).map(u32::from))
}

/// How an id of a view's mask is painted once its object is known.
fn object_paint(table: &IdTable, view: usize, id: u16, colors: &Colors) -> Paint {
    match table.object_of(view, id) {
        Some(0) => Paint::Nothing,
        Some(object) => colors.of(u32::from(object)).map_or(Paint::Unused, Paint::Color),
        None => Paint::Unused,
    }
}

fn template(index: u32, merged: Vec<Rgb8>, scene: &InstancedScene, prepared: &Prepared) -> TemplatePictures {
    let group = prepared.groups.iter().find(|group| group.template == Some(index));
    let name = group.map(|group| group_name(group.template_id, group.name.as_ref()));
    let gaussians = u64::from(scene.template_ranges[index as usize].count);
    let instances = scene.instances.iter().filter(|instance| instance.template == index).count() as u64;
    let name = name.unwrap_or_else(|| format!("template {index}"));
    TemplatePictures { name, gaussians, instances, merged, trained: Vec::new() }
}
