//! `instgs-vk eval`: compares renderings of a scene with a data set's photos.

use std::cell::Cell;
use std::collections::BTreeMap;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

use clap::Args;

use super::export::config_beside;
use super::followed::Followed;
use super::lpips_args::LpipsArgs;
use super::picture_files;
use instgs_console::args::{HostMemoryArgs, JsonArgs, LookArgs, MemoryArgs, SplitArg, create_folder};
use instgs_console::device::{self, DeviceArgs};
use instgs_console::opened::{CoarserViews, OpenedScene};
use instgs_console::table::Table;
use instgs_console::{CliError, Printer, failed_to_render};
use instgs_eval::{EvalReport, Extras, Metrics, PicturePair, evaluate};
use instgs_io::dataset::{MissingPhotos, leave_out_missing};
use instgs_io::picture_png::write_png;
use instgs_io::{IoError, View, read_views};
use instgs_train::{leave_out_masked, put_pixel_masks};
use instgs_vk::render::Renderer;
use instgs_vk::scene::camera::MAX_IMAGE_SIDE;

/// Factor of the differences in the pictures of --out.
const DIFFERENCE_GAIN: f32 = 4.0;

/// Renders a dataset's views and measures how close they are to the photos: PSNR, SSIM and LPIPS.
///
/// Rendered pictures are clamped to 0..1 but not rounded to 8 bits. PSNR is in dB, over all channels, at most 100. SSIM
/// has an 11x11 Gaussian window of sigma 1.5, zero padding, and is the mean over all pixels and channels. Pixels where
/// a photo is not valid are left out of PSNR; for the other two they count as equal. The last row is the mean of the views.
/// Views that masks cover wholly are left out, with a warning.
///
/// The report.json of a run has the same figures, at the same --width and --background: a scene in the folder of its run is
/// compared within the masks of pixels that it was trained with, and without those where the views of --data have none of them.
///
/// LPIPS (0.1) needs trained weights, which are not part of this program: tools/models/convert_lpips.py makes them.
/// Without them LPIPS is not computed (null in JSON).
///
/// Of a scene with pages that memory is too short for, views are measured as they are drawn: coarser where pages have no room. A
/// warning, and coarser_views in JSON, say of how many views that is true.
#[derive(Args)]
#[command(after_help = "Examples:\n  \
    instgs-vk eval --scene room.instgs --data room\n  \
    instgs-vk eval --scene room.ply --data room --split all --width 320 --json report.json --out pictures\n  \
    instgs-vk eval --scene facade.ply --data facade --exposures\n  \
    instgs-vk eval --scene street.ply --data street --pixel-masks street/people\n  \
    instgs-vk eval --scene city.instgs --data city --host-memory-mb 1000\n  \
    python3 tools/models/convert_lpips.py --net vgg --out vgg.safetensors\n  \
    instgs-vk eval --scene room.instgs --data room --lpips-net vgg --lpips-weights vgg.safetensors")]
pub(super) struct EvalArgs {
    /// Scene to evaluate: .instgs, .ply, .spz, .sog, .splat or .glb
    #[arg(long, value_name = "S")]
    scene: PathBuf,
    /// Dataset folder with photos: transforms_train/test.json, transforms.json, or COLMAP's sparse/0 and images
    #[arg(long, value_name = "DIR")]
    data: PathBuf,
    /// The views of --data to compare
    #[arg(long, value_enum, default_value = "test")]
    split: SplitArg,
    /// Downscale the photos to this width before they are compared [default: their own width]
    #[arg(long, value_name = "W", value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_IMAGE_SIDE)))]
    width: Option<u32>,
    /// Folder for a picture of every view: rendering, photo, and 4 times their difference, side by side
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Leave out views without a photo, however many they are; up to half of them always are
    #[arg(long)]
    skip_missing: bool,
    /// Folder of masks of the pixels that count, named like the photos: black ones are not compared [default: that of the run in
    /// whose folder the scene lies, if there is one]
    #[arg(long, value_name = "DIR")]
    pixel_masks: Option<PathBuf>,
    /// Compare all pixels that the data set itself does not mask, although the scene's run was trained with masks of pixels
    #[arg(long, conflicts_with = "pixel_masks")]
    no_pixel_masks: bool,
    /// Also PSNR up to the photo's exposure: the affine map of colours that fits one half best is applied to the other
    #[arg(long)]
    exposures: bool,
    #[command(flatten)]
    lpips: LpipsArgs,
    #[command(flatten)]
    look: LookArgs,
    #[command(flatten)]
    memory: MemoryArgs,
    #[command(flatten)]
    host_memory: HostMemoryArgs,
    #[command(flatten)]
    pub(super) json: JsonArgs,
}

