//! The sparse points of a dataset: `.ply` point clouds and COLMAP's `points3D`.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use crate::bytes::Cursor;
use crate::colmap::{lines, number};
use crate::dataset::CameraFiles;
use crate::error::{IoError, Place};
use crate::nerf::named_point_file;
use crate::ply_table::PlyTable;
use crate::{atomic_write, read_bytes};
use instgs_vk::math::sh::SH_C0;
use instgs_vk::scene::point_cloud::PointCloud;

/// Colour of points whose file stores none.
const NO_COLOR: [u8; 3] = [128; 3];

/// File names tried in this order if the cameras' file names no point cloud.
const PLACES: [&str; 3] = ["points3d.ply", "points3D.ply", "sparse_pc.ply"];

/// Files tried next, which belong to COLMAP's cameras. Tools that convert such cameras to a transforms file rotate,
/// move and scale them (instant-ngp, nerfstudio), but not these points.
const COLMAP_PLACES: [&str; 6] = [
    "sparse/0/points3D.bin",
    "sparse/0/points3D.txt",
    "sparse/0/points3D.ply",
    "sparse/points3D.bin",
    "sparse/points3D.txt",
    "sparse/points3D.ply",
];

/// The points of a dataset, and where they came from.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadedPoints {
    /// The points; at least one, all finite.
    pub points: PointCloud,
    /// The file that was read.
    pub path: PathBuf,
    /// Number of points that were dropped because a coordinate is not finite (as f32).
    pub dropped_non_finite: usize,
    /// Number of points that were dropped because an earlier one is exactly there.
    pub dropped_coinciding: usize,
    /// What a user should know of the points, one line each.
    pub notes: Vec<String>,
}

/// Reads the points of a dataset folder, `None` if it has none. The first of these is used: the `ply_file_path` of the
/// transforms file that the cameras are read from ([`crate::dataset::read_views`]; of a pair, the one to train on),
/// `points3d.ply`, `points3D.ply`, `sparse_pc.ply`, and, unless the cameras are of a transforms file, `points3D.bin`,
/// `.txt` or `.ply` in the folder of COLMAP's cameras, in `sparse/0` or in `sparse`.
///
/// # Errors
/// A file that is named but missing, damaged, or without finite points.
pub fn read_points(folder: &Path) -> Result<Option<LoadedPoints>, IoError> {
    let cameras = CameraFiles::of(folder);
    let named = match &cameras {
        Some(CameraFiles::Transforms { train, .. }) => named_point_file(train)?,
        _ => None,
    };
    let in_folder = || PLACES.iter().map(|place| folder.join(place)).find(|path| path.is_file());
    let of_colmap = || match &cameras {
        Some(CameraFiles::Transforms { .. }) => None,
        Some(CameraFiles::Colmap(model)) => colmap_points(folder, Some(model)),
        None => colmap_points(folder, None),
    };
    let Some(path) = named.or_else(in_folder).or_else(of_colmap) else { return Ok(None) };
    let bytes = read_bytes(&path)?;
    let ending = path.extension().map(|e| e.to_ascii_lowercase());
    let mut points = match ending.as_deref().and_then(|e| e.to_str()) {
        Some("bin") => parse_points_bin(&bytes, &path)?,
        Some("txt") => parse_points_txt(&bytes, &path)?,
        _ => parse_points_ply(&bytes, &path)?,
    };
    let dropped_non_finite = drop_non_finite(&mut points);
    if points.is_empty() {
        let what = if dropped_non_finite > 0 { "has no point with finite coordinates" } else { "has no points" };
        return Err(IoError::new(&path, what)
            .advise("start from random points with --set init=random, or give a trained scene with --init"));
    }
    let mut notes = Vec::new();
    let dropped_coinciding = drop_coinciding(&mut points);
    if dropped_coinciding > 0 {
        notes.push(format!(
            "{}: dropped {dropped_coinciding} points that are exactly where another one is",
            path.display()
        ));
    }
    if points.colors.iter().all(|color| *color == NO_COLOR) {
        notes.push(format!("{}: has no colours that are understood: all points start grey", path.display()));
    }
    Ok(Some(LoadedPoints { points, path, dropped_non_finite, dropped_coinciding, notes }))
}

