//! Damaged files: every reader must answer with an error or a valid value, quickly and without a panic.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::time::{Duration, Instant};

use glam::DVec3;
use instgs_io::{
    Mask, Pack, camera_file, colmap, glb, groups, ktx2, mask_png, masks, nerf, ply, point_cloud, scene_file,
    scene_write, sog, splat, spz, write_glb,
};
use instgs_vk::math::similarity::Similarity;
use instgs_vk::scene::gaussians::sh_coefficients;
use instgs_vk::scene::{Gaussians, Group, Instance, InstancedScene, Offsets, PixelFilter, SourceRange};

/// `true` = a value, `false` = an error.
type Reader = fn(&[u8]) -> bool;
type Outcome = Result<(), Box<dyn std::error::Error>>;

const FLIPS_PER_FORMAT: u32 = 3000;

fn path() -> &'static Path {
    Path::new("damaged/transforms.json")
}

/// Also checks that errors are one line.
fn done<T>(result: Result<T, instgs_io::IoError>) -> bool {
    if let Err(e) = &result {
        let text = e.to_string();
        assert!(!text.contains('\n') && text.len() < 2000, "{text}");
    }
    result.is_ok()
}

fn cloud(sh_degree: u32, n: usize) -> Gaussians {
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

fn scene() -> InstancedScene {
    let instance = |first_offset| Instance { template: 0, world_from_template: Similarity::IDENTITY, first_offset };
    InstancedScene {
        templates: cloud(1, 3),
        template_ranges: vec![SourceRange { first: 0, count: 3 }],
        instances: vec![instance(Some(0)), instance(None)],
        offsets: Offsets {
            means: vec![[0.1; 3]; 3],
            sh_dc: vec![[0.0; 3]; 3],
            opacity_logits: vec![0.0; 3],
            ..Offsets::default()
        },
        background: cloud(1, 2),
        groups: vec![Group { template_id: 0, name: Some("x".into()), instance_ids: vec![1, 2] }],
        ..InstancedScene::default()
    }
}

/// A version 3 SPZ file of `n` splats of SH degree 0, without gzip.
fn spz_v3(n: u32) -> Vec<u8> {
    let mut out = b"NGSP".to_vec();
    for word in [3, n, u32::from_le_bytes([0, 12, 0, 0])] {
        out.extend_from_slice(&word.to_le_bytes());
    }
    out.extend((0..20 * n).map(|i| i as u8));
    out
}

/// A version 4 SPZ file of `n` splats of SH degree 0, all zero bytes, written by this test alone.
fn spz_v4(n: u32) -> std::io::Result<Vec<u8>> {
    let sizes = [9, 1, 3, 3, 4].map(|b| b * n as usize);
    let streams = sizes.map(|bytes| zstd::bulk::compress(&vec![0; bytes], 3));
    let mut out = b"NGSP".to_vec();
    for word in [4, n, u32::from_le_bytes([0, 12, 0, 5]), 32, 0, 0, 0] {
        out.extend_from_slice(&word.to_le_bytes());
    }
    let mut body = Vec::new();
    for (stream, plain) in streams.into_iter().zip(sizes) {
        let stream = stream?;
        out.extend_from_slice(&(stream.len() as u64).to_le_bytes());
        out.extend_from_slice(&(plain as u64).to_le_bytes());
        body.extend(stream);
    }
    out.extend(body);
    Ok(out)
}

/// The same file with an extension that says that the axes are right-down-front, and an unknown one.
fn spz_v4_with_axes(n: u32) -> std::io::Result<Vec<u8>> {
    let mut plain = spz_v4(n)?;
    let records: Vec<u8> = [0xADBE_0003u32, 4, 6, 0x1234_0001, 0].iter().flat_map(|word| word.to_le_bytes()).collect();
    (plain[14], plain[16]) = (2, 32 + records.len() as u8);
    Ok([&plain[..32], &records[..], &plain[32..]].concat())
}

const ASCII_PLY: &str = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n\
    property float f_dc_0\nproperty float f_dc_1\nproperty float f_dc_2\nproperty float opacity\nproperty float scale_0\n\
    property float scale_1\nproperty float scale_2\nproperty float rot_0\nproperty float rot_1\nproperty float rot_2\n\
    property float rot_3\nelement face 1\nproperty list uchar int v\nend_header\n1 2 3 4 5 6 7 8 9 10 1 0 0 0\n\
    1 2 3 4 5 6 7 8 9 10 1 0 0 0\n3 0 1 1\n";

/// A whole packed PLY of one chunk and three splats.
fn packed_ply() -> Vec<u8> {
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

fn colmap_bin() -> (Vec<u8>, Vec<u8>) {
    let mut cameras = 1u64.to_le_bytes().to_vec();
    [1u32, 1].iter().for_each(|v| cameras.extend_from_slice(&v.to_le_bytes()));
    [20u64, 10].iter().for_each(|v| cameras.extend_from_slice(&v.to_le_bytes()));
    [9.0f64, 9.0, 10.0, 5.0].iter().for_each(|v| cameras.extend_from_slice(&v.to_le_bytes()));
    let mut images = 1u64.to_le_bytes().to_vec();
    images.extend_from_slice(&1u32.to_le_bytes());
    [1.0f64, 0.0, 0.0, 0.0, 1.0, 2.0, 3.0].iter().for_each(|v| images.extend_from_slice(&v.to_le_bytes()));
    images.extend_from_slice(&1u32.to_le_bytes());
    images.extend_from_slice(b"a.jpg\0");
    images.extend_from_slice(&1u64.to_le_bytes());
    images.extend_from_slice(&[0; 24]);
    (cameras, images)
}

const CAMERAS: &str = r#"[{"name":"a","width":8,"height":8,"fx":9.0,"fy":9.0,"cx":4.0,"cy":4.0,
    "view_from_world":[[1.0,0.0,0.0,0.0],[0.0,1.0,0.0,0.0],[0.0,0.0,1.0,0.0],[0.0,0.0,0.0,1.0]]}]"#;
