use super::*;
use instgs_io::Split;
use instgs_vk::scene::Camera;
use std::path::Path;
use std::time::{Duration, Instant};

type Outcome = Result<(), Box<dyn std::error::Error>>;

const COUNT: usize = 12;
/// Bytes of one image of 20x10 pixels.
const IMAGE_BYTES: u64 = 800;

/// Views of flat gray images, each of its index; decoding image 0 takes by far the longest.
fn views(folder: &Path) -> Result<Vec<View>, Box<dyn std::error::Error>> {
    (0..COUNT)
        .map(|i| {
            let (width, height) = if i == 0 { (1500, 1000) } else { (20, 10) };
            let image_path = folder.join(format!("{i:02}.png"));
            image::RgbImage::from_pixel(width, height, image::Rgb([i as u8; 3])).save(&image_path)?;
            let pose = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];
            let name = i.to_string();
            let camera = Camera { name, width, height, fx: 9.0, fy: 9.0, cx: 9.0, cy: 4.0, view_from_world: pose };
            Ok(View { camera, image_path, split: Split::Train, distortion: None, mask_path: None })
        })
        .collect()
}

/// Limits from no prefetching at all to everything ahead.
fn all_limits() -> Vec<PrefetchLimits> {
    let mut out = vec![PrefetchLimits::default()];
    for threads in [0, 1, 3] {
        for (ahead, ahead_bytes) in [(0, 0), (1, u64::MAX), (3, 16 * 200 * 2), (100, u64::MAX)] {
            for cache_bytes in [0, 3 * IMAGE_BYTES + 5, u64::MAX] {
                out.push(PrefetchLimits { threads, ahead, ahead_bytes, cache_bytes });
            }
        }
    }
    out
}

fn level(view: &LoadedView) -> usize {
    usize::from(view.image.rgba[0][0])
}

#[test]
fn all_views_arrive_in_order_on_this_thread() -> Outcome {
    let folder = tempfile::tempdir()?;
    let views = views(folder.path())?;
    let here = std::thread::current().id();
    for limits in all_limits() {
        let mut seen = Vec::new();
        load_all(&views, Some(20), limits, &mut |i, loaded| {
            assert_eq!((level(&loaded), loaded.image.width, std::thread::current().id()), (i, 20, here));
            seen.push(i);
            Ok::<(), IoError>(())
        })?;
        assert_eq!(seen, (0..COUNT).collect::<Vec<_>>(), "{limits:?}");
    }
    load_all(&[], None, PrefetchLimits::default(), &mut |_, _| Err(IoError::new(Path::new("x"), "called")))?;
    Ok(())
}

#[test]
fn the_first_error_in_order_stops() -> Outcome {
    let folder = tempfile::tempdir()?;
    let mut views = views(folder.path())?;
    // The later error is found long before the earlier one, which comes after the slow image.
    std::fs::write(&views[9].image_path, b"no image")?;
    std::fs::remove_file(&views[4].image_path)?;
    for limits in all_limits() {
        let mut seen = Vec::new();
        let error = load_all(&views, None, limits, &mut |i, _| {
            seen.push(i);
            Ok::<(), IoError>(())
        });
        let text = error.err().map(|e| e.to_string()).unwrap_or_default();
        assert!(text.contains("04.png: cannot read"), "{limits:?}: {text}");
        assert_eq!(seen, [0, 1, 2, 3], "{limits:?}");
        let refused = IoError::new(Path::new("device"), "is full");
        let refuse = &mut |i, _| if i == 2 { Err(refused.clone()) } else { Ok(()) };
        assert_eq!(load_all(&views, None, limits, refuse), Err(refused.clone()));
    }
    // A prefetcher continues after an error.
    views.truncate(6);
    let ok: Vec<bool> = Prefetcher::new(views, None, 2..6, PrefetchLimits::default()).map(|l| l.is_ok()).collect();
    assert_eq!(ok, [true, true, false, true]);
    Ok(())
}