/// The points of COLMAP, of several first those that belong to `model`.
fn colmap_points(folder: &Path, model: Option<&Path>) -> Option<PathBuf> {
    let there = || COLMAP_PLACES.iter().map(|place| folder.join(place)).filter(|path| path.is_file());
    there().find(|path| model.is_some() && path.parent() == model).or_else(|| there().next())
}

/// Advice for the user if a dataset has no points.
pub fn advice_without_points(folder: &Path) -> String {
    let has_transforms = matches!(CameraFiles::of(folder), Some(CameraFiles::Transforms { .. }));
    let unused = COLMAP_PLACES.iter().find(|place| has_transforms && folder.join(place).is_file());
    match unused {
        Some(place) => format!(
            "{place} may be in other axes than transforms.json: name a .ply there as ply_file_path, or remove \
             transforms.json to take COLMAP's cameras, or --set init=random"
        ),
        None => {
            "put a point cloud there as points3d.ply, give a trained scene with --init, or --set init=random".into()
        }
    }
}

fn drop_non_finite(cloud: &mut PointCloud) -> usize {
    let finite: Vec<bool> = cloud.positions.iter().map(|p| p.iter().all(|v| v.is_finite())).collect();
    keep_where(cloud, &finite)
}

/// Drops points at exactly the place of an earlier one, as of a cloud merged with itself: their distances to each other say
/// nothing about the size of what they show.
fn drop_coinciding(cloud: &mut PointCloud) -> usize {
    let mut seen = HashSet::with_capacity(cloud.len());
    // Adding 0 turns -0 into 0.
    let first: Vec<bool> = cloud.positions.iter().map(|p| seen.insert(p.map(|v| (v + 0.0).to_bits()))).collect();
    keep_where(cloud, &first)
}

/// Keeps the points whose flag is set; returns the number of the others.
fn keep_where(cloud: &mut PointCloud, flags: &[bool]) -> usize {
    let mut keep = flags.iter();
    cloud.colors.retain(|_| keep.next() == Some(&true));
    let mut keep = flags.iter();
    cloud.positions.retain(|_| keep.next() == Some(&true));
    flags.len() - cloud.len()
}

/// Names of colours in the wild: of most programs, of some, of MeshLab and Open3D's older ones.
const COLOR_NAMES: [[&str; 3]; 3] =
    [["red", "green", "blue"], ["r", "g", "b"], ["diffuse_red", "diffuse_green", "diffuse_blue"]];

/// Parses the bytes of a `.ply` point cloud in any encoding: `x y z`, and colours if present (`red green blue`, `r g b`,
/// `diffuse_red` ..., or a 3DGS cloud's `f_dc_0` ...). Colours go to 1 if they are floating-point and none is above 2, else
/// to 255, to 65535 or to 2^32 - 1: the least of these that none exceeds. Non-finite points are kept; `path` is only used
/// in messages.
pub fn parse_points_ply(bytes: &[u8], path: &Path) -> Result<PointCloud, IoError> {
    let table = PlyTable::parse(bytes, path)?;
    let vertex = table
        .element("vertex")
        .ok_or_else(|| IoError::new(path, "has no element vertex").advise("a cloud has one vertex per point"))?;
    let column = |name: &str| {
        vertex.column(name).ok_or_else(|| {
            IoError::new(path, format!("element vertex has no property {name}")).advise("points have x, y and z")
        })
    };
    let xyz = [column("x")?, column("y")?, column("z")?];
    let columns = |names: [&str; 3]| {
        let found = names.map(|name| vertex.column(name));
        if let [Some(r), Some(g), Some(b)] = found { Some([r, g, b]) } else { None }
    };
    let rgb = COLOR_NAMES.iter().find_map(|names| columns(*names));
    let sh = if rgb.is_some() { None } else { columns(["f_dc_0", "f_dc_1", "f_dc_2"]) };
    let mut out = PointCloud::default();
    let mut colors: Vec<[f64; 3]> = Vec::new();
    table.walk(&mut [("vertex", &mut |_, row: &[f64]| {
        out.positions.push(xyz.map(|c| row[c] as f32));
        colors.extend(rgb.or(sh).map(|columns| columns.map(|c| row[c])));
    })])?;
    let is_float = rgb.is_some_and(|columns| columns.iter().any(|&c| vertex.properties[c].is_float()));
    let scale = scale_of(is_float, &colors);
    // The cast saturates at 0 and 255.
    let byte = |value: f64| value.round() as u8;
    out.colors = if sh.is_some() {
        colors.iter().map(|color| color.map(|c| byte(255.0 * (0.5 + SH_C0 * c)))).collect()
    } else if rgb.is_some() {
        colors.iter().map(|color| color.map(|c| byte(scale * c))).collect()
    } else {
        vec![NO_COLOR; out.positions.len()]
    };
    Ok(out)
}

