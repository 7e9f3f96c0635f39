//! A caller's device, command buffers and images: the same pictures as of the crate's own device, and defined outcomes where a
//! buffer is too small. Read-backs that nobody waits for.

#[path = "../../examples/headless/mod.rs"]
mod headless;

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use glam::DVec3;
use instgs_vk::gpu::{DeviceChoice, Gpu, GpuError, GpuOptions, ImageTarget, Pipeline, PipelineCache, vk};
use instgs_vk::kernels::preprocess_instance_expand_backward::PreprocessInstanceExpandBackward;
use instgs_vk::math::similarity::Similarity;
use instgs_vk::render::{
    Arrived, Capacities, DeviceScene, ImageFrames, Readback, RenderError, RenderOptions, Renderer,
};
use instgs_vk::scene::trajectory::Orbit;
use instgs_vk::scene::{Camera, InstancedScene};

use self::headless::Headless;
use crate::common::gpu::{assert_silent, gpu};
use crate::common::random_scene::random_case;

const SIZE_PX: [u32; 2] = [64, 48];
const BLACK: [u8; 4] = [0, 0, 0, 255];

/// A device of the caller's next to that of the tests, with the same instance and so the same validation layers.
fn callers(gpu: &Gpu, format: vk::Format) -> Headless {
    let (entry, instance, physical) = (gpu.raw_entry(), gpu.raw_instance(), gpu.raw_physical_device());
    // SAFETY: the handles are of one another, and `gpu` lives as long as the test.
    unsafe { Headless::new(entry, instance, physical, SIZE_PX, format) }.unwrap()
}

/// What the tests of this file record into images with.
struct Embedded {
    renderer: Renderer,
    frames: ImageFrames,
    scene: DeviceScene,
}

impl Embedded {
    fn new(raw: &Headless, seed: u64) -> Self {
        // SAFETY: the device has what is required, only this thread uses the queue, and the device outlives all of this.
        let gpu = unsafe { Gpu::from_raw(raw.raw.clone()) }.unwrap();
        let renderer = Renderer::new(&gpu).unwrap();
        let scene = renderer.upload(&random_case(seed).scene).unwrap();
        Self { frames: ImageFrames::new(&renderer, 1).unwrap(), renderer, scene }
    }

    /// Records and submits a picture, and waits for it.
    fn picture(&mut self, caller: &Headless, camera: &Camera, options: &RenderOptions) -> Result<Arrived, RenderError> {
        // SAFETY: the last submission is over, and this one signals what it must.
        unsafe {
            let commands = caller.begin().unwrap();
            let Self { renderer, frames, scene } = self;
            let signal = renderer.record_into_image(frames, commands, scene, camera, options, &caller.target)?;
            caller.submit(signal).unwrap();
        }
        Ok(self.frames.wait(&mut self.renderer)?.unwrap())
    }
}

/// The image's pixels as red, green, blue, alpha.
fn rgba(caller: &Headless) -> Vec<[u8; 4]> {
    // SAFETY: a picture has arrived.
    let bytes = unsafe { caller.bytes() }.unwrap();
    let blue_first = caller.target.format == vk::Format::B8G8R8A8_UNORM;
    let ordered = |p: &[u8]| if blue_first { [p[2], p[1], p[0], p[3]] } else { [p[0], p[1], p[2], p[3]] };
    bytes.chunks_exact(4).map(ordered).collect()
}

/// What `Renderer::render` makes of it, as bytes.
fn wanted(gpu: &Arc<Gpu>, scene: &InstancedScene, camera: &Camera, options: &RenderOptions) -> (u64, Vec<[u8; 4]>) {
    let mut renderer = Renderer::new(gpu).unwrap();
    let scene = renderer.upload(scene).unwrap();
    let stats = renderer.render(&scene, camera, options).unwrap();
    let rgb = renderer.download().unwrap().rgb8();
    (stats.visible, rgb.chunks_exact(3).map(|p| [p[0], p[1], p[2], 255]).collect())
}

fn camera_of(seed: u64) -> Camera {
    random_case(seed).camera.resized(SIZE_PX[0], SIZE_PX[1])
}

