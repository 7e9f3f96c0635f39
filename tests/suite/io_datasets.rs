//! The real datasets of `../shared/data` as training takes them. They are not ours to publish, so all tests here are
//! ignored ones that `tools/test` runs where they are at hand. `io_own_datasets` has what data of our own can show.

use std::path::Path;
use std::time::Instant;

use instgs_io::dataset::{Dataset, Split};
use instgs_io::view_image::IGNORED;
use instgs_io::{IoError, LoadedView, read_points, read_views};
use instgs_train::config::TrainConfig;
use instgs_train::initial::{InitialShape, from_points, scene_extent};
use instgs_train::view_store::{PrefetchLimits, load_all};
use instgs_vk::math::distortion::Distortion;
use instgs_vk::scene::{Camera, PointCloud};

use crate::common::dataset::shared_data;

type Outcome = Result<(), Box<dyn std::error::Error>>;

/// Name, views, test views, width, height, points.
const DATASETS: [(&str, usize, usize, u32, u32, usize); 4] = [
    ("fox_270", 50, 7, 270, 480, 38_697),
    ("castle_p19", 19, 3, 768, 512, 4361),
    ("sceaux_540", 11, 2, 540, 398, 8856),
    ("room18", 72, 12, 640, 360, 10_000),
];

fn load(dataset: &Dataset, width: Option<u32>) -> Result<Vec<LoadedView>, IoError> {
    let mut out = Vec::new();
    load_all(&dataset.views, width, PrefetchLimits::default(), &mut |i, view| {
        assert_eq!(i, out.len());
        out.push(view);
        Ok::<(), IoError>(())
    })?;
    Ok(out)
}

/// Red, green and blue at (u, v) pixels.
fn color_at(view: &LoadedView, u: f64, v: f64) -> [u8; 3] {
    let [r, g, b, _] = view.image.rgba[v as usize * view.image.width as usize + u as usize];
    [r, g, b]
}

/// Where a camera sees a point, in pixels, if in its picture.
fn project(camera: &Camera, point: [f32; 3]) -> Option<(f64, f64)> {
    let p = camera.rotation() * glam::DVec3::from(point.map(f64::from)) + camera.translation();
    let (u, v) = (camera.fx * p.x / p.z + camera.cx, camera.fy * p.y / p.z + camera.cy);
    let inside =
        p.z > 0.0 && (0.0..f64::from(camera.width)).contains(&u) && (0.0..f64::from(camera.height)).contains(&v);
    inside.then_some((u, v))
}

/// Mean absolute difference, in levels, of the points' colours and the pixels that they fall on; `shift` rotates the
/// points among each other, for comparison. Hidden points count too, so it is never near 0.
fn colour_difference(views: &[LoadedView], points: &PointCloud, shift: usize) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for view in views {
        for (i, position) in points.positions.iter().enumerate() {
            if let Some((u, v)) = project(&view.camera, *position) {
                let color = points.colors[(i + shift) % points.len()];
                let pixel = color_at(view, u, v);
                sum += (0..3).map(|k| f64::from(pixel[k].abs_diff(color[k]))).sum::<f64>() / 3.0;
                count += 1.0;
            }
        }
    }
    sum / count
}

