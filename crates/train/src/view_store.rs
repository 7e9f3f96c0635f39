//! Views decoded in parallel and handed over in order, with bounded host memory.
//!
//! [`load_all`] goes once over all views, for a trainer that keeps them on the device. [`Prefetcher`] follows a given
//! sequence, for datasets that do not fit there. Both use one mechanism: workers claim the entries of the sequence in
//! order, as long as the images in flight (being decoded, or decoded and not taken yet) fit their budget. The next
//! entry to be returned is claimed whatever its size, so a budget that is too small only costs time.

use std::collections::{HashMap, VecDeque};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;

use instgs_io::host_memory::available_bytes;
use instgs_io::{IoError, LoadedView, View, load_view};

/// Host bytes per pixel while decoding: 8 from the decoder (16 bits, four channels), 4 as RGBA, 4 undistorted.
const DECODE_BYTES_PER_PIXEL: u64 = 16;

/// Limits on the threads and memory of a [`Prefetcher`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PrefetchLimits {
    /// Number of worker threads. 0: images are decoded only when they are asked for.
    pub threads: usize,
    /// Upper bound of the entries of the sequence in flight; 0 counts as 1.
    pub ahead: usize,
    /// Host bytes of images in flight, decoding included. One image is always allowed.
    pub ahead_bytes: u64,
    /// Host bytes of images kept for their next use. The first images that fit stay for good, so that every shuffled
    /// epoch finds all of them; a least-recently-used cache would have evicted most of them before their next use.
    pub cache_bytes: u64,
}

/// Images in flight may take one part in this many of the spare memory, within the bounds: a photo of 20 million pixels
/// takes 320 MB while it is decoded, and every thread should have one.
const AHEAD_PART: u64 = 8;
const AHEAD_BYTES: [u64; 2] = [256 << 20, 4 << 30];
/// Cached images may take one part in this many of the spare memory.
const CACHE_PART: u64 = 4;

impl Default for PrefetchLimits {
    /// One thread per CPU, an eighth of the machine's spare memory in flight (256 MiB to 4 GiB), no cache.
    fn default() -> Self {
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        let [least, most] = AHEAD_BYTES;
        let ahead_bytes = (available_bytes().unwrap_or(0) / AHEAD_PART).clamp(least, most);
        Self { threads, ahead: 4 * threads, ahead_bytes, cache_bytes: 0 }
    }
}

impl PrefetchLimits {
    /// The default, with a cache of a quarter of the machine's spare memory: for images that are decoded repeatedly,
    /// next to a device with memory of its own.
    pub fn with_cache() -> Self {
        Self { cache_bytes: available_bytes().unwrap_or(0) / CACHE_PART, ..Self::default() }
    }
}

/// Decodes all views at the given width (see [`load_view`]), several at a time, and calls `on_loaded` with (index in
/// `views`, view) on this thread, in order. Stops at the first error in that order, of a view or of `on_loaded`.
pub fn load_all<E: From<IoError>>(
    views: &[View],
    width: Option<u32>,
    limits: PrefetchLimits,
    on_loaded: &mut dyn FnMut(usize, LoadedView) -> Result<(), E>,
) -> Result<(), E> {
    let limits = PrefetchLimits { cache_bytes: 0, ..limits };
    for loaded in Prefetcher::new(views.to_vec(), width, 0..views.len(), limits) {
        let (index, view) = loaded?;
        on_loaded(index, Arc::unwrap_or_clone(view))?;
    }
    Ok(())
}

/// An iterator over the views of a sequence, decoded ahead in the background. An entry that fails is an error, and the
/// iterator continues with the next. Dropping the iterator ends the threads once their current images are decoded.
pub struct Prefetcher {
    shared: Arc<Shared>,
    workers: Vec<JoinHandle<()>>,
}

type Loaded = Result<(usize, Arc<LoadedView>), IoError>;

struct Shared {
    views: Vec<View>,
    width: Option<u32>,
    limits: PrefetchLimits,
    state: Mutex<State>,
    /// Signalled at every change of the state that a thread may wait for.
    changed: Condvar,
}

struct State {
    sequence: Box<dyn Iterator<Item = usize> + Send>,
    /// Peeked entry of the sequence: the next to be claimed.
    next: Option<usize>,
    /// Claimed entries that have not been returned yet, in order; `None` while being decoded.
    in_flight: VecDeque<(u64, Option<Loaded>)>,
    bytes_in_flight: u64,
    /// Number of the entry at the front of `in_flight`, counted from the start of the sequence.
    front: u64,
    cache: HashMap<usize, Arc<LoadedView>>,
    cached_bytes: u64,
    stopped: bool,
}

/// An entry to decode: its number in the sequence, and the index of the view.
struct Job {
    number: u64,
    view: usize,
}