const GROUPS: &str = r#"[{"template_id":0,"name":"a","score":0.5,"instances":[{"instance_id":3,
    "transform":[[0,-2,0,1],[2,0,0,0],[0,0,2,5],[0,0,0,1]]},{"instance_id":4,
    "world_from_template":[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}]}]"#;
const TRANSFORMS: &str = r#"{"w":8,"h":8,"fl_x":9.0,"k1":0.0,"frames":[{"file_path":"a.jpg",
    "transform_matrix":[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}]}"#;
const COLMAP_CAMERAS: &[u8] = b"1 PINHOLE 20 10 9 9 10 5\n";
const COLMAP_IMAGES: &[u8] = b"1 1 0 0 0 1 2 3 1 a.jpg\n1 2 -1\n2 1 0 0 0 1 2 3 1 b.jpg\n\n";

const POINTS_PLY: &str = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n\
    property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n1 2 3 4 5 6\n7 8 9 10 11 12\n";
const COLMAP_POINTS: &[u8] = b"# id\n1 0.5 0 1 10 20 30 0.1 1 2\n2 0.5 0 1 10 20 30 0.1\n";

fn points_ply_big_endian() -> Vec<u8> {
    let mut out = POINTS_PLY.replace("ascii", "binary_big_endian").into_bytes();
    out.truncate(out.len() - b"1 2 3 4 5 6\n7 8 9 10 11 12\n".len());
    out.extend_from_slice(&[64; 2 * 15]);
    out
}

