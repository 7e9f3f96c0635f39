//! Clouds of Gaussians, and of points.

use std::path::Path;

use instgs_io::{glb, ply, point_cloud, sog, splat, spz};
use instgs_vk::scene::PointCloud;

use crate::seeds::clouds as files;
use crate::{Seed, SeedError, Target, must, path, properties, repair, taken};

pub(super) const TARGETS: &[Target] = &[
    Target { name: "ply", seeds: ply_seeds, repair: None, read: read_ply },
    Target { name: "spz", seeds: spz_seeds, repair: None, read: read_spz },
    Target { name: "spz_streams", seeds: stream_seeds, repair: None, read: read_spz_streams },
    Target { name: "sog", seeds: sog_seeds, repair: Some(|bytes| repair::zip(bytes)), read: read_sog },
    Target { name: "glb", seeds: glb_seeds, repair: None, read: read_glb },
    Target { name: "splat", seeds: splat_seeds, repair: None, read: read_splat },
    Target { name: "points_ply", seeds: points_ply_seeds, repair: None, read: read_points_ply },
    Target { name: "points_bin", seeds: points_bin_seeds, repair: None, read: read_points_bin },
    Target { name: "points_txt", seeds: points_txt_seeds, repair: None, read: read_points_txt },
];

fn ply_seeds() -> Result<Vec<Seed>, SeedError> {
    let ascii = Seed::new("ascii", files::ASCII_PLY);
    Ok(vec![Seed::new("binary", files::ply()), ascii, Seed::new("packed", files::packed_ply())])
}

fn read_ply(bytes: &[u8], _: &Path) -> bool {
    let cloud = taken(ply::parse_ply(bytes, path()));
    cloud.map(|cloud| properties::cloud(&cloud.gaussians)).is_some()
}

fn spz_seeds() -> Result<Vec<Seed>, SeedError> {
    Ok(vec![
        Seed::new("own", files::spz()?),
        Seed::new("v3", files::spz_v3(5)),
        Seed::new("v4", files::spz_v4(6)?),
        Seed::new("v4 with axes", files::spz_v4_with_axes(6)?),
    ])
}

fn read_spz(bytes: &[u8], _: &Path) -> bool {
    let cloud = taken(spz::parse_spz(bytes, path()));
    cloud.map(|cloud| properties::cloud(&cloud.gaussians)).is_some()
}

fn stream_seeds() -> Result<Vec<Seed>, SeedError> {
    Ok(vec![Seed::new("degree 1", (0..60).collect::<Vec<u8>>()), Seed::new("degree 0", [3, 0, 12, 0, 1, 2])])
}

/// The streams of a file of version 4, unpacked: splats, degree, fraction bits and flags, a byte each; then what the streams repeat.
fn read_spz_streams(bytes: &[u8], folder: &Path) -> bool {
    let Some((&[splats, degree, fraction, flags], body)) = bytes.split_first_chunk() else { return false };
    let degree = degree % 6;
    let sh = 3 * ((usize::from(degree) + 1).pow(2) - 1);
    let mut values = body.iter().copied().cycle();
    let mut stream =
        |width: usize| -> Vec<u8> { (0..width * usize::from(splats)).map(|_| values.next().unwrap_or(0)).collect() };
    let streams: Vec<_> = [9, 1, 3, 3, 4, sh].map(&mut stream).into_iter().filter(|plain| !plain.is_empty()).collect();
    let word = u32::from_le_bytes([degree, fraction, flags, streams.len() as u8]);
    let file = must(files::spz_v4_of([u32::from(splats), word], &streams), "zstd");
    read_spz(&file, folder)
}

fn sog_seeds() -> Result<Vec<Seed>, SeedError> {
    Ok(vec![Seed::new("own", files::sog()?)])
}

fn read_sog(bytes: &[u8], _: &Path) -> bool {
    let cloud = taken(sog::parse_sog(bytes, path()));
    cloud.map(|cloud| properties::cloud(&cloud.gaussians)).is_some()
}

fn glb_seeds() -> Result<Vec<Seed>, SeedError> {
    Ok(vec![Seed::new("own", files::glb()?)])
}

fn read_glb(bytes: &[u8], folder: &Path) -> bool {
    let scene = taken(glb::parse_glb(bytes, path()));
    scene
        .map(|glb| {
            must(glb.scene.validate(), "a scene that was read is inconsistent");
            properties::scene(glb.scene, folder);
        })
        .is_some()
}

fn splat_seeds() -> Result<Vec<Seed>, SeedError> {
    Ok(vec![Seed::new("two", [77; 64])])
}

fn read_splat(bytes: &[u8], _: &Path) -> bool {
    taken(splat::parse_splat(bytes, path())).map(|cloud| properties::cloud(&cloud)).is_some()
}

fn points_ply_seeds() -> Result<Vec<Seed>, SeedError> {
    Ok(vec![Seed::new("binary", files::points_ply_big_endian()), Seed::new("ascii", files::POINTS_PLY)])
}

fn checked(points: Option<PointCloud>) -> bool {
    points.map(|points| assert_eq!(points.positions.len(), points.colors.len())).is_some()
}

fn read_points_ply(bytes: &[u8], _: &Path) -> bool {
    checked(taken(point_cloud::parse_points_ply(bytes, path())))
}

fn points_bin_seeds() -> Result<Vec<Seed>, SeedError> {
    Ok(vec![Seed::new("two", files::colmap_points_bin())])
}

fn read_points_bin(bytes: &[u8], _: &Path) -> bool {
    checked(taken(point_cloud::parse_points_bin(bytes, path())))
}

fn points_txt_seeds() -> Result<Vec<Seed>, SeedError> {
    Ok(vec![Seed::new("two", files::COLMAP_POINTS)])
}

fn read_points_txt(bytes: &[u8], _: &Path) -> bool {
    checked(taken(point_cloud::parse_points_txt(bytes, path())))
}
