//! The search for what is like a box, beside the pictures.

use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::thread::JoinHandle;
use std::time::Instant;

use glam::DVec3;

use instgs_objects::register::find::{FindError, FindInput, FindOptions, FindProgress, Found, find_alike};
use instgs_vk::scene::{Camera, Gaussians, ObjectBox};

/// Parts of the work that are told apart.
const PARTS: u32 = 1000;

/// A search that goes on.
pub struct Search {
    told: Arc<Told>,
    thread: JoinHandle<Result<Found, FindError>>,
    like: u32,
    started: Instant,
}

/// What the window and the search tell each other.
#[derive(Default)]
struct Told {
    /// Of [`PARTS`].
    done: AtomicU32,
    stop: AtomicBool,
}

/// How a search ended.
#[derive(Debug)]
pub enum Searched {
    /// The repetitions, and the seconds it took.
    Found(Vec<ObjectBox>, f64),
    /// It was stopped.
    Stopped,
    /// Why nothing could be looked for: one line.
    Failed(String),
}

impl Search {
    /// Looks for what is like `object` in a cloud of the world; `cameras` saw it and may be none, `up` is a unit vector. With
    /// `other_sizes` what is like it may be of half to twice its size.
    pub fn start(cloud: Gaussians, cameras: Vec<Camera>, object: ObjectBox, up: DVec3, other_sizes: bool) -> Self {
        let told = Arc::new(Told::default());
        let (like, of_thread) = (object.id, told.clone());
        let work = move || {
            let input = FindInput { cloud: &cloud, cameras: &cameras, object: &object, up: Some(up) };
            find_alike(&input, &FindOptions::of_sizes(other_sizes), &mut |progress| of_thread.note(progress))
        };
        Self { told, thread: std::thread::spawn(work), like, started: Instant::now() }
    }

    /// The box it is about.
    pub fn like(&self) -> u32 {
        self.like
    }

    /// What part of it is done, 0 to 1.
    pub fn part(&self) -> f32 {
        self.told.done.load(Ordering::Relaxed) as f32 / PARTS as f32
    }

    /// Asks it to stop; it does so after its next step.
    pub fn stop(&self) {
        self.told.stop.store(true, Ordering::Relaxed);
    }

    /// True if [`Search::end`] does not wait.
    pub fn has_ended(&self) -> bool {
        self.thread.is_finished()
    }

    /// Waits for the end.
    pub fn end(self) -> Searched {
        match self.thread.join() {
            Ok(Ok(found)) => {
                let boxes = found.objects.into_iter().map(|found| found.object).collect();
                Searched::Found(boxes, self.started.elapsed().as_secs_f64())
            }
            Ok(Err(FindError::Stopped)) => Searched::Stopped,
            Ok(Err(error)) => Searched::Failed(error.to_string()),
            Err(_) => Searched::Failed("the search broke off: an error of the program".into()),
        }
    }
}

impl Told {
    fn note(&self, progress: FindProgress) -> ControlFlow<()> {
        let part = u64::from(PARTS) * progress.done as u64 / (progress.total as u64).max(1);
        self.done.store(part as u32, Ordering::Relaxed);
        if self.stop.load(Ordering::Relaxed) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }
}

/// A cloud without what depends on the direction of view: shapes do not need it, and it is most of the memory.
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
