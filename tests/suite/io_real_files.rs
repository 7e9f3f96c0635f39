//! Readers on real files of `../shared/data`, which are not ours to publish, so all tests here are ignored ones that
//! `tools/test` runs where they are at hand. `io_own_datasets` has what data of our own can show.

use instgs_io::colmap::{colmap_folder, read_colmap};
use instgs_io::dataset::{Split, read_views};
use instgs_io::nerf::read_transforms;
use instgs_io::{MaskFolder, load_scene, read_cameras, read_spz, write_ply, write_spz};
use instgs_vk::scene::Gaussians;
use instgs_vk::scene::PixelFilter;

use crate::common::dataset::shared_data;

type Outcome = Result<(), Box<dyn std::error::Error>>;

fn bounds(cloud: &Gaussians) -> ([f32; 3], [f32; 3]) {
    cloud.means.iter().fold(([f32::MAX; 3], [f32::MIN; 3]), |(low, high), m| {
        (std::array::from_fn(|k| low[k].min(m[k])), std::array::from_fn(|k| high[k].max(m[k])))
    })
}

#[test]
#[ignore = "needs ../shared/data, which is not ours to publish; tools/test runs it where it is"]
fn splat_files_have_the_counts_their_readme_states() -> Outcome {
    let folder = shared_data("splats");
    for (name, count, degree) in [
        ("biker.spz", 152_746, 0),
        ("playbot_lod3.ply", 31_000, 2),
        ("pc_short.ply", 100, 3),
        ("playcanvas_test.ply", 64, 3),
        ("minimal-raw.spz", 4, 0),
        ("minimal-v2.spz", 4, 0),
        ("minimal-v3.spz", 4, 0),
        ("minimal-v4.spz", 4, 0),
        ("minimal.splat", 4, 0),
    ] {
        let loaded = load_scene(&folder.join(name))?;
        let cloud = &loaded.scene.background;
        assert_eq!((cloud.len(), cloud.sh_degree, loaded.dropped_non_finite), (count, degree, 0), "{name}");
        let (low, high) = bounds(cloud);
        eprintln!("{name}: {low:?} .. {high:?}");
        assert!(low.iter().chain(&high).all(|v| v.abs() < 1e4), "{name}");
        let unit = (0..count)
            .filter(|&i| (cloud.quats[i].iter().map(|q| q * q).sum::<f32>().sqrt() - 1.0).abs() < 0.02)
            .count();
        assert!(
            unit * 100 >= count * 95 || name == "pc_short.ply",
            "{name}: {unit} of {count} quaternions of length 1"
        );
    }
    Ok(())
}

#[test]
#[ignore = "needs ../shared/data, which is not ours to publish; tools/test runs it where it is"]
fn minimal_files_of_every_version_hold_the_same_splats() -> Outcome {
    let folder = shared_data("splats");
    let read = |name: &str| read_spz(&folder.join(name)).map(|c| c.gaussians);
    let same = |a: &Gaussians, b: &Gaussians, name: &str| {
        for i in 0..4 {
            let dot: f32 = a.quats[i].iter().zip(b.quats[i]).map(|(x, y)| x * y).sum();
            assert!(dot.abs() > 0.999, "{name}: {:?} {:?}", a.quats[i], b.quats[i]);
        }
        assert_eq!((&a.log_scales, &a.opacity_logits), (&b.log_scales, &b.opacity_logits), "{name}");
    };
    let (v2, v3) = (read("minimal-v2.spz")?, read("minimal-v3.spz")?);
    assert_eq!(read("minimal-raw.spz")?, v2);
    assert_eq!(read("minimal-v4.spz")?, v3);
    same(&v2, &v3, "v2 and v3");
    // The .splat fixture has the same splats in our axes already.
    let splat = load_scene(&folder.join("minimal.splat"))?.scene.background;
    assert_eq!(splat.means, v3.means);
    // The fixtures' own bytes differ in the sign of z and in the colours (0x55 against 0x69): all else is the same.
    for (a, b) in v2.means.iter().zip(&v3.means) {
        assert_eq!([a[0], a[1], -a[2]], *b);
    }
    Ok(())
}