#[test]
fn a_callers_image_gets_the_picture_of_render() {
    let Some(gpu) = gpu() else { return };
    for (seed, format) in [(4, vk::Format::R8G8B8A8_UNORM), (8, vk::Format::B8G8R8A8_UNORM)] {
        let (camera, options) = (camera_of(seed), RenderOptions { background: [0.2, 0.4, 0.9], ..Default::default() });
        let (visible, want) = wanted(&gpu, &random_case(seed).scene, &camera, &options);
        assert!(visible > 0);
        let mut caller = callers(&gpu, format);
        let locked = Arc::new(AtomicU32::new(0));
        let counter = locked.clone();
        caller.raw.queue_lock = Some(Arc::new(move |work| {
            counter.fetch_add(1, Ordering::SeqCst);
            work();
        }));
        let mut embedded = Embedded::new(&caller, seed);
        assert!(locked.load(Ordering::SeqCst) > 0, "uploads take the caller's lock");
        let before = locked.load(Ordering::SeqCst);
        for _ in 0..3 {
            let Arrived::Complete(stats) = embedded.picture(&caller, &camera, &options).unwrap() else {
                panic!("the first capacities hold this scene")
            };
            assert_eq!((stats.visible, stats.slabs), (visible, 1));
            assert_eq!(rgba(&caller), want, "seed {seed}");
        }
        assert_eq!(locked.load(Ordering::SeqCst), before, "recording does not submit");
        // The same renderer renders by itself, too.
        embedded.renderer.render(&embedded.scene, &camera, &options).unwrap();
        let rgb: Vec<_> = want.iter().flat_map(|p| [p[0], p[1], p[2]]).collect();
        assert_eq!(embedded.renderer.download().unwrap().rgb8(), rgb);
        drop(embedded);
        // SAFETY: everything that was made from the device is gone.
        unsafe { caller.destroy() };
    }
    assert_silent(&gpu);
}

/// Every kind of buffer may be too small: the image is black, then the buffers grow until it is right; the last complete picture
/// stays when a later one is incomplete.
#[test]
fn incomplete_pictures_are_told_of_and_the_next_ones_grow() {
    let Some(gpu) = gpu() else { return };
    let (camera, options) = (camera_of(8), RenderOptions::default());
    let (_, want) = wanted(&gpu, &random_case(8).scene, &camera, &options);
    let caller = callers(&gpu, vk::Format::R8G8B8A8_UNORM);
    let mut embedded = Embedded::new(&caller, 8);
    embedded.renderer.set_capacities(Capacities { candidates: 1, work_items: 1, intersections: 1 });
    let mut incomplete = 0;
    while embedded.picture(&caller, &camera, &options).unwrap() == Arrived::Incomplete {
        assert!(rgba(&caller).iter().all(|pixel| *pixel == BLACK), "after {incomplete}");
        incomplete += 1;
    }
    assert!((1..=3).contains(&incomplete), "{incomplete}");
    assert_eq!(rgba(&caller), want);
    embedded.renderer.set_capacities(Capacities { candidates: 1, work_items: 1, intersections: 1 });
    assert_eq!(embedded.picture(&caller, &camera, &options).unwrap(), Arrived::Incomplete);
    assert_eq!(rgba(&caller), want, "the last complete picture");
    drop(embedded);

    // More than one slab is allowed to hold: an error, not an image that stays as it is for ever.
    let mut embedded = Embedded::new(&caller, 8);
    let few = RenderOptions { max_intersections: Some(1), ..options };
    let error = loop {
        match embedded.picture(&caller, &camera, &few) {
            Ok(arrived) => assert_eq!(arrived, Arrived::Incomplete),
            Err(error) => break error,
        }
    };
    assert!(matches!(error, RenderError::TooMany { .. }), "{error}");
    drop(embedded);
    // SAFETY: everything that was made from the device is gone.
    unsafe { caller.destroy() };
    assert_silent(&gpu);
}