#[test]
fn a_sequence_with_repeats_comes_as_given() -> Outcome {
    let folder = tempfile::tempdir()?;
    let views = views(folder.path())?;
    let sequence: Vec<usize> = (0..60).map(|i| (i * i + i / 7) % COUNT).collect();
    for limits in all_limits() {
        let prefetcher = Prefetcher::new(views.clone(), Some(20), sequence.clone().into_iter(), limits);
        let got = prefetcher.map(|l| l.map(|(i, v)| (i, level(&v)))).collect::<Result<Vec<_>, _>>()?;
        assert_eq!(got, sequence.iter().map(|&i| (i, i)).collect::<Vec<_>>(), "{limits:?}");
    }
    // An index out of range ends the sequence.
    assert_eq!(Prefetcher::new(views, Some(20), [3, 99, 4].into_iter(), PrefetchLimits::default()).count(), 1);
    Ok(())
}

#[test]
fn the_cache_keeps_to_its_bytes_and_spares_the_files() -> Outcome {
    let folder = tempfile::tempdir()?;
    let views = views(folder.path())?;
    let epochs = (0..3).flat_map(|_| 1..COUNT);
    let limits = PrefetchLimits { threads: 2, ahead: 1, ahead_bytes: u64::MAX, cache_bytes: 4 * IMAGE_BYTES + 1 };
    let mut prefetcher = Prefetcher::new(views.clone(), None, epochs, limits);
    for _ in 1..COUNT {
        prefetcher.next().ok_or("end")??;
    }
    assert_eq!(prefetcher.cached_bytes(), 4 * IMAGE_BYTES);
    // With the files gone, only what was kept is left; one entry may have been decoded ahead, and that one is kept too.
    views.iter().try_for_each(|v| std::fs::remove_file(&v.image_path))?;
    let left: Vec<usize> = prefetcher.filter_map(|l| l.ok().map(|(i, _)| i)).collect();
    assert_eq!(left, [1, 2, 3, 4, 1, 2, 3, 4]);
    Ok(())
}

#[test]
fn in_flight_keeps_to_its_bounds() -> Outcome {
    let folder = tempfile::tempdir()?;
    let views = views(folder.path())?;
    let endless = || (1..COUNT).cycle();
    // In bytes: an image to be decoded counts 16 per pixel, a decoded one 4: 8 and 1 more fill three times 16.
    for (ahead, ahead_bytes, want) in [(5, u64::MAX, 5), (100, 3 * 16 * 200, 9), (100, 0, 1)] {
        let limits = PrefetchLimits { threads: 3, ahead, ahead_bytes, cache_bytes: 0 };
        let prefetcher = Prefetcher::new(views.clone(), None, endless(), limits);
        // The workers stop when the bound is reached.
        let start = Instant::now();
        let mut resting = 0;
        while resting < 20 && start.elapsed() < Duration::from_secs(10) {
            let state = prefetcher.shared.lock();
            assert!(state.in_flight.len() <= want && (want == 1 || state.bytes_in_flight <= ahead_bytes));
            let done = state.in_flight.iter().all(|(_, loaded)| loaded.is_some()) && !state.in_flight.is_empty();
            resting = if done { resting + 1 } else { 0 };
            drop(state);
            std::thread::sleep(Duration::from_millis(2));
        }
        assert_eq!(prefetcher.shared.lock().in_flight.len(), want, "{limits:?}");
    }
    Ok(())
}

#[test]
fn dropping_ends_the_threads_while_they_are_busy() -> Outcome {
    let folder = tempfile::tempdir()?;
    let views = views(folder.path())?;
    for taken in [0, 1, 7] {
        let limits = PrefetchLimits { threads: 3, ahead: 2, ..PrefetchLimits::default() };
        let mut prefetcher = Prefetcher::new(views.clone(), None, (0..COUNT).cycle(), limits);
        for _ in 0..taken {
            prefetcher.next().ok_or("end")??;
        }
        let shared = Arc::downgrade(&prefetcher.shared);
        let start = Instant::now();
        drop(prefetcher);
        // Threads hold the shared state; if it is gone, they have ended.
        assert_eq!(shared.strong_count(), 0);
        assert!(start.elapsed() < Duration::from_secs(5), "{:?}", start.elapsed());
    }
    Ok(())
}
