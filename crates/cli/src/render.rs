//! `instgs-vk render`: renders pictures of a scene.

use std::path::PathBuf;
use std::time::Instant;

use clap::Args;

use super::picture_files::{self, Format};
use instgs_console::args::{HostMemoryArgs, LodArgs, LookArgs, MemoryArgs, PrecisionArgs, ViewArgs, create_folder};
use instgs_console::device::{self, DeviceArgs};
use instgs_console::opened::{CoarserViews, FollowError, OpenedScene};
use instgs_console::{CliError, Printer, failed_to_render};
use instgs_vk::render::Renderer;

/// Renders a scene from cameras, a dataset's views, or a circle around it.
///
/// Every view becomes OUT/NAME.png (8-bit sRGB) or OUT/NAME.ktx2 (R32G32B32A32_SFLOAT: colour over the background, in the photos'
/// encoding, which is sRGB, and alpha = 1 - T). --depth adds OUT/NAME.depth.ktx2 (R32_SFLOAT, expected view depth), with either
/// format. NAME is the view's without the ending of an image; d.png and d.jpg keep theirs, as they would be one file.
#[derive(Args)]
#[command(after_help = "Examples:\n  \
    instgs-vk render --scene garden.ply --camera cameras.json --out pictures\n  \
    instgs-vk render --scene room.instgs --data room --split test --format ktx2 --depth --out pictures\n  \
    instgs-vk render --scene room.instgs --orbit 24 --size 640x360 --background 1,1,1 --out pictures")]
pub(super) struct RenderArgs {
    /// Scene to render: .instgs, .ply, .spz, .sog, .splat or .glb
    #[arg(long, value_name = "S")]
    scene: PathBuf,
    #[command(flatten)]
    views: ViewArgs,
    /// Folder for the pictures; created if necessary
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// File format of the colour pictures
    #[arg(long, value_enum, default_value = "png")]
    format: Format,
    /// Also write depth as NAME.depth.ktx2
    #[arg(long)]
    depth: bool,
    #[command(flatten)]
    look: LookArgs,
    #[command(flatten)]
    memory: MemoryArgs,
    #[command(flatten)]
    host_memory: HostMemoryArgs,
    #[command(flatten)]
    lod: LodArgs,
    #[command(flatten)]
    precision: PrecisionArgs,
    /// Report as JSON on stdout
    #[arg(long)]
    pub(super) json: bool,
}

#[derive(serde::Serialize)]
struct Rendered {
    scene: String,
    device: String,
    out: String,
    dropped_non_finite: usize,
    frames: Vec<RenderedFrame>,
}

#[derive(serde::Serialize)]
struct RenderedFrame {
    name: String,
    files: Vec<String>,
    resolution: [u32; 2],
    visible: u64,
    intersections: u64,
    slabs: u32,
    /// Depth layers or ranges; 1 = drawn in one piece.
    layers: u32,
    /// Pages of the background that were read for this view.
    pages_read: usize,
    /// Pages of the background that it wants and that had no room: coarser levels stand in for them.
    pages_without_room: usize,
    /// Time to render, milliseconds, while buffers still grow in the first frames; `bench` measures exactly.
    ms: f64,
}

pub(super) fn run(args: &RenderArgs, device_args: &DeviceArgs, printer: &Printer) -> Result<(), CliError> {
    let memory = args.host_memory.of_scenes();
    let opened = OpenedScene::open_warned(&args.scene, memory, printer)?;
    let options = args.memory.apply(args.precision.apply(args.lod.apply(args.look.options(opened.scene()))));
    let cameras = args.views.cameras(&args.scene, opened.scene(), options.near, printer)?;
    let names = picture_files::names(&cameras)?;
    if let Some(data) = args.views.data().filter(|_| args.format == Format::Png) {
        picture_files::check_not_of_data(&args.out, &names, data, std::iter::empty())?;
    }
    create_folder(&args.out)?;
    let gpu = device::open(device_args.choice())?;
    args.memory.limit(&gpu);
    let place = args.scene.display();
    let mut renderer = Renderer::new(&gpu).map_err(failed_to_render(&place))?;
    let (dropped_non_finite, is_empty) = (opened.dropped_non_finite(), opened.scene().expanded_len() == 0);
    let fail = |error: FollowError| CliError::msg(format!("{place}: {error}"));
    let mut scene = opened.upload(&gpu, &renderer, &options).map_err(fail)?;
    let mut progress = printer.progress("render", cameras.len() as u64);
    let mut frames = Vec::with_capacity(cameras.len());
    let mut views = CoarserViews::default();
    for (camera, name) in cameras.iter().zip(names) {
        let pages = scene.follow(camera, &options).map_err(fail)?;
        views.add(&pages);
        let start = Instant::now();
        let stats = renderer.render(scene.device(), camera, &options).map_err(failed_to_render(&place))?;
        let ms = 1e3 * start.elapsed().as_secs_f64();
        let picture = renderer.download().map_err(failed_to_render(&place))?;
        let files = picture_files::write(&args.out, &name, &picture, args.format, args.depth)?;
        progress.step(&files[0]);
        frames.push(RenderedFrame {
            name,
            files,
            resolution: [camera.width, camera.height],
            visible: stats.visible,
            intersections: stats.intersections,
            slabs: stats.slabs,
            layers: stats.layers,
            pages_read: pages.missing.len(),
            pages_without_room: pages.without_room,
            ms,
        });
    }
    drop(progress);
    if let Some(what) = views.warning() {
        printer.warning(format_args!("{place}: {what}, or an error (--lod)"));
    }
    if frames.iter().all(|frame| frame.visible == 0) && !is_empty {
        let near = options.near;
        printer.warning(format_args!("{place}: nothing is visible from these views (near is {near}; see --near)"));
    }
    device::check_validation(&gpu)?;
    if args.json {
        let report = Rendered {
            scene: place.to_string(),
            device: gpu.caps().name.clone(),
            out: args.out.display().to_string(),
            dropped_non_finite,
            frames,
        };
        return printer.json(&report);
    }
    let depth = if args.depth { ", each with a .depth.ktx2" } else { "" };
    printer.line(format_args!("{} pictures{depth} in {}", frames.len(), args.out.display()));
    Ok(())
}