#[test]
#[ignore = "needs ../shared/data, which is not ours to publish; tools/test runs it where it is"]
fn real_clouds_survive_ply_and_spz() -> Outcome {
    let folder = shared_data("splats");
    let temporary = tempfile::tempdir()?;
    for name in ["playbot_lod3.ply", "pc_short.ply", "playcanvas_test.ply"] {
        let cloud = load_scene(&folder.join(name))?.scene.background;
        let ply = temporary.path().join("again.ply");
        write_ply(&ply, &cloud, PixelFilter::default())?;
        assert_eq!(load_scene(&ply)?.scene.background, cloud, "{name}");
        let spz = temporary.path().join("again.spz");
        write_spz(&spz, &cloud, false)?;
        let back = read_spz(&spz)?.gaussians;
        assert_eq!(back.len(), cloud.len());
        for (a, b) in back.means.as_flattened().iter().zip(cloud.means.as_flattened()) {
            assert!((a - b).abs() < 2e-4 + 1e-6 * b.abs(), "{name}: {a} {b}");
        }
        // What is written again from what was read is the same: quantisation is stable.
        let again = temporary.path().join("twice.spz");
        write_spz(&again, &back, false)?;
        let twice = read_spz(&again)?.gaussians;
        assert_eq!((twice.means, twice.log_scales, twice.sh), (back.means, back.log_scales, back.sh), "{name}");
    }
    Ok(())
}

#[test]
#[ignore = "needs ../shared/data, which is not ours to publish; tools/test runs it where it is"]
fn garden_loads_with_its_cameras() -> Outcome {
    let folder = shared_data("garden");
    let loaded = load_scene(&folder.join("garden.ply"))?;
    assert_eq!((loaded.scene.background.len(), loaded.scene.background.sh_degree), (111_785, 1));
    assert_eq!(read_cameras(&folder.join("cameras.json"))?.len(), 3);
    Ok(())
}

#[test]
#[ignore = "needs ../shared/data, which is not ours to publish; tools/test runs it where it is"]
fn datasets_split_as_their_readmes_state() -> Outcome {
    for (name, views, test, size) in [
        ("fox_270", 50, 7, (270, 480)),
        ("castle_p19", 19, 3, (768, 512)),
        ("sceaux_540", 11, 2, (540, 398)),
        ("room18", 72, 12, (640, 360)),
    ] {
        let folder = shared_data(name);
        let dataset = read_views(&folder)?;
        assert_eq!((dataset.views.len(), dataset.split(Split::Test).count()), (views, test), "{name}");
        for view in &dataset.views {
            assert!(view.image_path.is_file(), "{}", view.image_path.display());
            assert_eq!((view.camera.width, view.camera.height, view.distortion), (size.0, size.1, None), "{name}");
        }
    }
    Ok(())
}

#[test]
#[ignore = "needs ../shared/data, which is not ours to publish; tools/test runs it where it is"]
fn colmap_and_transforms_agree_on_every_pose() -> Outcome {
    for name in ["fox_270", "castle_p19", "sceaux_540", "room18"] {
        let folder = shared_data(name);
        let model = colmap_folder(&folder).ok_or("no colmap model")?;
        let colmap = read_colmap(&model)?;
        let nerf = read_transforms(&folder.join("transforms.json"))?;
        let mut compared = 0;
        let mut worst = 0.0f64;
        for a in &nerf {
            let Some(b) = colmap.iter().find(|b| b.camera.name == a.camera.name) else { continue };
            compared += 1;
            for (x, y) in a.camera.view_from_world.as_flattened().iter().zip(b.camera.view_from_world.as_flattened()) {
                worst = worst.max((x - y).abs());
            }
            let intrinsics = |c: &instgs_vk::scene::Camera| [c.fx, c.fy, c.cx, c.cy];
            for (x, y) in intrinsics(&a.camera).iter().zip(intrinsics(&b.camera)) {
                assert!((x - y).abs() < 1e-3, "{name}: {x} {y}");
            }
        }
        eprintln!(
            "{name}: {compared} of {} (transforms) and {} (colmap) views, poses differ by {worst:.2e}",
            nerf.len(),
            colmap.len()
        );
        // room18's COLMAP model has its training views only.
        assert!(compared == colmap.len() && (nerf.len() == compared || name == "room18"), "{name}");
        assert!(worst < 1e-4, "{name}: {worst}");
    }
    Ok(())
}

#[test]
#[ignore = "needs ../shared/data, which is not ours to publish; tools/test runs it where it is"]
fn every_view_of_the_sets_with_objects_has_a_mask_of_its_size() -> Outcome {
    // 8 bits of grey, and 16.
    for (name, views, objects) in [("room18", 72, 18), ("sceaux_540", 11, 12)] {
        let folder = shared_data(name);
        let dataset = read_views(&folder)?;
        let masks = MaskFolder::open(&MaskFolder::default_for(&folder).ok_or("no masks")?, &dataset.views)?;
        assert_eq!((dataset.views.len(), masks.categories.len()), (views, objects), "{name}");
        let mut seen = std::collections::BTreeSet::new();
        for view in &dataset.views {
            // Of the image's size, or it would be an error.
            let mask = masks.of_view(view)?.ok_or("a view without a mask")?;
            seen.extend(mask.ids_present().into_keys().map(u32::from));
        }
        assert!(seen.iter().eq(masks.categories.keys()), "{name}: {seen:?}");
    }
    Ok(())
}