/// Floating-point colours up to this go from 0 to 1, where brightest ones may overshoot; a cloud that goes to 255 and has
/// none above it would be black.
const MOST_FRACTION: f64 = 2.0;

/// What brings colours to 0..255, by the smallest usual range that holds the largest of them.
fn scale_of(is_float: bool, colors: &[[f64; 3]]) -> f64 {
    let largest = colors.iter().flatten().copied().filter(|v| v.is_finite()).fold(0.0, f64::max);
    match largest {
        _ if is_float && largest <= MOST_FRACTION => 255.0,
        _ if largest <= f64::from(u8::MAX) => 1.0,
        _ if largest <= f64::from(u16::MAX) => f64::from(u8::MAX) / f64::from(u16::MAX),
        _ => f64::from(u8::MAX) / f64::from(u32::MAX),
    }
}

/// Parses the bytes of COLMAP's `points3D.bin`; tracks are skipped. Non-finite points are kept; `path` is only used in
/// messages.
pub fn parse_points_bin(bytes: &[u8], path: &Path) -> Result<PointCloud, IoError> {
    let mut c = Cursor::new(bytes, path);
    let count = c.u64("the number of points")?;
    let mut out = PointCloud::default();
    // Each iteration consumes bytes, so a wrong count stops at the end of the file.
    for _ in 0..count {
        c.u64("a point")?;
        out.positions.push([c.f64("a point")? as f32, c.f64("a point")? as f32, c.f64("a point")? as f32]);
        out.colors.push([c.u8("a point")?, c.u8("a point")?, c.u8("a point")?]);
        c.f64("a point's error")?;
        let track = c.u64("a point's track")?;
        let skip = track.checked_mul(8).and_then(|n| usize::try_from(n).ok()).unwrap_or(usize::MAX);
        c.take(skip, "a point's track")?;
    }
    Ok(out)
}

/// Parses the bytes of COLMAP's `points3D.txt`; tracks are skipped. Non-finite points are kept; `path` is only used in
/// messages.
pub fn parse_points_txt(bytes: &[u8], path: &Path) -> Result<PointCloud, IoError> {
    let mut out = PointCloud::default();
    for (n, line) in lines(bytes, path)?.into_iter().filter(|(_, l)| !l.trim().is_empty()) {
        let fail = |what: String| IoError::new(path, what).at(Place::Line(n));
        let mut words = line.split_whitespace();
        number::<u64>(words.next(), &fail)?;
        let mut next = || number::<f64>(words.next(), &fail).map(|v| v as f32);
        let position = [next()?, next()?, next()?];
        let mut next = || number::<u8>(words.next(), &fail);
        let color = [next()?, next()?, next()?];
        number::<f64>(words.next(), &fail)?;
        out.positions.push(position);
        out.colors.push(color);
    }
    Ok(out)
}