fn colmap_points_bin() -> Vec<u8> {
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

/// A packed scene with every kind of offsets.
fn packed_scene(pack: Pack) -> Result<Vec<u8>, instgs_io::IoError> {
    let mut scene = scene();
    scene.offsets.sh_rest = vec![[0.3, -0.2, 0.1]; 9];
    scene.offsets.log_scales = vec![[0.1; 3]; 3];
    scene.offsets.quats = vec![[0.0, 0.1, 0.0, -0.1]; 3];
    scene_write::packed_scene_file_bytes(&scene, pack, path())
}

/// A `.glb` of a scene with a template, offsets and a background.
fn glb_file() -> Result<Vec<u8>, Box<dyn std::error::Error>> {
    let folder = tempfile::tempdir()?;
    let file = folder.path().join("x.glb");
    write_glb(&file, &scene(), DVec3::NEG_Y)?;
    Ok(std::fs::read(file)?)
}

fn mask() -> Mask {
    Mask { width: 5, height: 3, ids: (0..15).map(|i| i * 300 % 7).collect() }
}

const COCO: &str = r#"{"images":[{"id":1,"file_name":"a/1.jpg","width":9,"height":6},{"id":"2","file_name":"a/2.jpg"}],
    "annotations":[{"id":7,"image_id":1,"category_id":3,"track_id":5,"segmentation":{"size":[6,9],"counts":"5150L20N000000020N400001OO"}},
    {"id":8,"image_id":1,"category_id":3,"attributes":{"track_id":6},"segmentation":[[1,1,5.5,1,5.5,4,1,4],[2,0,7,5,2,5]]},
    {"id":9,"image_id":"2","category_id":3,"track_id":5,"segmentation":{"size":[64,64],"counts":[70,900,3126]}}],
    "categories":[{"id":3,"name":"car"}]}"#;

/// A file of labelme with every kind of shape.
const LABELME: &str = r#"{"shapes":[{"label":"car_1","points":[[1,1],[5.5,1],[3,4]],"shape_type":"polygon","group_id":null},
    {"label":"car_2","points":[[0,0],[3,3]],"shape_type":"rectangle","group_id":4},
    {"label":"ball","points":[[4,4],[6,5]],"shape_type":"circle"},
    {"label":"tree","points":[[2,2],[6,4]],"shape_type":"mask","mask":
    "iVBORw0KGgoAAAANSUhEUgAAAAUAAAADAQAAAABzTfhVAAAADklEQVR4nGNIYPjAoAEABN4Bedmhh2wAAAAASUVORK5CYII="},
    {"label":"here","points":[[2,2]],"shape_type":"point"}],"imagePath":"a.jpg","imageWidth":9,"imageHeight":6}"#;

