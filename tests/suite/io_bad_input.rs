//! Damaged files: every reader must answer with an error or a valid value, quickly and without a panic.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::time::{Duration, Instant};

use instgs_fuzz::Target;
use instgs_fuzz::seeds::clouds::{
    ASCII_PLY, POINTS_PLY, cloud, colmap_points_bin, packed_ply, points_ply_big_endian, spz_v4,
};
use instgs_fuzz::seeds::data_sets::colmap_bin;
use instgs_fuzz::seeds::scenes::scene;
use instgs_io::{colmap, ktx2, ply, point_cloud, scene_file, scene_write, spz};
use instgs_vk::scene::PixelFilter;

type Outcome = Result<(), instgs_fuzz::SeedError>;

fn path() -> &'static Path {
    Path::new("damaged/transforms.json")
}

/// True for a value, false for an error, which must be one line.
fn done<T>(result: Result<T, instgs_io::IoError>) -> bool {
    if let Err(e) = &result {
        let text = e.to_string();
        assert!(!text.contains('\n') && text.len() < 2000, "{text}");
    }
    result.is_ok()
}

/// Runs a reader; a panic or a slow answer fails the test and says on what.
fn read(target: &Target, bytes: &[u8], what: &str, scratch: &Path) -> bool {
    let start = Instant::now();
    let read = catch_unwind(AssertUnwindSafe(|| (target.read)(bytes, scratch)));
    assert!(start.elapsed() < Duration::from_secs(2), "{what} takes {:?}", start.elapsed());
    read.unwrap_or_else(|_| panic!("{what} panics"))
}

/// Every seed of the fuzzed readers, cut after each of its bytes. Damage of other kinds is what `tests/fuzz` is for.
#[test]
fn truncation_at_every_byte() -> Outcome {
    let scratch = tempfile::tempdir()?;
    let mut seeds = 0;
    for target in instgs_fuzz::targets::all() {
        for seed in (target.seeds)()? {
            let (name, bytes) = (format!("{}, {}", target.name, seed.name), seed.bytes);
            let is_read =
                |n: usize| read(&target, &bytes[..n], &format!("{name}: the first {n} bytes"), scratch.path());
            // Not files, or one that is too large to stand here.
            if ["scene_values", "spz_streams", "weights"].contains(&target.name) {
                continue;
            }
            // A log of which the last line is cut off is read.
            assert!(is_read(bytes.len()), "{name}: the whole file is not read");
            let accepted: Vec<usize> = (0..bytes.len()).filter(|&n| is_read(n)).collect();
            let fine = match target.name {
                // 32 bytes a splat without a header: a cut between splats is a shorter file.
                "splat" => accepted == [0, 32],
                // Gaussians are complete before the face element that follows; numbers cut short are numbers.
                "ply" if seed.name == "ascii" => accepted.iter().all(|&n| n + 12 >= bytes.len()),
                "points_ply" if seed.name == "ascii" => accepted.iter().all(|&n| n + 2 >= bytes.len()),
                // All pixels are there; the checksum of the mark of the end is cut.
                "png" => accepted.iter().all(|&n| n + 4 >= bytes.len()),
                // Texts without count or end mark: cut between lines they are shorter files.
                "colmap_images_txt" | "colmap_cameras_txt" | "points_txt" => true,
                "events" | "config" | "settings" | "script" => true,
                _ => accepted.is_empty(),
            };
            assert!(fine, "{name}: {} bytes are read when cut to {accepted:?}", bytes.len());
            seeds += 1;
        }
    }
    assert!(seeds > 40, "{seeds}");
    Ok(())
}

/// `from` replaced by `to` in `bytes`, once.
fn replaced(bytes: &[u8], from: &[u8], to: &[u8]) -> Vec<u8> {
    let at = bytes.windows(from.len()).position(|w| w == from);
    assert!(at.is_some(), "the pattern is not in the file");
    let at = at.unwrap_or(0);
    [&bytes[..at], to, &bytes[at + from.len()..]].concat()
}

/// Peak resident memory of this process in KiB, where the system tells.
fn peak_kib() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    status.lines().find_map(|l| l.strip_prefix("VmHWM:"))?.trim().trim_end_matches("kB").trim().parse().ok()
}

