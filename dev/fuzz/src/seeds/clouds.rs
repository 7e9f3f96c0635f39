//! Clouds of Gaussians, and of points.

use instgs_io::{IoError, glb, ply, sog, spz, write_glb};
use instgs_vk::scene::gaussians::sh_coefficients;
use instgs_vk::scene::{Gaussians, PixelFilter};

use crate::path;

/// A cloud of `n` Gaussians.
pub fn cloud(sh_degree: u32, n: usize) -> Gaussians {
    let v = |i: usize| (i % 13) as f32 * 0.1 - 0.5;
    Gaussians {
        sh_degree,
        means: (0..n).map(|i| [v(i), v(i + 3), v(i + 7)]).collect(),
        quats: (0..n).map(|i| [1.0, v(i), v(i + 1), v(i + 2)]).collect(),
        log_scales: (0..n).map(|i| [v(i) - 4.0; 3]).collect(),
        opacity_logits: (0..n).map(v).collect(),
        sh: (0..n * sh_coefficients(sh_degree)).map(|i| [v(i), v(i + 5), v(i + 9)]).collect(),
    }
}

/// A PLY of INRIA's layout, of three Gaussians.
pub fn ply() -> Vec<u8> {
    ply::ply_bytes(&cloud(1, 3), PixelFilter::default())
}

/// The same in text, of two Gaussians, and an element that is not read.
pub const ASCII_PLY: &str = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n\
    property float f_dc_0\nproperty float f_dc_1\nproperty float f_dc_2\nproperty float opacity\nproperty float scale_0\n\
    property float scale_1\nproperty float scale_2\nproperty float rot_0\nproperty float rot_1\nproperty float rot_2\n\
    property float rot_3\nelement face 1\nproperty list uchar int v\nend_header\n1 2 3 4 5 6 7 8 9 10 1 0 0 0\n\
    1 2 3 4 5 6 7 8 9 10 1 0 0 0\n3 0 1 1\n";

/// A whole packed PLY of one chunk and three splats.
pub fn packed_ply() -> Vec<u8> {
    let mut out = String::from("ply\nformat binary_little_endian 1.0\nelement chunk 1\n");
    for side in ["min", "max"] {
        for name in ["x", "y", "z", "scale_x", "scale_y", "scale_z"] {
            out += &format!("property float {side}_{name}\n");
        }
    }
    out += "element vertex 3\n";
    for name in ["position", "rotation", "scale", "color"] {
        out += &format!("property uint packed_{name}\n");
    }
    let mut out = (out + "end_header\n").into_bytes();
    (0..12).for_each(|i| out.extend_from_slice(&(i as f32).to_le_bytes()));
    (0..12u32).for_each(|i| out.extend_from_slice(&(i * 0x1234_5679).to_le_bytes()));
    out
}

/// An SPZ of version 4 as this project writes it, of five splats.
pub fn spz() -> Result<Vec<u8>, IoError> {
    spz::spz_bytes(&cloud(1, 5), false, path())
}

/// A version 3 SPZ file of `n` splats of SH degree 0, without gzip.
pub fn spz_v3(n: u32) -> Vec<u8> {
    let mut out = b"NGSP".to_vec();
    for word in [3, n, u32::from_le_bytes([0, 12, 0, 0])] {
        out.extend_from_slice(&word.to_le_bytes());
    }
    out.extend((0..20 * n).map(|i| i as u8));
    out
}

/// A version 4 SPZ file of `n` splats of SH degree 0, all zero bytes, written by this code alone.
pub fn spz_v4(n: u32) -> std::io::Result<Vec<u8>> {
    let plain = [9, 1, 3, 3, 4].map(|b| vec![0; b * n as usize]);
    spz_v4_of([n, u32::from_le_bytes([0, 12, 0, 5])], &plain)
}

/// A version 4 SPZ file: number of splats and the word after it, and its streams unpacked.
pub fn spz_v4_of(words: [u32; 2], plain: &[Vec<u8>]) -> std::io::Result<Vec<u8>> {
    let mut out = b"NGSP".to_vec();
    for word in [4, words[0], words[1], 32, 0, 0, 0] {
        out.extend_from_slice(&word.to_le_bytes());
    }
    let mut body = Vec::new();
    for plain in plain {
        let stream = zstd::bulk::compress(plain, 1)?;
        out.extend_from_slice(&(stream.len() as u64).to_le_bytes());
        out.extend_from_slice(&(plain.len() as u64).to_le_bytes());
        body.extend(stream);
    }
    out.extend(body);
    Ok(out)
}

/// The same file with an extension that says that the axes are right-down-front, and an unknown one.
pub fn spz_v4_with_axes(n: u32) -> std::io::Result<Vec<u8>> {
    let mut plain = spz_v4(n)?;
    let records: Vec<u8> = [0xADBE_0003u32, 4, 6, 0x1234_0001, 0].iter().flat_map(|word| word.to_le_bytes()).collect();
    (plain[14], plain[16]) = (2, 32 + records.len() as u8);
    Ok([&plain[..32], &records[..], &plain[32..]].concat())
}

/// A SOG as this project writes it, of five splats.
pub fn sog() -> Result<Vec<u8>, IoError> {
    sog::sog_bytes(&cloud(1, 5), false, path())
}

/// A `.glb` of a scene with a template, offsets and a background.
pub fn glb() -> Result<Vec<u8>, crate::SeedError> {
    let folder = tempfile::tempdir()?;
    let file = folder.path().join("x.glb");
    write_glb(&file, &super::scenes::scene(), glam::DVec3::NEG_Y)?;
    let bytes = std::fs::read(file)?;
    glb::parse_glb(&bytes, path())?;
    Ok(bytes)
}

/// Two points in text.
pub const POINTS_PLY: &str = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n\
    property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n1 2 3 4 5 6\n7 8 9 10 11 12\n";

/// Two points, big-endian.
pub fn points_ply_big_endian() -> Vec<u8> {
    let mut out = POINTS_PLY.replace("ascii", "binary_big_endian").into_bytes();
    out.truncate(out.len() - b"1 2 3 4 5 6\n7 8 9 10 11 12\n".len());
    out.extend_from_slice(&[64; 2 * 15]);
    out
}

/// Two points of COLMAP, with their tracks.
pub fn colmap_points_bin() -> Vec<u8> {
    let mut out = 2u64.to_le_bytes().to_vec();
    for id in [1u64, 2] {
        out.extend_from_slice(&id.to_le_bytes());
        [1.0f64, 2.0, 3.0].iter().for_each(|v| out.extend_from_slice(&v.to_le_bytes()));
        out.extend_from_slice(&[9; 3]);
        out.extend_from_slice(&0.5f64.to_le_bytes());
        out.extend_from_slice(&id.to_le_bytes());
        (0..id).for_each(|_| out.extend_from_slice(&[0; 8]));
    }
    out
}

/// The same in text.
pub const COLMAP_POINTS: &str = "# id\n1 0.5 0 1 10 20 30 0.1 1 2\n2 0.5 0 1 10 20 30 0.1\n";
