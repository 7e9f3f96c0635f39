//! Writes a plain cloud of N Gaussians in a unit ball and a 1920x1080 camera, to see what a device holds.
//!
//!     cargo run --release --example plain_cloud -- out/plain 1000000 3
//!     instgs-vk render --scene out/plain/cloud.ply --camera out/plain/camera.json --out out/plain

use std::path::PathBuf;

use glam::DVec3;
use instgs_io::camera_file::write_cameras;
use instgs_io::ply::write_ply;
use instgs_vk::math::rng::Rng;
use instgs_vk::scene::gaussians::sh_coefficients;
use instgs_vk::scene::{Camera, Gaussians, PixelFilter};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut args = std::env::args().skip(1);
    let usage = "usage: plain_cloud OUT COUNT SH_DEGREE";
    let out = PathBuf::from(args.next().ok_or(usage)?);
    let count: usize = args.next().ok_or(usage)?.parse()?;
    let degree: u32 = args.next().ok_or(usage)?.parse()?;
    std::fs::create_dir_all(&out)?;
    let mut rng = Rng::new(1);
    let mut cloud = Gaussians::with_capacity(degree, count);
    for _ in 0..count {
        let mean = rng.unit_vector() * rng.uniform().cbrt();
        cloud.means.push(mean.as_vec3().to_array());
        cloud.quats.push(rng.rotation_quat().map(|q| q as f32));
        cloud.log_scales.push([0; 3].map(|_| rng.range(-7.0, -5.5) as f32));
        cloud.opacity_logits.push(rng.range(-1.0, 2.0) as f32);
        for c in 0..sh_coefficients(degree) {
            let amplitude = if c == 0 { 1.0 } else { 0.1 };
            cloud.sh.push([0; 3].map(|_| (amplitude * rng.normal()) as f32));
        }
    }
    write_ply(&out.join("cloud.ply"), &cloud, PixelFilter::default())?;
    let eye = DVec3::new(0.0, 0.0, -2.2);
    let camera = Camera::look_at("front", eye, DVec3::ZERO, DVec3::NEG_Y, 0.9, (1920, 1080));
    write_cameras(&out.join("camera.json"), &[camera])?;
    Ok(())
}