#[test]
fn huge_counts_are_errors_without_large_allocations() -> Outcome {
    let before = peak_kib();
    let start = Instant::now();
    for count in [1u64 << 31, 1 << 62, u64::MAX] {
        let text = format!("element vertex {count}\n");
        for file in [ply::ply_bytes(&cloud(1, 3), PixelFilter::default()), packed_ply()] {
            assert!(!done(ply::parse_ply(&replaced(&file, b"element vertex 3\n", text.as_bytes()), path())));
        }
        assert!(!done(ply::parse_ply(&replaced(ASCII_PLY.as_bytes(), b"element vertex 2\n", text.as_bytes()), path())));
        for (list, none) in [("property list uint double v\n", false), ("", true)] {
            // An element before the vertices; without properties it has no bytes and any count of it is harmless.
            let extra = format!("element pre {count}\n{list}element vertex 3\n");
            let file = replaced(
                &ply::ply_bytes(&cloud(0, 3), PixelFilter::default()),
                b"element vertex 3\n",
                extra.as_bytes(),
            );
            assert_eq!(done(ply::parse_ply(&file, path())), none);
        }
        let (cameras, images) = colmap_bin();
        let with = |file: &[u8], at: usize| [&file[..at], &count.to_le_bytes(), &file[at + 8..]].concat();
        assert!(!done(colmap::parse_colmap_bin(&with(&cameras, 0), &images, path())));
        assert!(!done(colmap::parse_colmap_bin(&cameras, &with(&images, 0), path())));
        assert!(!done(colmap::parse_colmap_bin(&cameras, &with(&images, images.len() - 32), path())));
        assert!(!done(point_cloud::parse_points_bin(&with(&colmap_points_bin(), 0), path())));
        assert!(!done(point_cloud::parse_points_bin(&with(&colmap_points_bin(), 8 + 8 + 24 + 3 + 8), path())));
        for file in [points_ply_big_endian(), POINTS_PLY.into()] {
            let file = replaced(&file, b"element vertex 2\n", text.as_bytes());
            assert!(!done(point_cloud::parse_points_ply(&file, path())));
        }
        let shape = format!("[{count},3]");
        let file = replaced(&scene_write::scene_file_bytes(&scene(), path())?, b"[2, 3]", shape.as_bytes());
        assert!(!done(scene_file::parse_scene_file(&file, path())));
        let file = with(&scene_write::scene_file_bytes(&scene(), path())?, 0);
        assert!(!done(scene_file::parse_scene_file(&file, path())));
    }
    for count in [1u32 << 31, u32::MAX] {
        let with = |file: &[u8], at: usize| [&file[..at], &count.to_le_bytes(), &file[at + 4..]].concat();
        assert!(!done(spz::parse_spz(&with(&spz_v4(6)?, 8), path())));
        let image = ktx2::FloatImage { width: 2, height: 2, channels: 1, values: vec![0.5; 4] };
        assert!(!done(ktx2::parse_ktx2(&with(&ktx2::ktx2_bytes(&image, path())?, 20), path())));
        assert!(!done(ktx2::parse_ktx2(&with(&ktx2::ktx2_bytes(&image, path())?, 40), path())));
        let raw = with(&[b"NGSP".as_slice(), &2u32.to_le_bytes(), &[0; 100]].concat(), 8);
        assert!(!done(spz::parse_spz(&raw, path())));
    }
    assert!(start.elapsed() < Duration::from_secs(5));
    if let (Some(before), Some(after)) = (before, peak_kib()) {
        // The other tests of this file run beside and need a few megabytes.
        assert!(after - before < 64 << 10, "{} KiB were needed", after - before);
    }
    Ok(())
}

#[test]
fn a_zstd_bomb_stops_at_the_size_its_header_states() -> Outcome {
    // The header and table of contents state six splats, the first stream holds 64 MiB.
    let honest = spz_v4(6)?;
    let bomb = zstd::bulk::compress(&vec![0; 64 << 20], 3)?;
    let mut file = honest[..32].to_vec();
    file.extend_from_slice(&(bomb.len() as u64).to_le_bytes());
    file.extend_from_slice(&honest[40..32 + 16 * 5]);
    file.extend_from_slice(&bomb);
    let first = u64::from_le_bytes(honest[32..40].try_into()?) as usize;
    file.extend_from_slice(&honest[32 + 16 * 5 + first..]);
    let error = spz::parse_spz(&file, path()).err().map(|e| e.to_string()).unwrap_or_default();
    assert!(error.contains("stream 0 does not unpack to the 54 bytes"), "{error}");
    Ok(())
}

#[test]
fn wrong_tensor_types_name_the_tensor() -> Outcome {
    let bytes = scene_write::scene_file_bytes(&scene(), path())?;
    for tensor in ["template.means", "background.sh", "offset.opacity_logits", "instance.world_from_template"] {
        let key = format!("\"{tensor}\":{{\"dtype\":\"F32\"");
        let file = replaced(&bytes, key.as_bytes(), key.replace("F32", "I32").as_bytes());
        let error = scene_file::parse_scene_file(&file, path()).err().map(|e| e.to_string()).unwrap_or_default();
        assert!(error.contains(tensor) && error.contains("I32"), "{error}");
    }
    let key = "\"template.ranges\":{\"dtype\":\"U32\"";
    let file = replaced(&bytes, key.as_bytes(), key.replace("U32", "F32").as_bytes());
    assert!(scene_file::parse_scene_file(&file, path()).is_err_and(|e| e.to_string().contains("template.ranges")));
    Ok(())
}
