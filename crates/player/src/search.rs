//! The search for objects similar to the one in a box, on a thread of its own.

use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::thread::JoinHandle;
use std::time::Instant;

use glam::DVec3;

use super::texts;
use instgs_objects::register::find::{FindError, FindInput, FindOptions, FindProgress, Found, find_alike};
use instgs_vk::scene::{Camera, Gaussians, ObjectBox};

/// Resolution of the progress: a completed search has this value.
const PARTS: u32 = 1000;

/// A search that is running or has ended.
pub struct Search {
    shared: Arc<SharedState>,
    thread: JoinHandle<Result<Found, FindError>>,
    like: u32,
    started: Instant,
}

/// State shared by the window and the search's thread.
#[derive(Default)]
struct SharedState {
    /// Progress, 0 to [`PARTS`].
    done: AtomicU32,
    stop: AtomicBool,
}

/// Result of an ended search.
#[derive(Debug)]
pub enum Searched {
    /// Boxes around the similar objects, and the duration in seconds.
    Found(Vec<ObjectBox>, f64),
    /// The user stopped the search.
    Stopped,
    /// The search could not run: a message of one line.
    Failed(String),
}

impl Search {
    /// Starts a search for objects similar to the one in box `object`, in a cloud in world coordinates. `cameras` are
    /// those of the photos, possibly none; `up` is a unit vector. With `other_sizes`, objects of half to twice the size
    /// are found, too.
    pub fn start(cloud: Gaussians, cameras: Vec<Camera>, object: ObjectBox, up: DVec3, other_sizes: bool) -> Self {
        let shared = Arc::new(SharedState::default());
        let (like, of_thread) = (object.id, shared.clone());
        let work = move || {
            let input = FindInput { cloud: &cloud, cameras: &cameras, object: &object, up: Some(up) };
            find_alike(&input, &FindOptions::of_sizes(other_sizes), &mut |progress| of_thread.note(progress))
        };
        Self { shared, thread: std::thread::spawn(work), like, started: Instant::now() }
    }

    /// Id of the box whose object is searched for.
    pub fn like(&self) -> u32 {
        self.like
    }

    /// Progress of the search, 0 to 1.
    pub fn part(&self) -> f32 {
        self.shared.done.load(Ordering::Relaxed) as f32 / PARTS as f32
    }

    /// Requests a stop, which takes effect at the search's next step.
    pub fn stop(&self) {
        self.shared.stop.store(true, Ordering::Relaxed);
    }

    /// True if [`Search::end`] returns without waiting.
    pub fn has_ended(&self) -> bool {
        self.thread.is_finished()
    }

    /// Waits for the search's thread and returns the result.
    pub fn end(self) -> Searched {
        match self.thread.join() {
            Ok(Ok(found)) => {
                let boxes = found.objects.into_iter().map(|found| found.object).collect();
                Searched::Found(boxes, self.started.elapsed().as_secs_f64())
            }
            Ok(Err(FindError::Stopped)) => Searched::Stopped,
            Ok(Err(error)) => Searched::Failed(error.to_string()),
            Err(_) => Searched::Failed(texts::SEARCH_BROKE.into()),
        }
    }
}

impl SharedState {
    fn note(&self, progress: FindProgress) -> ControlFlow<()> {
        let part = u64::from(PARTS) * progress.done as u64 / (progress.total as u64).max(1);
        self.done.store(part as u32, Ordering::Relaxed);
        if self.stop.load(Ordering::Relaxed) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }
}

/// A copy of the cloud without SH bands 1 to 3: the search does not use them, and they take most of the memory.
pub fn without_view_dependence(cloud: &Gaussians) -> Gaussians {
    Gaussians {
        sh_degree: 0,
        means: cloud.means.clone(),
        quats: cloud.quats.clone(),
        log_scales: cloud.log_scales.clone(),
        opacity_logits: cloud.opacity_logits.clone(),
        sh: cloud.sh.chunks(cloud.sh_coefficients()).map(|sh| sh[0]).collect(),
    }
}
