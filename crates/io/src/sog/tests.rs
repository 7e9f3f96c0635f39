//! `.sog` files as a whole: what is written is read, and damage is an error.

use std::path::Path;

use instgs_samples::sample;
use instgs_vk::math::morton::morton_order;
use instgs_vk::math::rng::Rng;

use super::archive::{Archive, stored};
use super::meta::META;
use super::*;
use crate::IoError;

type Outcome = Result<(), Box<dyn std::error::Error>>;

const NAMES: [&str; 8] = [
    META,
    "means_l.webp",
    "means_u.webp",
    "scales.webp",
    "quats.webp",
    "sh0.webp",
    "shN_centroids.webp",
    "shN_labels.webp",
];

fn path() -> &'static Path {
    Path::new("x.sog")
}

/// The files of an archive, with one of them changed.
fn changed(bytes: &[u8], name: &str, change: impl Fn(&mut Vec<u8>)) -> Result<Vec<u8>, IoError> {
    let archive = Archive::parse(bytes, path())?;
    let mut files = Vec::new();
    for file in NAMES {
        let Ok(contents) = archive.file(file) else { continue };
        let mut contents = contents.into_owned();
        if file == name {
            change(&mut contents);
        }
        files.push((file, contents));
    }
    stored(&files).ok_or_else(|| IoError::new(path(), "too large"))
}

/// An archive whose `meta.json` has another text in place of one.
fn with_meta(bytes: &[u8], from: &str, to: &str) -> Result<Vec<u8>, IoError> {
    changed(bytes, META, |meta| {
        let text = String::from_utf8_lossy(meta).into_owned();
        assert!(text.contains(from), "{from}");
        *meta = text.replacen(from, to, 1).into_bytes();
    })
}

fn error(bytes: &[u8]) -> String {
    parse_sog(bytes, path()).err().map(|e| e.to_string()).unwrap_or_default()
}

fn normalised(q: [f32; 4]) -> [f64; 4] {
    let n = q.iter().map(|&v| f64::from(v).powi(2)).sum::<f64>().sqrt();
    q.map(|v| f64::from(v) / n)
}

/// Half a step of 16 bits in the logarithm, which a coordinate of 4.8 has 5.8 times; values of a range of 1 in codebooks of
/// 256, a few of whose cells are twice as wide as the average; bytes of quaternions and opacities.
#[test]
fn what_is_written_is_read_within_the_quantisation() -> Outcome {
    for degree in 0..=3 {
        let cloud = sample(degree, 300);
        let bytes = sog_bytes(&cloud, degree == 1, path())?;
        assert_eq!(bytes, sog_bytes(&cloud, degree == 1, path())?, "the same bytes each time");
        let read = parse_sog(&bytes, path())?;
        assert_eq!((read.antialias, read.file_bytes), (degree == 1, bytes.len() as u64));
        let back = read.gaussians;
        assert_eq!((back.len(), back.sh_degree, back.wrong_length()), (300, degree, None));
        for (j, i) in morton_order(&cloud.means).into_iter().map(|i| i as usize).enumerate() {
            let near = |a: &[f32], b: &[f32], tolerance: f32, what: &str| {
                assert!(a.iter().zip(b).all(|(x, y)| (x - y).abs() <= tolerance), "{what} of {i}: {a:?} {b:?}");
            };
            near(&back.means[j], &cloud.means[i], 1.7e-4, "mean");
            near(&back.log_scales[j], &cloud.log_scales[i], 0.01, "scale");
            near(back.sh_of(j).as_flattened(), cloud.sh_of(i).as_flattened(), 0.01, "sh");
            let (a, b) = (normalised(back.quats[j]), normalised(cloud.quats[i]));
            assert!(a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>().abs() > 1.0 - 5e-5, "quat of {i}");
            let sigmoid = |l: f32| 1.0 / (1.0 + (-l).exp());
            assert!((sigmoid(back.opacity_logits[j]) - sigmoid(cloud.opacity_logits[i])).abs() < 0.51 / 255.0);
        }
    }
    Ok(())
}