#[test]
fn what_is_not_submitted_is_forgotten_and_too_many_are_refused() {
    let Some(gpu) = gpu() else { return };
    let (camera, options) = (camera_of(4), RenderOptions::default());
    let caller = callers(&gpu, vk::Format::R8G8B8A8_UNORM);
    let mut embedded = Embedded::new(&caller, 4);
    let Embedded { renderer, frames, scene } = &mut embedded;
    // What is not submitted does not move the instance on the device either; the next picture does.
    let mut moved = random_case(4).scene;
    let place = &mut moved.instances[0].world_from_template;
    let shifted = place.translation() + 0.1 * DVec3::X;
    *place = Similarity::from_parts(place.rotation(), place.scale(), shifted);
    scene.place_instances(&[(0, *place)]).unwrap();
    // SAFETY: nothing of this is submitted.
    unsafe {
        let commands = caller.begin().unwrap();
        let record = |frames: &mut ImageFrames, renderer: &mut Renderer, target: &ImageTarget| {
            renderer.record_into_image(frames, commands, scene, &camera, &options, target).map(|_| ())
        };
        let odd = ImageTarget { format: vk::Format::R16G16B16A16_SFLOAT, ..caller.target };
        let error = record(frames, renderer, &odd).unwrap_err();
        assert!(matches!(error, RenderError::Gpu(GpuError::Recording { .. })), "{error}");
        record(frames, renderer, &caller.target).unwrap();
        assert_eq!(frames.poll(renderer).unwrap(), None, "it is not over");
        let error = record(frames, renderer, &caller.target).unwrap_err();
        assert!(matches!(error, RenderError::Busy { pending: 1 }), "{error}");
        caller.begin().unwrap();
        frames.forget_last().unwrap();
    }
    assert_eq!(frames.pending_len(), 0);
    assert!(matches!(embedded.picture(&caller, &camera, &options), Ok(Arrived::Complete(_))));
    assert_eq!(rgba(&caller), wanted(&gpu, &moved, &camera, &options).1);
    assert_ne!(rgba(&caller), wanted(&gpu, &random_case(4).scene, &camera, &options).1, "it is seen to move");
    drop(embedded);
    // SAFETY: everything that was made from the device is gone.
    unsafe { caller.destroy() };
    assert_silent(&gpu);
}

#[test]
fn read_backs_hold_the_picture_that_was_there_when_they_were_submitted() {
    let Some(gpu) = gpu() else { return };
    let case = random_case(4);
    let mut renderer = Renderer::new(&gpu).unwrap();
    let scene = renderer.upload(&case.scene).unwrap();
    let (mut first, mut second) = (Readback::new(&gpu).unwrap(), Readback::new(&gpu).unwrap());
    assert!(!renderer.submit_readback(&mut first).unwrap(), "there is no picture");
    assert_eq!(first.wait().unwrap(), None);
    let mut cameras = Orbit::around(&case.scene, None).cameras(4, (64, 48));
    cameras[2] = cameras[2].resized(33, 17);
    let options = RenderOptions::default();
    for pair in cameras.chunks_exact(2) {
        let mut want = Vec::new();
        for (camera, readback) in pair.iter().zip([&mut first, &mut second]) {
            renderer.render(&scene, camera, &options).unwrap();
            assert!(renderer.submit_readback(readback).unwrap());
            assert!(matches!(renderer.submit_readback(readback), Err(RenderError::Busy { .. })));
            want.push(renderer.download().unwrap());
        }
        // The download waited for everything before it.
        assert_eq!(first.poll().unwrap().as_ref(), Some(&want[0]));
        assert_eq!(second.wait().unwrap().as_ref(), Some(&want[1]));
        assert_eq!(second.poll().unwrap(), None, "it was taken");
    }
    assert_silent(&gpu);
}

/// A device that binds 23 storage buffers draws; training says which kernel needs more, and with fewer drawing does.
#[test]
fn drawing_does_not_ask_for_what_training_needs() {
    if gpu().is_none() {
        return;
    }
    let device = std::env::var("INSTGS_TEST_DEVICE").map_or(DeviceChoice::Best, |name| name.parse().unwrap());
    let with = |most: u32| {
        let (device, most_storage_buffers) = (device.clone(), Some(most));
        Gpu::open(&GpuOptions { device, validation: true, most_storage_buffers, ..Default::default() }).unwrap()
    };
    let case = random_case(4);
    let draw = |gpu: &Arc<Gpu>| {
        let mut renderer = Renderer::new(gpu)?;
        let scene = renderer.upload(&case.scene)?;
        renderer.render(&scene, &case.camera, &RenderOptions::default())
    };
    let enough = with(23);
    draw(&enough).unwrap();
    let cache = PipelineCache::new(&enough, None).unwrap();
    let size = enough.caps().subgroup_sizes()[0];
    match Pipeline::<PreprocessInstanceExpandBackward>::new(&enough, &cache, size, &[]).err() {
        Some(GpuError::TooManyBindings { kernel, needed, limit: 23, .. }) => {
            assert_eq!((kernel.as_str(), needed), ("preprocess_instance_expand_backward", 30));
        }
        other => panic!("{other:?}"),
    }
    assert_silent(&enough);
    let error = draw(&with(22)).unwrap_err();
    let named = matches!(&error, RenderError::Gpu(GpuError::TooManyBindings { kernel, needed: 23, limit: 22, .. })
        if kernel == "preprocess_instance_expand");
    assert!(named, "{error}");
}