/// What `--json` writes.
#[derive(serde::Serialize)]
struct EvalOutput<'a> {
    #[serde(flatten)]
    report: &'a EvalReport,
    /// Number of views whose pages had no room, so that they are measured coarser than the scene is; left out if there are none.
    #[serde(skip_serializing_if = "Option::is_none")]
    coarser_views: Option<NonZeroUsize>,
}

/// The pictures of `--out`, a file for each view.
struct Pictures {
    files: Vec<PathBuf>,
}

impl Pictures {
    /// Makes the folder, and chooses the names of its files, which must not be photos of `data`.
    fn new(folder: &Path, views: &[View], data: &Path) -> Result<Self, CliError> {
        let cameras: Vec<_> = views.iter().map(|view| view.camera.clone()).collect();
        let names = picture_files::names(&cameras)?;
        let masks = views.iter().filter_map(|view| view.mask_path.as_deref());
        picture_files::check_not_of_data(folder, &names, data, masks)?;
        create_folder(folder)?;
        Ok(Self { files: names.iter().map(|name| folder.join(format!("{name}.png"))).collect() })
    }
}

/// The views of the split that have a photo, and pixels that count.
fn views_to_compare(args: &EvalArgs, printer: &Printer) -> Result<Vec<View>, CliError> {
    let mut views = args.split.views(&args.data, printer)?;
    let may_be_missing = if args.skip_missing { MissingPhotos::Skip } else { MissingPhotos::Few };
    leave_out_missing(&mut views, may_be_missing)?.iter().for_each(|note| printer.warning(note));
    if let Some(folder) = &args.pixel_masks {
        mask(&mut views, &args.data, folder)?.iter().for_each(|note| printer.warning(note));
    } else if !args.no_pixel_masks {
        mask_as_trained(&mut views, args, printer);
    }
    // Photos are decoded for this, so only where there are masks.
    if views.iter().any(|view| view.mask_path.is_some()) {
        let mut progress = printer.progress("photos", views.len() as u64);
        let masked = leave_out_masked(&mut views, args.width, &mut || {
            progress.step("read");
            Ok(())
        })?;
        drop(progress);
        masked.iter().for_each(|note| printer.warning(note));
    }
    Ok(views)
}

/// Gives views of a data set the masks of a folder, as training does: its photos are taken together, since those of one split
/// may have none. Returns a note about photos without a mask.
fn mask(views: &mut [View], data: &Path, folder: &Path) -> Result<Option<String>, IoError> {
    let mut all = read_views(data)?.views;
    let note = put_pixel_masks(&mut all, folder)?;
    let masks: BTreeMap<PathBuf, Option<PathBuf>> =
        all.into_iter().map(|view| (view.image_path, view.mask_path)).collect();
    for view in views {
        view.mask_path = masks.get(&view.image_path).cloned().flatten();
    }
    Ok(note)
}

/// Gives views the masks that the run in whose folder the scene lies was trained and judged with, if it was with any. Masks that
/// do not fit are of another data set.
fn mask_as_trained(views: &mut [View], args: &EvalArgs, printer: &Printer) {
    let config = config_beside(&args.scene).unwrap_or_else(|error| {
        printer.warning(format_args!("{error}: masks of pixels that the run may have been trained with are not used"));
        None
    });
    let Some(folder) = config.and_then(|config| config.pixel_masks) else { return };
    let scene = args.scene.display();
    match mask(views, &args.data, &folder) {
        Ok(note) => {
            printer.warning(format_args!(
                "{scene}: pixels that are black in the masks of its run ({}) are not compared, as in the run's report; \
                 --no-pixel-masks compares all",
                folder.display()
            ));
            note.iter().for_each(|note| printer.warning(note));
        }
        Err(error) => printer.warning(format_args!(
            "{error}: the masks of the run that {scene} lies in are not used, so its report may have other figures"
        )),
    }
}

