//! Renders a cloud of Gaussians (.ply) from outside to a picture (.png).
//!
//!     cargo run --release --example one_picture -- cloud.ply picture.png

#![allow(clippy::print_stdout, reason = "an example says what it did")]

use std::path::Path;

use instgs_io::load_scene;
use instgs_io::picture_png::write_png;
use instgs_vk::gpu::{Gpu, GpuOptions};
use instgs_vk::render::{RenderOptions, Renderer};
use instgs_vk::scene::trajectory::Orbit;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut args = std::env::args().skip(1);
    let usage = "usage: one_picture CLOUD.ply PICTURE.png";
    let (cloud, png) = (args.next().ok_or(usage)?, args.next().ok_or(usage)?);
    let scene = load_scene(Path::new(&cloud))?.scene;
    let camera = Orbit::around(&scene, None).cameras(1, (1280, 720)).remove(0);

    let gpu = Gpu::open(&GpuOptions::default())?;
    let mut renderer = Renderer::new(&gpu)?;
    let on_device = renderer.upload(&scene)?;
    let stats = renderer.render(&on_device, &camera, &RenderOptions::of(&scene))?;
    let picture = renderer.download()?;
    write_png(Path::new(&png), &picture.rgb8(), (picture.width, picture.height))?;
    println!("{}: {} of {} Gaussians", gpu.caps().name, stats.visible, scene.expanded_len());
    Ok(())
}