/// Writes a point cloud as binary `.ply`: position, a zero normal (which some readers require) and colour.
pub fn write_points(path: &Path, cloud: &PointCloud) -> Result<(), IoError> {
    let mut bytes = format!("ply\nformat binary_little_endian 1.0\nelement vertex {}\n", cloud.len()).into_bytes();
    for name in ["x", "y", "z", "nx", "ny", "nz"] {
        bytes.extend_from_slice(format!("property float {name}\n").as_bytes());
    }
    bytes.extend_from_slice(b"property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n");
    for (position, color) in cloud.positions.iter().zip(&cloud.colors) {
        position.iter().chain(&[0.0; 3]).for_each(|v| bytes.extend_from_slice(&v.to_le_bytes()));
        bytes.extend_from_slice(color);
    }
    atomic_write(path, |out| out.write_all(&bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    const PATH: &str = "points";

    fn write(path: &Path, bytes: &[u8]) -> Result<(), std::io::Error> {
        path.parent().map_or(Ok(()), std::fs::create_dir_all)?;
        std::fs::write(path, bytes)
    }

    #[test]
    fn written_points_come_back() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let positions = vec![[1.0, 2.0, 3.5], [-4.0, 1e-3, 6.0]];
        let cloud = PointCloud { positions, colors: vec![[1, 2, 3], [255, 0, 9]] };
        write_points(&folder.path().join("points3d.ply"), &cloud)?;
        assert_eq!(read_points(folder.path())?.map(|p| p.points), Some(cloud));
        Ok(())
    }

    fn one_point_ply(x: &str) -> Vec<u8> {
        format!("ply\nformat ascii 1.0\nelement vertex 2\nproperty double x\nproperty float y\nproperty float z\nend_header\n{x} 0 0\n{x} 0 nan\n")
            .into_bytes()
    }

    fn points_bin(x: f64) -> Vec<u8> {
        let mut out = [1u64.to_le_bytes(), 77u64.to_le_bytes()].concat();
        [x, 2.0, 3.0].iter().for_each(|v| out.extend_from_slice(&v.to_le_bytes()));
        out.extend_from_slice(&[10, 20, 30]);
        out.extend_from_slice(&0.5f64.to_le_bytes());
        out.extend_from_slice(&2u64.to_le_bytes());
        out.extend_from_slice(&[0; 16]);
        out
    }

    #[test]
    fn order_of_places_and_dropped_points() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let root = folder.path();
        assert_eq!(read_points(root)?, None);
        let places = PLACES.iter().chain(&COLMAP_PLACES);
        let mut order: Vec<String> = places.rev().map(|p| (*p).to_owned()).collect();
        order.push("named/own.ply".into());
        for (i, place) in order.iter().enumerate() {
            let bytes = match place.rsplit_once('.') {
                Some((_, "bin")) => points_bin(i as f64),
                Some((_, "txt")) => format!("# c\n5 {i} 2 3 10 20 30 0.5 1 2\n\n").into_bytes(),
                _ => one_point_ply(&i.to_string()),
            };
            write(&root.join(place), &bytes)?;
            if i + 1 == order.len() {
                std::fs::write(root.join("transforms.json"), r#"{"ply_file_path":"./named/own.ply","frames":[]}"#)?;
            }
            let loaded = read_points(root)?.ok_or("none")?;
            let ply = place.ends_with("ply");
            assert_eq!((loaded.path, loaded.dropped_non_finite), (root.join(place), usize::from(ply)));
            let rest = if ply { [0.0; 2] } else { [2.0, 3.0] };
            assert_eq!(loaded.points.positions, [[i as f32, rest[0], rest[1]]], "{place}");
            assert_eq!(loaded.points.colors, [if ply { NO_COLOR } else { [10, 20, 30] }], "{place}");
        }
        std::fs::remove_file(root.join("named/own.ply"))?;
        let text = read_points(root).err().map(|e| e.to_string()).unwrap_or_default();
        assert!(text.contains("ply_file_path") && text.contains("own.ply"), "{text}");
        Ok(())
    }

    /// COLMAP's points are not used with the cameras of a transforms file.
    #[test]
    fn points_of_other_cameras_are_left_alone() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let root = folder.path();
        assert!(advice_without_points(root).contains("points3d.ply"));
        write(&root.join("sparse/0/points3D.bin"), &points_bin(1.0))?;
        assert!(read_points(root)?.is_some());
        std::fs::write(root.join("transforms.json"), r#"{"frames":[]}"#)?;
        assert_eq!(read_points(root)?, None);
        let advice = advice_without_points(root);
        assert!(advice.contains("sparse/0/points3D.bin") && advice.contains("ply_file_path"), "{advice}");
        write(&root.join("points3d.ply"), &one_point_ply("1"))?;
        assert!(read_points(root)?.is_some());
        Ok(())
    }

    /// The points are those of the file, and of the model, that the cameras are read from.
    #[test]
    fn points_and_cameras_are_of_the_same_files() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let root = folder.path();
        let path = || Ok::<_, IoError>(read_points(root)?.map(|loaded| loaded.path));
        for model in ["sparse/0", "sparse"] {
            write(&root.join(model).join("points3D.bin"), &points_bin(1.0))?;
        }
        for file in ["cameras.txt", "images.txt"] {
            write(&root.join("sparse").join(file), b"")?;
        }
        assert_eq!(path()?, Some(root.join("sparse/points3D.bin")));
        std::fs::remove_file(root.join("sparse/points3D.bin"))?;
        assert_eq!(path()?, Some(root.join("sparse/0/points3D.bin")));
        for name in ["single", "pair"] {
            write(&root.join(format!("{name}.ply")), &one_point_ply("1"))?;
        }
        let naming = |name: &str| format!(r#"{{"ply_file_path":"{name}.ply","frames":[]}}"#);
        std::fs::write(root.join("transforms_train.json"), naming("pair"))?;
        assert_eq!(path()?, Some(root.join("pair.ply")));
        std::fs::write(root.join("transforms.json"), naming("single"))?;
        assert_eq!(path()?, Some(root.join("single.ply")));
        std::fs::write(root.join("transforms_val.json"), naming("single"))?;
        assert_eq!(path()?, Some(root.join("pair.ply")));
        Ok(())
    }

    #[test]
    fn ply_colours_of_integers_and_floats_in_both_byte_orders() -> Result<(), IoError> {
        for (big, name) in [(false, "little"), (true, "big")] {
            for (kind, color) in [("uchar", &[255u8, 0, 128][..]), ("float", &[])] {
                let mut file = format!("ply\nformat binary_{name}_endian 1.0\nelement vertex 1\n");
                ["z", "y", "x"].iter().for_each(|n| file += &format!("property float {n}\n"));
                ["red", "green", "blue"].iter().for_each(|n| file += &format!("property {kind} {n}\n"));
                let mut file = (file + "end_header\n").into_bytes();
                let mut put = |v: f32| file.extend(if big { v.to_be_bytes() } else { v.to_le_bytes() });
                [3.0, 2.0, 1.0].into_iter().for_each(&mut put);
                if kind == "float" {
                    [1.5, -0.5, 0.5].into_iter().for_each(&mut put);
                }
                file.extend_from_slice(color);
                let cloud = parse_points_ply(&file, Path::new(PATH))?;
                assert_eq!((cloud.positions, cloud.colors), (vec![[1.0, 2.0, 3.0]], vec![[255, 0, 128]]));
            }
        }
        Ok(())
    }

    #[test]
    fn errors_name_file_and_place() -> Result<(), Box<dyn std::error::Error>> {
        let text = |r: Result<PointCloud, IoError>| r.err().map(|e| e.to_string()).unwrap_or_default();
        let bin = points_bin(1.0);
        assert!(text(parse_points_bin(&bin[..bin.len() - 1], Path::new(PATH))).contains("points: byte 59: ends early"));
        assert!(text(parse_points_txt(b"#\n1 0 0 0 1 2 3\n", Path::new(PATH))).contains("points: line 2: ends early"));
        assert!(text(parse_points_txt(b"1 0 0 0 1 2 300 1\n", Path::new(PATH))).contains("\"300\""));
        let no_z = b"ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nproperty float y\nend_header\n";
        assert!(text(parse_points_ply(no_z, Path::new(PATH))).contains("no property z"));
        let folder = tempfile::tempdir()?;
        for (bytes, what) in [(&b"# nothing\n"[..], "has no points"), (b"1 0 inf 0 1 2 3 1\n", "no point with finite")]
        {
            write(&folder.path().join("sparse/points3D.txt"), bytes)?;
            let error = read_points(folder.path()).err().map(|e| e.to_string()).unwrap_or_default();
            assert!(error.contains("points3D.txt") && error.contains(what), "{error}");
        }
        Ok(())
    }
}
