//! The examples that embed the engine, run as programs, with the validation layers loaded from outside.

use std::path::Path;
use std::process::Command;

use instgs_io::write_ply;
use instgs_samples::sample;
use instgs_vk::scene::PixelFilter;

use crate::common::program::{built, skips_gpu};

/// Runs an example on a cloud and returns its picture's pixels. The layers print what they find; it must be nothing.
fn pixels_of(example: &str, cloud: &Path, picture: &Path) -> image::RgbImage {
    let mut command = Command::new(built(&format!("examples/{example}")));
    command.arg(cloud).arg(picture).env("VK_INSTANCE_LAYERS", "VK_LAYER_KHRONOS_validation");
    let output = command.output().unwrap();
    let said = [output.stdout, output.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned()).concat();
    assert!(output.status.success(), "{example}: {said}");
    assert!(said.contains("Gaussians") && !said.contains("Validation"), "{example}: {said}");
    image::open(picture).unwrap().into_rgb8()
}

#[test]
fn both_draw_the_same_picture() {
    if skips_gpu() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let cloud = folder.path().join("cloud.ply");
    write_ply(&cloud, &sample(3, 200), PixelFilter::default()).unwrap();
    let [one, yours] = ["one_picture", "into_your_image"]
        .map(|name| pixels_of(name, &cloud, &folder.path().join(format!("{name}.png"))));
    assert_eq!(one.dimensions(), (1280, 720));
    assert!(one.pixels().any(|p| p.0.iter().any(|&v| v > 30)), "there is something to see");
    let largest = one.iter().zip(yours.iter()).map(|(a, b)| a.abs_diff(*b)).max();
    // Packed on the device in one, on the host in the other: they may round differently.
    assert!(largest <= Some(1), "{largest:?}");
}
