//! Writes the scale test of the forward pass: a 50,000-Gaussian template with 10,000 instances of which a camera sees
//! about 20 (`many.instgs`), a scene of only the instances it sees (`few.instgs`), the camera, the field again with
//! offsets on 100 instances (`offsets.instgs`), and a thousand of its instances (`thousand.instgs`) with cameras that fly
//! over them and see about 10 (`flight.json`).
//!
//!     cargo run --release --example scale_scene -- out/scale
//!     instgs-vk bench --scene out/scale/many.instgs --against out/scale/few.instgs --camera out/scale/camera.json
//!     instgs-vk bench --scene out/scale/thousand.instgs --camera out/scale/flight.json --lod 1,2

use std::path::PathBuf;

use instgs_io::camera_file::write_cameras;
use instgs_io::save_scene;

#[path = "../tests/common/scale.rs"]
mod scale;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let out = PathBuf::from(std::env::args().nth(1).ok_or("usage: scale_scene OUT")?);
    std::fs::create_dir_all(&out)?;
    let many = scale::field(50_000);
    let camera = scale::camera((800, 640));
    let few = scale::seen_part(&many, &camera);
    save_scene(&out.join("many.instgs"), &many)?;
    save_scene(&out.join("few.instgs"), &few)?;
    save_scene(&out.join("offsets.instgs"), &scale::with_offsets(&many, 100))?;
    write_cameras(&out.join("camera.json"), &[camera])?;
    save_scene(&out.join("thousand.instgs"), &scale::thousand(&many))?;
    let flight = scale::flight(12, (320, 180));
    write_cameras(&out.join("flight.json"), &flight)?;
    let seen: Vec<usize> =
        flight.iter().map(|c| scale::seen_part(&scale::thousand(&many), c).instances.len()).collect();
    #[allow(clippy::print_stdout, reason = "an example talks to its user")]
    {
        println!("{} of {} instances are in view", few.instances.len(), many.instances.len());
        println!("along the flight: {seen:?} of 1000");
    }
    Ok(())
}