/// More Gaussians than palette entries: coefficients are those of similar ones.
#[test]
fn a_palette_keeps_similar_coefficients() -> Outcome {
    let mut rng = Rng::new(8);
    let mut cloud = sample(2, 3000);
    let kinds: Vec<[f32; 3]> = (0..40 * 8).map(|_| std::array::from_fn(|_| 0.2 * rng.normal() as f32)).collect();
    for i in 0..3000 {
        let kind = rng.index(40);
        for c in 0..8 {
            cloud.sh[9 * i + 1 + c] = kinds[8 * kind + c].map(|v| v + 0.01 * rng.normal() as f32);
        }
    }
    let back = parse_sog(&sog_bytes(&cloud, false, path())?, path())?.gaussians;
    let mut squares = 0.0;
    for (j, i) in morton_order(&cloud.means).into_iter().enumerate() {
        let pairs = back.sh_of(j)[1..].as_flattened().iter().zip(cloud.sh_of(i as usize)[1..].as_flattened());
        squares += pairs.map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>();
    }
    let rms = (squares / (3000.0 * 24.0)).sqrt();
    assert!(rms < 0.011, "{rms}");
    Ok(())
}

#[test]
fn one_gaussian_none_and_many_values() -> Outcome {
    for degree in [0, 3] {
        let cloud = sample(degree, 1);
        let back = parse_sog(&sog_bytes(&cloud, false, path())?, path())?.gaussians;
        let near = |a: &[f32], b: &[f32]| a.iter().zip(b).all(|(x, y)| (x - y).abs() < 1e-5);
        assert!(near(&back.means[0], &cloud.means[0]), "{:?} {:?}", back.means, cloud.means);
        assert_eq!((&back.log_scales, &back.sh), (&cloud.log_scales, &cloud.sh));
    }
    let none = sog_bytes(&Gaussians::default(), false, path()).unwrap_err().to_string();
    assert!(none.contains("no empty clouds"), "{none}");
    let mut cloud = sample(0, 2);
    cloud.means[1][2] = f32::INFINITY;
    assert!(sog_bytes(&cloud, false, path()).is_err_and(|e| e.to_string().contains("Gaussian 1")));
    Ok(())
}

#[test]
fn folders_and_other_writers_fields_are_read() -> Outcome {
    let cloud = sample(1, 20);
    let bytes = sog_bytes(&cloud, true, path())?;
    let whole = parse_sog(&bytes, path())?;
    for (from, to) in [("\"antialias\":true,", ""), ("\"model\":\"antialiased\",", ""), ("{", "{\"new\":[1,2],")] {
        assert!(parse_sog(&with_meta(&bytes, from, to)?, path())?.antialias, "{from}");
    }
    let folder = tempfile::tempdir()?;
    let archive = Archive::parse(&bytes, path())?;
    for name in NAMES {
        std::fs::write(folder.path().join(name), archive.file(name)?)?;
    }
    assert!(is_unpacked(folder.path()) && is_unpacked(&folder.path().join(META)) && !is_unpacked(path()));
    for at in [folder.path().to_owned(), folder.path().join(META)] {
        let read = read_sog(&at)?;
        assert!(read.file_bytes > 0);
        assert_eq!(read.gaussians, whole.gaussians);
    }
    std::fs::remove_file(folder.path().join("quats.webp"))?;
    assert!(read_sog(folder.path()).is_err_and(|e| e.to_string().contains("quats.webp")));
    let meta = String::from_utf8_lossy(&archive.file(META)?).replace("quats.webp", "../quats.webp");
    std::fs::write(folder.path().join(META), meta)?;
    assert!(read_sog(folder.path()).is_err_and(|e| e.to_string().contains("not in its folder")));
    Ok(())
}