impl Prefetcher {
    /// Starts decoding `views` at the given width (see [`load_view`]) in the order of `sequence`, which holds indices
    /// into `views` and may be endless; it ends at the first index out of range. The sequence is advanced on the
    /// workers' threads and must not panic.
    pub fn new(
        views: Vec<View>,
        width: Option<u32>,
        sequence: impl Iterator<Item = usize> + Send + 'static,
        limits: PrefetchLimits,
    ) -> Self {
        let count = views.len();
        let mut sequence: Box<dyn Iterator<Item = usize> + Send> = Box::new(sequence.take_while(move |&i| i < count));
        let state = State {
            next: sequence.next(),
            sequence,
            in_flight: VecDeque::new(),
            bytes_in_flight: 0,
            front: 0,
            cache: HashMap::new(),
            cached_bytes: 0,
            stopped: false,
        };
        let shared = Arc::new(Shared { views, width, limits, state: Mutex::new(state), changed: Condvar::new() });
        let start = |i: usize| {
            let shared = Arc::clone(&shared);
            let work = move || while shared.work(true) {};
            // A thread that cannot be started is missed only in speed; without any, `next` decodes itself.
            std::thread::Builder::new().name(format!("views-{i}")).spawn(work).ok()
        };
        let workers = (0..limits.threads).filter_map(start).collect();
        Self { shared, workers }
    }

    /// Bytes of the cached images; at most `cache_bytes`.
    pub fn cached_bytes(&self) -> u64 {
        self.shared.lock().cached_bytes
    }
}

impl Iterator for Prefetcher {
    type Item = Loaded;

    fn next(&mut self) -> Option<Loaded> {
        if self.workers.is_empty() {
            self.shared.work(false);
        }
        let mut state = self.shared.lock();
        loop {
            let ended = state.next.is_none();
            match state.in_flight.front_mut() {
                Some((bytes, loaded @ Some(_))) => {
                    let (bytes, loaded) = (*bytes, loaded.take());
                    state.in_flight.pop_front();
                    state.front += 1;
                    state.bytes_in_flight -= bytes;
                    self.shared.changed.notify_all();
                    return loaded;
                }
                None if ended => return None,
                _ => state = self.shared.wait(state),
            }
        }
    }
}

impl Drop for Prefetcher {
    fn drop(&mut self) {
        self.shared.lock().stopped = true;
        self.shared.changed.notify_all();
        // A worker catches its panics, so `join` returns no error.
        self.workers.drain(..).for_each(|worker| drop(worker.join()));
    }
}

impl Shared {
    /// The state is consistent at every statement that may panic, so a poisoned lock can be used.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn wait<'a>(&self, state: MutexGuard<'a, State>) -> MutexGuard<'a, State> {
        self.changed.wait(state).unwrap_or_else(PoisonError::into_inner)
    }

    /// Claims and decodes one entry; false if there is none to claim. `wait_for_room` waits for room in the budget.
    fn work(&self, wait_for_room: bool) -> bool {
        let mut state = self.lock();
        let job = loop {
            if state.stopped || state.next.is_none() {
                return false;
            }
            if let Some(job) = self.claim(&mut state) {
                break job;
            }
            if !wait_for_room {
                return false;
            }
            state = self.wait(state);
        };
        let cached = state.cache.get(&job.view).cloned();
        drop(state);
        let loaded = match cached {
            Some(view) => Ok(view),
            None => self.decode(job.view),
        };
        self.deliver(job, loaded);
        true
    }

    /// Claims the next entry of the sequence if the budget has room for it.
    fn claim(&self, state: &mut State) -> Option<Job> {
        let view = state.next?;
        let camera = &self.views[view].camera;
        let cached = state.cache.contains_key(&view);
        let pixels = u64::from(camera.width) * u64::from(camera.height);
        let bytes = if cached { 0 } else { pixels.saturating_mul(DECODE_BYTES_PER_PIXEL) };
        let fits = state.in_flight.len() < self.limits.ahead
            && state.bytes_in_flight.saturating_add(bytes) <= self.limits.ahead_bytes;
        if !(fits || state.in_flight.is_empty()) {
            return None;
        }
        let number = state.front + state.in_flight.len() as u64;
        state.in_flight.push_back((bytes, None));
        state.bytes_in_flight += bytes;
        state.next = state.sequence.next();
        Some(Job { number, view })
    }

    /// A decoder that panics becomes an error of that file: other images wait, and `next` waits for this one.
    fn decode(&self, view: usize) -> Result<Arc<LoadedView>, IoError> {
        let view = &self.views[view];
        catch_unwind(AssertUnwindSafe(|| load_view(view, self.width)))
            .unwrap_or_else(|_| Err(IoError::new(&view.image_path, "cannot decode the image: its decoder panicked")))
            .map(Arc::new)
    }

    fn deliver(&self, job: Job, loaded: Result<Arc<LoadedView>, IoError>) {
        let mut state = self.lock();
        let bytes = loaded.as_ref().map_or(0, |l| l.image.bytes());
        if let Ok(view) = &loaded
            && bytes <= self.limits.cache_bytes.saturating_sub(state.cached_bytes)
            && !state.cache.contains_key(&job.view)
        {
            state.cached_bytes += bytes;
            state.cache.insert(job.view, Arc::clone(view));
        }
        // Cached images are counted in the cache.
        let bytes = if state.cache.contains_key(&job.view) { 0 } else { bytes };
        let place = (job.number - state.front) as usize;
        let before = state.in_flight[place].0;
        state.in_flight[place] = (bytes, Some(loaded.map(|l| (job.view, l))));
        state.bytes_in_flight = state.bytes_in_flight - before + bytes;
        drop(state);
        self.changed.notify_all();
    }
}

#[cfg(test)]
#[path = "view_store_tests.rs"]
mod tests;
