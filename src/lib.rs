//! The engine of instgs-vk: draws, and differentiates, scenes of 3D Gaussians with repeated objects, on Vulkan 1.3 compute.
//!
//! A scene keeps one *template* of Gaussians per kind of object. Each *instance* of it is a similarity transform and,
//! optionally, *offsets*: small differences in position, base colour, opacity and shape for every Gaussian of the template;
//! a *colour matrix*, for the light where it stands; and Gaussians of its *own*. What is not repeated is the *background*.
//! A plain 3DGS cloud is the special case "background only", so there is one scene type ([`scene::InstancedScene`]) and one
//! renderer ([`render::Renderer`]). Instances are expanded on the device, every frame, chunk by chunk, for what the camera
//! may see.
//!
//! ```no_run
//! use instgs_vk::gpu::{Gpu, GpuOptions};
//! use instgs_vk::render::{RenderOptions, Renderer};
//! use instgs_vk::scene::trajectory::Orbit;
//! use instgs_vk::scene::{Gaussians, InstancedScene};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let cloud = Gaussians {
//!     means: vec![[0.0, 0.0, 0.0], [0.5, 0.0, 0.0]],
//!     quats: vec![[1.0, 0.0, 0.0, 0.0]; 2],
//!     log_scales: vec![[-2.0; 3]; 2],
//!     opacity_logits: vec![4.0; 2],
//!     sh_degree: 0,
//!     sh: vec![[1.5, 0.0, 0.0], [0.0, 1.5, 0.0]],
//! };
//! let scene = InstancedScene::from_cloud(cloud); // or a file's, by the crate instgs-io
//! let camera = Orbit::around(&scene, None).cameras(1, (1280, 720)).remove(0);
//!
//! let gpu = Gpu::open(&GpuOptions::default())?;
//! let mut renderer = Renderer::new(&gpu)?;
//! let on_device = renderer.upload(&scene)?;
//! let stats = renderer.render(&on_device, &camera, &RenderOptions::default())?;
//! println!("{}: {} Gaussians in view", gpu.caps().name, stats.visible);
//! let picture = renderer.download()?; // rgba, depth; row by row from the top
//! # Ok(())
//! # }
//! ```
//!
//! `examples/one_picture.rs` does this with a `.ply`; `examples/into_your_image.rs` draws into an image of a program that has
//! a Vulkan device of its own. Where the crates above this one are, and what each promises, is in `docs/design.md`; words are in
//! `docs/glossary.md`.
//!
//! # What is promised
//!
//! These names stay as they are within a minor version. Everything else that is public serves the crates of this workspace (the
//! trainer, the twins, the player) and may change.
//!
//! - Scenes: [`scene::InstancedScene`], [`scene::Gaussians`], [`scene::Offsets`], [`scene::Instance`], [`scene::SourceRange`],
//!   [`scene::Group`], [`scene::Camera`], [`scene::instanced_scene::SceneError`], [`math::similarity::Similarity`], [`scene::trajectory::Orbit`];
//!   changes: [`scene::edit::Edit`], [`scene::edit::Selector`], [`scene::edit::EditError`], [`scene::edit::apply`].
//! - Device: [`gpu::Gpu`] (`open`, `from_raw`, `list`, `caps`, `wait`), [`gpu::GpuOptions`], [`gpu::DeviceChoice`],
//!   [`gpu::DeviceCaps`], [`gpu::GpuError`], [`gpu::RawDevice`], [`gpu::RequiredFeatures`], [`gpu::QueueLock`],
//!   [`gpu::ImageTarget`], [`gpu::Signal`], [`gpu::Ticket`], [`gpu::vk`].
//! - Pictures: [`render::Renderer`] (`new`, `upload`, `render`, `download`, `record_into_image`), [`render::DeviceScene`]
//!   (`place_instances`, `show_instances`, `bytes`), [`render::RenderOptions`], [`render::Picture`], [`render::FrameStats`],
//!   [`render::RenderError`], [`render::ImageFrames`], [`render::Arrived`], [`render::Show`].
//!
//! # A frame
//!
//! Left: the data, and in brackets its index. Right: the kernel that makes it, from what stands above.
//!
//! ```text
//! InstancedScene --upload--> DeviceScene: source pool = templates | own | background; instances; chunk bounds; offsets
//! Camera, RenderOptions ---> View (push constants)
//!
//!   instance_chunks   [instance]           cull_instances               chunks worth testing, 0 if out of sight
//!       | scan
//!   candidates        [candidate]          cull_chunks                  (instance, chunk) and whether it may be seen
//!       | scan
//!   work items        [work item]          emit_work_items              dense list of visible chunks
//!       |
//!   splats            [slot]               preprocess_instance_expand   Eq. 6, projection, tile count, colour
//!       | scan of survivors
//!   (depth key, slot) [0..visible]         compact_visible              dense list, flat order
//!   slots             [depth order]        radix_sort_count, _scan, _scatter: 4 digits
//!
//! once per depth slab (one, unless the intersection buffer or a tile's list would overflow):
//!   isect_offsets     [depth order]        scan of tile counts
//!   slab begin, end                        plan_slab                    the longest run that fits
//!   (tile, slot)      [intersection]       emit_intersections           depth order
//!   (tile, slot)      [sorted isect]       radix_sort_*                 by tile, stable: 1 to 3 digits
//!   tile_ranges       [tile]               tile_ranges
//!   colour, alpha, depth [pixel]           tile_blend                   front to back, onto the previous slabs
//! ```
//!
//! Everything up to and including the first slab is one submission, sized on the device by indirect arguments. The host
//! reads a few counters after it. If candidates or work items did not fit, it enlarges their buffers and redoes the frame;
//! if splats are left, it submits them slab by slab and enlarges the intersection buffer for the next frame.
//! `render/forward.rs` is this list in code.
//!
//! # Occlusion
//!
//! Off by default. With [`render::RenderOptions::occlusion`] a frame is drawn in a few depth layers, front to back. A histogram
//! of the nearest depths of visible chunks gives their bounds: each layer has as many chunks as all before it (`layer_histogram`,
//! `plan_layers`). For each layer everything from `cull_chunks` on is done; between two, `close_tiles` finds the tiles whose
//! pixels have all ended, and chunks, splats and (tile, slot) pairs behind these are left out. The picture has the same bytes,
//! since the state of a pixel between layers is exact, as between slabs. Frames in flight log what each layer needed
//! (`next_layer`). Chunks that reach through several layers are expanded in each, so it costs where little is hidden.
//!
//! # Levels of detail
//!
//! Off by default; then nothing of the above changes. With [`render::RenderOptions::lod_error_px`] above 0 a scene is
//! uploaded with coarser copies of its templates and of blocks of its background ([`scene::lod`]): Gaussians that share a
//! cell of a grid are merged, and so are every instance's offsets. Each level of each instance is an entry of its own in the
//! instance table, with the width of its cells; `cull_instances` drops all but those whose cells are narrow enough on the
//! screen, and `preprocess_instance_expand` fades one level into the next. So a frame needs no more of the host, and the
//! passes in between know nothing of levels. Training never uses them. `bench --lod` measures what they cost and save.
//!
//! # A training step
//!
//! The same forward passes, with three differences: tiles are 8x8 pixels; chunks are not culled, since means move; and the
//! tile sort carries *emission indices* (places in the list before the sort, where the entries of one splat are
//! neighbours). Then:
//!
//! ```text
//!   exposed_colors    [pixel]              apply_exposure               if photos have exposures: M rgb + b
//!   row_moments, ssim_gradients, row_gradients [channel, pixel]   image_loss_*   L1 + D-SSIM: a separable window, there and back
//!   cotangents        [pixel]              image_loss_backward_columns  dL/drgb
//!   exposures         [photo]              exposure_backward, refine_exposure, recentre_exposures   gradients back by the scene's colours; Adam
//!   status, records                        train_status                 overflow flag, loss, counts
//!   isect_moments     [emission, block]    tile_blend_backward          replay front to back: 9 sums per splat and 8x8 block
//!   shape_gradients, look_gradients [work item, local]   preprocess_instance_expand_backward   template frame; offsets go to their owner
//!   color_terms       [work item, local]   preprocess_instance_expand_backward   if instances have colour matrices
//!   gradients         [source]             gather_gradients             sums over instances, in instance order
//!   color_from_template gradients [instance] gather_color_gradients     if instances have colour matrices
//!   pose_gradients    [instance]           gather_pose_gradients        if places of instances are refined
//!   parameters, moments [source]           mcmc_regularise, adam, mcmc_noise     in place
//!   instances         [instance]           refine_poses                 in place
//! ```
//!
//! A step is one submission; two are in flight, and the host reads a record of each when it has finished. A step that
//! did not fit its buffers raises a sticky flag on the device, which turns it and all later steps into no-ops; the host
//! enlarges the buffers, lowers the flag and submits the same steps again (`instgs_train::step_runner`). Everything about a
//! step follows from its number, the seed and the configuration, so a resumed run ends in the same bytes. Between steps
//! `instgs_train::strategy` changes the number of Gaussians on the device: mark, select, scan, move.
//!
//! # Conventions
//!
//! - Frames are in names: `world_from_template` maps template to world, `view_from_world` world to camera. A transform
//!   is `x -> A x + t` with `A = s R`, s > 0 uniform, R a rotation. Lengths are scene units unless a name ends in
//!   `_px`.
//! - Eq. 6: `mean_world = A (mean_t + d_mean) + t`, `cov_world = A cov_t A^T`, SH coefficient 0 and opacity logit plus
//!   their offsets. Offsets live in the template's frame, so an instance keeps its shape when it is moved. A scene may
//!   also have offsets of log scales and quaternions (added before normalising), as the defaults train, and of the other
//!   SH coefficients; without them the kernels have no code for them.
//! - Places are refined in the template's frame: `A' = A e^s exp([w]x)`, `t' = t + A v` for the step (v, w, s).
//! - Colour = `max(0, SH + 0.5)`, or `max(0, M (SH + 0.5) + b)` for an instance with a colour matrix (M | b); rgb in the
//!   encoding of the training images (sRGB values). SH is evaluated in
//!   direction `R^T normalize(mean_world - camera)`: an instance looks the same from the same side, however it is
//!   turned.
//! - SH has INRIA's order and signs: coefficient `l^2 + l + m`, m = -l..=l, degree 0 to 3. Quaternions are (w, x, y, z)
//!   of any length but zero; users normalise. Scales are natural logarithms of standard deviations, opacities are
//!   logits.
//! - Cameras are OpenCV pinholes: x right, y down, z forward. Depth is the view-space z. Pixel (i, j) has its centre at
//!   (i + 0.5, j + 0.5); images are stored row by row from the top.
//! - Flat order: instances in file order, each in template order and then its own, then the background. It breaks ties in
//!   depth, on the device, in the twins and in `InstancedScene::flatten`.
//! - Index spaces: `source` (pool of templates, instances' own and background), `slot` (work item times work-group size plus rank),
//!   place in depth order, intersection, tile (row major), pixel (row major).
//! - Blending: alpha below 1/255 is skipped, alpha is at most 0.99, and a pixel ends before the splat that would bring
//!   its transmittance below 1e-4. Variances get 0.3 px^2 of dilation and near is 0.2 unless [`render::RenderOptions`]
//!   says otherwise.
//!
//! # Guarantees
//!
//! - Nothing is dropped. Counts saturate instead of wrapping, writes are guarded by capacities, and true totals are
//!   kept. A buffer that is too small costs time, never pixels; what exceeds the device's limits is an error that names
//!   it.
//! - Deterministic: the same scene, camera, options, build and device give the same bytes. Lists are made by scans,
//!   sorts are stable, the only atomics are integer counts. Buffer sizes and depth slabs never change
//!   a picture.
//! - Culling is conservative: it covers the whole footprint of a splat, the clamped Jacobian and the largest offset
//!   included, and removes only what cannot change a pixel. Per-instance work is one test; the rest follows what is
//!   visible.
//! - NaN and infinities in a scene do not spread: a Gaussian without a finite projection and a colour below 1e15 blends
//!   nothing and has no gradient. In training, a colour of the picture counts as at most 100, a gradient that is no number
//!   or from 1e15 on as 0.
//!
//! # Embedding
//!
//! In a program with a Vulkan device of its own (`examples/into_your_image.rs` is all of it; `examples/one_picture.rs` is the
//! short way, on a device of this crate's):
//!
//! - [`gpu::Gpu::from_raw`] takes instance, device and queue, and destroys none of them. The device needs Vulkan 1.3 with the
//!   features of [`gpu::RawDevice::required_features`] (and subgroup vote, ballot and shuffle in compute), and no extension but
//!   `VK_KHR_portability_subset` where it is offered. Drawing needs 23 storage buffers per stage, training 30; what lacks
//!   them fails when the first kernel that needs more is made, and names it.
//! - The queue is shared: uploads, downloads and [`render::Renderer::render`] submit to it, each under the caller's
//!   [`gpu::QueueLock`], or while the caller leaves the queue alone.
//! - [`render::Renderer::record_into_image`] records a whole picture into the caller's command buffer, up to a copy into the
//!   caller's `vk::Image`. It neither submits nor waits. Before: any layout, usage `TRANSFER_DST`. After: the layout
//!   asked for, visible to everything later in the queue, and to the host. The caller submits in the order of
//!   recording, and signals the timeline semaphore and value that it was given.
//! - [`render::ImageFrames::poll`] says what became of each picture. If a buffer was too small, the image holds the last
//!   complete picture (or black), and the next one is recorded with larger buffers; if that cannot help, an error
//!   says what there is too much of.
//! - [`render::Renderer::submit_readback`] copies a picture to the host while the next one is drawn;
//!   [`render::Readback::poll`] has its pixels.
//! - Buffers, scenes and renderers may be dropped while the device uses them: the memory goes when it is done.
//!
//! # Adding a pass, adding a parameter
//!
//! A pass `foo`:
//!
//! - `glsl/foo.comp`: the shader. It opens with a comment that says what it does, what it reads and writes, its grid, and
//!   the twin and the test it has. `build.rs` compiles and reflects it and generates the module `kernels::foo`, with that
//!   comment as its documentation and `Params` and `Bindings` as Rust types: a `readonly` buffer is a `&` field, any
//!   other a `&mut` field, and the recorder derives barriers from that.
//! - `kernels/pipelines.rs`: its pipeline, in the struct of those that are compiled together.
//! - `render/` (or the trainer's `strategy/`, `optim/`): the dispatch.
//! - `dev/reference`: the f64 twin, and `tests/kernels`: the test that compares the two. Kernels that are steps of one
//!   algorithm share them, as the shader's comment says.
//!
//! An array that training may change is one line of [`scene::Parameter`]: upload, download, gradients, Adam, checkpoints and sizes
//! in bytes follow from it.
#![deny(clippy::print_stdout, clippy::print_stderr)]

pub mod gpu;
pub mod kernels;
pub mod math;
pub mod optim;
pub mod render;
pub mod scene;
