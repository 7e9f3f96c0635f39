//! Renders a .ply into an image of a Vulkan program of your own, here a headless one that writes it to a .png.
//!
//!     cargo run --release --example into_your_image -- cloud.ply picture.png

#![allow(clippy::print_stdout, reason = "an example says what it did")]

#[path = "headless/mod.rs"]
mod headless;

use std::path::Path;

use ash::{Entry, vk};
use headless::Headless;
use instgs_io::load_scene;
use instgs_io::picture_png::write_png;
use instgs_vk::gpu::Gpu;
use instgs_vk::render::{Arrived, ImageFrames, RenderOptions, Renderer};
use instgs_vk::scene::trajectory::Orbit;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().collect();
    let [_, cloud, png] = &args[..] else { return Err("usage: into_your_image CLOUD.ply PICTURE.png".into()) };
    let scene = load_scene(Path::new(cloud))?.scene;
    let (width, height) = (1280, 720);
    let camera = Orbit::around(&scene, None).cameras(1, (width, height)).remove(0);
    // SAFETY: one thread uses the queue; the device has what is required (see `Headless::new`); every command buffer is
    // submitted once and signals what it must; image, device and instance outlive what is made from them.
    unsafe {
        let entry = Entry::load()?;
        let app = vk::ApplicationInfo::default().api_version(vk::API_VERSION_1_3);
        let instance = entry.create_instance(&vk::InstanceCreateInfo::default().application_info(&app), None)?;
        let physical = *instance.enumerate_physical_devices()?.first().ok_or("no Vulkan device")?;
        let yours = Headless::new(&entry, &instance, physical, [width, height], vk::Format::R8G8B8A8_UNORM)?;
        {
            let gpu = Gpu::from_raw(yours.raw.clone())?;
            let mut renderer = Renderer::new(&gpu)?;
            let on_device = renderer.upload(&scene)?;
            let mut frames = ImageFrames::new(&renderer, 1)?;
            loop {
                let (commands, options) = (yours.begin()?, RenderOptions::of(&scene));
                let to = &yours.target;
                let signal = renderer.record_into_image(&mut frames, commands, &on_device, &camera, &options, to)?;
                yours.submit(signal)?;
                // A program with a frame loop polls, and records the next frame meanwhile.
                if let Some(Arrived::Complete(stats)) = frames.wait(&mut renderer)? {
                    println!("{}: {} of {} Gaussians", gpu.caps().name, stats.visible, scene.expanded_len());
                    break;
                }
            }
        }
        let rgb: Vec<u8> = yours.bytes()?.chunks_exact(4).flat_map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect();
        write_png(Path::new(png), &rgb, (width, height))?;
        yours.destroy();
        instance.destroy_instance(None);
    }
    Ok(())
}