#[test]
fn errors_name_what_is_wrong() -> Outcome {
    let bytes = sog_bytes(&sample(1, 20), false, path())?;
    for (from, to, want) in [
        ("\"version\":2", "\"version\":3", "version: SOG version 3"),
        ("\"version\":2,", "", "SOG version 1, only 2 is read; convert it"),
        ("\"count\":20", "\"count\":65", "has 8x4 pixels, fewer than 65"),
        ("\"count\":20", "\"count\":4000000000", "claims 4000000000 Gaussians"),
        ("\"bands\":1", "\"bands\":2", "is 192 pixels wide, not 512"),
        ("\"bands\":1", "\"bands\":4", "SH degree 4 is not known"),
        ("quats.webp", "absent.webp", "absent.webp: is not in the archive"),
        ("\"shN\":{\"count\":20", "\"shN\":{\"count\":3", "but there are 3"),
        ("\"codebook\":[", "\"codebook\":[],\"old\":[", "scales.codebook: has 0 values"),
        ("\"mins\":[", "\"mins\":[\"a\",", "cannot be used"),
    ] {
        let text = error(&with_meta(&bytes, from, to)?);
        assert!(text.contains(want) && !text.contains('\n'), "{want}: {text}");
    }
    let other = changed(&bytes, "quats.webp", |file| *file = b"no image".to_vec())?;
    assert!(error(&other).contains("x.sog: quats.webp: is no WebP image"), "{}", error(&other));
    // More pixels than twenty Gaussians need, in a file that could hold them.
    let large = super::image::Image::zeros(129, 128, true).encode(path())?;
    let padded = changed(&bytes, META, |meta| meta.extend([b' '; 4096]))?;
    let large = changed(&padded, "quats.webp", |file| file.clone_from(&large))?;
    assert!(error(&large).contains("quats.webp: claims 129x128 pixels, where at most 16464"), "{}", error(&large));
    Ok(())
}

#[test]
fn damage_is_an_error_or_another_cloud() -> Outcome {
    let bytes = sog_bytes(&sample(1, 5), false, path())?;
    assert!((0..bytes.len()).all(|end| parse_sog(&bytes[..end], path()).is_err()));
    // Damage within the entries, whose checksums are those of the damaged ones.
    let mut rng = Rng::new(4);
    for round in 0..1500 {
        let name = NAMES[round % NAMES.len()];
        let (place, bit, more) = (rng.uniform(), rng.index(8), rng.uniform());
        let damaged = changed(&bytes, name, |file| {
            let length = file.len() as f64;
            for at in [place * length, more * length] {
                if let Some(byte) = file.get_mut(at as usize) {
                    *byte ^= 1 << bit;
                }
            }
        })?;
        if let Ok(read) = parse_sog(&damaged, path()) {
            assert_eq!(read.gaussians.wrong_length(), None);
        }
    }
    Ok(())
}

/// Steps are even ones of logarithms: in a scene of kilometres they are larger than small Gaussians, and that is told.
#[test]
fn what_rounding_moves_by_more_than_its_size_is_counted() -> Outcome {
    let folder = tempfile::tempdir()?;
    let file = folder.path().join("city.sog");
    let mut cloud = sample(0, 400);
    let mut rng = Rng::new(9);
    cloud.means.iter_mut().for_each(|mean| *mean = [0; 3].map(|_| rng.range(-1000.0, 1000.0) as f32));
    for (log_scale, moves) in [(-3.0, true), (2.0, false)] {
        cloud.log_scales.iter_mut().for_each(|scales| *scales = [log_scale, -4.0, -4.0]);
        let written = write_sog(&file, &cloud, false)?;
        assert_eq!((written.gaussians, written.bytes), (400, std::fs::metadata(&file)?.len()));
        assert_eq!(written.moved.gaussians > 0, moves, "{:?}", written.moved);
        let read = read_sog(&file)?.gaussians;
        let order = morton_order(&cloud.means);
        let moved = order.iter().zip(&read.means).map(|(&i, mean)| {
            let was = cloud.means[i as usize];
            (0..3).map(|k| f64::from(mean[k] - was[k]).powi(2)).sum::<f64>().sqrt()
        });
        let beyond: Vec<f64> = moved.filter(|moved| *moved > f64::from(log_scale).exp()).collect();
        assert_eq!(beyond.len(), written.moved.gaussians);
        let farthest = beyond.iter().fold(0.0, |most: f64, &v| most.max(v));
        // Positions are read as f32.
        assert!((farthest - written.moved.farthest).abs() < 1e-3, "{farthest} {:?}", written.moved);
    }
    Ok(())
}