/// Name of a format, a small valid file of it, and its reader.
type Format = (&'static str, Vec<u8>, Reader);

fn formats() -> Result<Vec<Format>, Box<dyn std::error::Error>> {
    let image = ktx2::FloatImage { width: 2, height: 2, channels: 4, values: vec![0.5; 16] };
    Ok(vec![
        ("ply", ply::ply_bytes(&cloud(1, 3), PixelFilter::default()), |b| done(ply::parse_ply(b, path()))),
        ("ascii ply", ASCII_PLY.into(), |b| done(ply::parse_ply(b, path()))),
        ("packed ply", packed_ply(), |b| done(ply::parse_ply(b, path()))),
        ("spz", spz::spz_bytes(&cloud(1, 5), false, path())?, |b| done(spz::parse_spz(b, path()))),
        ("spz v3", spz_v3(5), |b| done(spz::parse_spz(b, path()))),
        ("spz v4", spz_v4(6)?, |b| done(spz::parse_spz(b, path()))),
        ("spz v4 with axes", spz_v4_with_axes(6)?, |b| done(spz::parse_spz(b, path()))),
        ("sog", sog::sog_bytes(&cloud(1, 5), false, path())?, |b| done(sog::parse_sog(b, path()))),
        ("glb", glb_file()?, |b| done(glb::parse_glb(b, path()))),
        ("splat", vec![77; 64], |b| done(splat::parse_splat(b, path()))),
        ("instgs", scene_write::scene_file_bytes(&scene(), path())?, |b| done(scene_file::parse_scene_file(b, path()))),
        ("instgs f16", packed_scene(Pack::F16)?, |b| done(scene_file::parse_scene_file(b, path()))),
        ("instgs small", packed_scene(Pack::Small)?, |b| done(scene_file::parse_scene_file(b, path()))),
        ("instgs q8", packed_scene(Pack::Q8)?, |b| done(scene_file::parse_scene_file(b, path()))),
        ("groups json", GROUPS.into(), |b| done(groups::parse_groups(b, path()))),
        ("mask png", mask_png::mask_bytes(&mask(), path())?, |b| done(mask_png::parse_mask(b, path()))),
        ("coco json", COCO.into(), |b| done(masks::coco::parse_coco(b, path()).and_then(|m| m.draw_all(64)))),
        ("labelme json", LABELME.into(), |b| {
            done(masks::labelme::parse_labelme(b, path()).and_then(|m| m.draw_all(64)))
        }),
        ("camera json", CAMERAS.into(), |b| done(camera_file::parse_cameras(b, path()))),
        ("transforms json", TRANSFORMS.into(), |b| done(nerf::parse_transforms(b, path()))),
        ("ktx2", ktx2::ktx2_bytes(&image, path())?, |b| done(ktx2::parse_ktx2(b, path()))),
        ("colmap cameras.bin", colmap_bin().0, |b| done(colmap::parse_colmap_bin(b, &colmap_bin().1, path()))),
        ("colmap images.bin", colmap_bin().1, |b| done(colmap::parse_colmap_bin(&colmap_bin().0, b, path()))),
        ("colmap cameras.txt", COLMAP_CAMERAS.into(), |b| done(colmap::parse_colmap_txt(b, COLMAP_IMAGES, path()))),
        ("colmap images.txt", COLMAP_IMAGES.into(), |b| done(colmap::parse_colmap_txt(COLMAP_CAMERAS, b, path()))),
        ("points ply", points_ply_big_endian(), |b| done(point_cloud::parse_points_ply(b, path()))),
        ("ascii points ply", POINTS_PLY.into(), |b| done(point_cloud::parse_points_ply(b, path()))),
        ("colmap points3D.bin", colmap_points_bin(), |b| done(point_cloud::parse_points_bin(b, path()))),
        ("colmap points3D.txt", COLMAP_POINTS.into(), |b| done(point_cloud::parse_points_txt(b, path()))),
    ])
}

/// Runs a reader; a panic or a slow answer fails the test and says on what.
fn run(name: &str, what: &dyn Fn() -> String, bytes: &[u8], reader: Reader) -> bool {
    let start = Instant::now();
    let ok = catch_unwind(AssertUnwindSafe(|| reader(bytes)));
    assert!(start.elapsed() < Duration::from_secs(2), "{name}: {} took {:?}", what(), start.elapsed());
    ok.unwrap_or_else(|_| panic!("{name}: {} panics", what()))
}

#[test]
fn truncation_at_every_byte() -> Outcome {
    for (name, bytes, reader) in formats()? {
        assert!(run(name, &|| "the whole file".into(), &bytes, reader), "{name}: the whole file is not read");
        let accepted: Vec<usize> =
            (0..bytes.len()).filter(|&n| run(name, &|| format!("the first {n} bytes"), &bytes[..n], reader)).collect();
        let fine = match name {
            // 32 bytes a splat without a header: a cut between splats is a shorter file.
            "splat" => accepted == [0, 32],
            // Gaussians are complete before the face element that follows; numbers cut short are numbers.
            "ascii ply" => accepted.iter().all(|&n| n + 12 >= bytes.len()),
            // A text without count or end mark: cut between lines it is a shorter file.
            "colmap images.txt" | "colmap cameras.txt" | "colmap points3D.txt" => true,
            "ascii points ply" => accepted.iter().all(|&n| n + 2 >= bytes.len()),
            _ => accepted.is_empty(),
        };
        assert!(fine, "{name}: {} bytes are read when cut to {accepted:?}", bytes.len());
    }
    Ok(())
}

#[test]
fn random_flips() -> Outcome {
    let mut state = 0x1234_5678_9abc_def1u64;
    let mut random = move |below: usize| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as usize % below
    };
    // INSTGS_FLIPS=1000000 looks longer.
    let rounds = std::env::var("INSTGS_FLIPS").ok().and_then(|n| n.parse().ok()).unwrap_or(FLIPS_PER_FORMAT);
    for (name, bytes, reader) in formats()? {
        for round in 0..rounds {
            let mut damaged = bytes.clone();
            let mut places = Vec::new();
            for _ in 0..=random(4) {
                let (at, value) = (random(bytes.len()), random(256) as u8);
                let value = if round % 2 == 0 { damaged[at] ^ (1 << (value % 8)) } else { value };
                damaged[at] = value;
                places.push((at, value));
            }
            run(name, &|| format!("with {places:?}"), &damaged, reader);
        }
    }
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