#[test]
#[ignore = "needs ../shared/data, which is not ours to publish; tools/test runs it where it is"]
fn every_view_and_point_of_every_dataset_loads() -> Outcome {
    for (name, count, test, width, height, point_count) in DATASETS {
        let folder = shared_data(name);
        let start = Instant::now();
        let dataset = read_views(&folder)?;
        assert_eq!((dataset.views.len(), dataset.split(Split::Test).count()), (count, test), "{name}");
        let views = load(&dataset, None)?;
        let seconds = start.elapsed().as_secs_f64();
        for (view, source) in views.iter().zip(&dataset.views) {
            assert_eq!((view.image.width, view.image.height), (width, height), "{name}");
            assert!(view.image.is_opaque() && view.camera == source.camera, "{name}: {}", view.camera.name);
        }
        let loaded = read_points(&folder)?.ok_or("no points")?;
        let all = loaded.points.len() + loaded.dropped_coinciding;
        assert_eq!((all, loaded.dropped_non_finite), (point_count, 0), "{name}");
        // Two of the reconstructions have points that are exactly where another one is.
        let coinciding = match name {
            "castle_p19" => 193,
            "sceaux_540" => 280,
            _ => 0,
        };
        assert_eq!(loaded.dropped_coinciding, coinciding, "{name}");
        assert_eq!(loaded.path, folder.join("points3d.ply"));
        // Images, cameras and points belong together: points have the colour of the pixels that they fall on.
        let (right, wrong) =
            (colour_difference(&views, &loaded.points, 0), colour_difference(&views, &loaded.points, 1999));
        let cameras: Vec<Camera> = views.iter().map(|v| v.camera.clone()).collect();
        let start = Instant::now();
        let gaussians = from_points(&loaded.points, 3, InitialShape::new(&TrainConfig::default()));
        eprintln!(
            "{name}: {count} views in {seconds:.2} s; points differ by {right:.1} levels from pixels, by {wrong:.1} shuffled; \
             extent {:.3}; Gaussians in {:.3} s",
            scene_extent(&cameras, &loaded.points),
            start.elapsed().as_secs_f64()
        );
        // Measured: 0.27 (castle) to 0.56 (fox).
        assert!(right < 0.6 * wrong, "{name}: {right} {wrong}");
        assert!((0..gaussians.len()).all(|i| gaussians.is_finite(i)));
    }
    Ok(())
}

#[test]
#[ignore = "needs ../shared/data, which is not ours to publish; tools/test runs it where it is"]
fn colmap_points_are_those_of_the_ply() -> Outcome {
    for (name, _, _, _, _, count) in DATASETS {
        let folder = shared_data(name);
        // A folder of the COLMAP points alone.
        let copy = tempfile::tempdir()?;
        std::fs::create_dir_all(copy.path().join("sparse/0"))?;
        for file in ["points3D.bin", "points3D.txt"] {
            let from = folder.join("sparse/0").join(file);
            if from.is_file() {
                std::fs::copy(from, copy.path().join("sparse/0").join(file))?;
            }
        }
        let (ply, colmap) = (read_points(&folder)?.ok_or("none")?, read_points(copy.path())?.ok_or("none")?);
        assert_eq!(colmap.points.len() + colmap.dropped_coinciding, count, "{name}");
        let median = |points: &PointCloud| points.median().ok_or("none");
        let apart = median(&ply.points)?.distance(median(&colmap.points)?);
        eprintln!("{name}: {}: medians {apart:.2e} apart", colmap.path.display());
        assert!(apart < 1e-5, "{name}: {apart}");
    }
    Ok(())
}

fn save(view: &LoadedView, name: &str) -> Outcome {
    let raw = view.image.rgba.as_flattened().to_vec();
    let buffer = image::RgbaImage::from_raw(view.image.width, view.image.height, raw).ok_or("size")?;
    Ok(buffer.save(Path::new(env!("CARGO_TARGET_TMPDIR")).join(name))?)
}

/// No real dataset here has distortion; a real photo is given some, to look at.
#[test]
#[ignore = "needs ../shared/data, which is not ours to publish; tools/test runs it where it is"]
fn a_real_photo_undistorted() -> Outcome {
    let folder = shared_data("sceaux_540");
    let mut dataset = read_views(&folder)?;
    dataset.views.truncate(1);
    dataset.views[0].distortion = Some(Distortion { k1: 0.3, k2: 0.0, p1: 0.01, p2: 0.0, k3: 0.0, fisheye: None });
    let views = load(&dataset, None)?;
    let ignored = views[0].image.rgba.iter().filter(|p| p[3] == IGNORED).count();
    eprintln!("{ignored} of {} pixels ignored", views[0].image.rgba.len());
    assert!(ignored > 1000 && ignored * 2 < views[0].image.rgba.len(), "{ignored}");
    save(&views[0], "sceaux_undistorted.png")
}