pub(super) fn run(args: &EvalArgs, device_args: &DeviceArgs, printer: &Printer) -> Result<(), CliError> {
    let opened = OpenedScene::open_to_measure(&args.scene, args.host_memory.of_scenes(), printer)?;
    args.json.create_folder()?;
    let weights = args.lpips.weights();
    let lpips = weights.as_ref().ok().map(|path| args.lpips.load(path)).transpose()?;
    let views = views_to_compare(args, printer)?;
    let pictures = args.out.as_deref().map(|folder| Pictures::new(folder, &views, &args.data)).transpose()?;
    let options = args.memory.apply(args.look.options(opened.scene()));
    let place = args.scene.display();
    let gpu = device::open(device_args.choice())?;
    args.memory.limit(&gpu);
    let mut renderer = Renderer::new(&gpu).map_err(failed_to_render(&place))?;
    let is_empty = opened.scene().expanded_len() == 0;
    let fail = |error| CliError::msg(format!("{place}: {error}"));
    let scene = opened.upload(&gpu, &renderer, &options).map_err(fail)?;
    let coarser = Cell::new(CoarserViews::default());
    let scene = Followed { scene, place: place.to_string(), left_to_count: views.len(), counted: &coarser };
    let mut progress = printer.progress("eval", views.len() as u64);
    let extras = Extras { lpips: lpips.as_ref(), exposures: args.exposures };
    let (mut visible, mut files) = (0, pictures.iter().flat_map(|pictures| &pictures.files));
    let report = evaluate::<CliError>(&mut renderer, scene, &views, args.width, &options, extras, |view| {
        visible += view.visible;
        files.next().map(|file| write_picture(file, view.pair)).transpose()?;
        progress.step(format_args!("{} {:.2} dB", view.name, view.metrics.psnr));
        Ok(())
    })?;
    drop(progress);
    if let Some(what) = coarser.get().warning() {
        printer.warning(format_args!("{place}: {what}"));
    }
    if visible == 0 && !is_empty {
        let near = options.near;
        printer.warning(format_args!("{place}: nothing is visible from these views (near is {near}; see --near)"));
    }
    // Printed last: next to the table that lacks the numbers, and not before an error that makes it irrelevant.
    if let Err(reason) = &weights {
        printer.warning(format_args!("LPIPS is left out: {reason}"));
    }
    if let Some(lpips) = lpips.filter(|_| report.mean.lpips.is_none()) {
        let net = lpips.net().name();
        printer.warning(format_args!("LPIPS has no mean: some pictures are too small for {net}"));
    }
    device::check_validation(&gpu)?;
    if !args
        .json
        .write(&EvalOutput { report: &report, coarser_views: NonZeroUsize::new(coarser.get().count()) }, printer)?
    {
        return Ok(());
    }
    print_table(&report, printer);
    if let Some(folder) = &args.out {
        printer.line(format_args!("{} pictures in {}", report.views.len(), folder.display()));
    }
    Ok(())
}

fn print_table(report: &EvalReport, printer: &Printer) {
    let mut table = Table::default();
    let exposed = report.mean.psnr_exposed.is_some();
    let head = ["view", "PSNR, dB", "SSIM", "LPIPS"].into_iter().chain(exposed.then_some("with exposure, dB"));
    table.row(head.map(String::from).collect::<Vec<_>>());
    let mean = report.mean.named("mean");
    for view in report.views.iter().chain([&mean]) {
        let Metrics { psnr, ssim, lpips, psnr_exposed } = view.metrics;
        let lpips = lpips.map_or("-".into(), |v| format!("{v:.4}"));
        let row = [view.name.clone(), format!("{psnr:.2}"), format!("{ssim:.4}"), lpips];
        table.row(row.into_iter().chain(psnr_exposed.map(|v| format!("{v:.2}"))).collect::<Vec<_>>());
    }
    printer.line(table);
}

/// Writes rendering, photo and amplified difference side by side, 8 bits per channel.
fn write_picture(path: &Path, pair: &PicturePair) -> Result<(), CliError> {
    let (width, height) = (pair.width(), pair.height());
    let byte = |v: f32| (v.clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
    let mut pixels = Vec::with_capacity(9 * pair.render().len());
    for (render, target) in pair.render().chunks(width as usize).zip(pair.target().chunks(width as usize)) {
        pixels.extend(render.as_flattened().iter().map(|&v| byte(v)));
        pixels.extend(target.as_flattened().iter().map(|&v| byte(v)));
        let both = render.as_flattened().iter().zip(target.as_flattened());
        pixels.extend(both.map(|(r, t)| byte(DIFFERENCE_GAIN * (r - t).abs())));
    }
    Ok(write_png(path, &pixels, (3 * width, height))?)
}
