//! instgs-vk: Gaussian splatting of scenes with repeated objects, on Vulkan 1.3 compute.
//!
//! A scene keeps one *template* of Gaussians per kind of object. Each *instance* of it is a similarity transform and,
//! optionally, *offsets*: small differences in position, base colour and opacity for every Gaussian of the template.
//! What is not repeated is the *background*. A plain 3DGS cloud is the special case "background only", so there is one
//! scene type ([`scene::InstancedScene`]) and one renderer ([`render::Renderer`]). Instances are expanded on the
//! device, every frame, chunk by chunk, for what the camera may see.
//!
//! # A frame
//!
//! Left: the data, and in brackets its index. Right: the kernel that makes it, from what stands above.
//!
//! ```text
//! InstancedScene --upload--> DeviceScene: source pool = templates | background; instances; chunk bounds; offsets
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
//!   slots             [depth order]        radix_sort_count, scan, radix_sort_scatter: 4 digits
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
//! reads 16 counters after it. If candidates or work items did not fit, it enlarges their buffers and redoes the frame;
//! if splats are left, it submits them slab by slab and enlarges the intersection buffer for the next frame.
//! `render/forward.rs` is this list in code.
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
//! The same forward passes, with two differences: chunks are not culled, since means move, and the tile sort carries
//! *emission indices* (places in the list before the sort, where the entries of one splat are neighbours). Then:
//!
//! ```text
//!   row_moments, ssim_gradients, row_gradients [pixel]   image_loss_*   L1 + D-SSIM: a separable window, there and back
//!   cotangents        [pixel]              image_loss_backward_columns  dL/drgb
//!   status, records                        train_status                 overflow flag, loss, counts
//!   isect_moments     [emission, block]    tile_blend_backward          replay front to back: 9 sums per splat and 8x8 block
//!   source_gradients  [work item, local]   preprocess_instance_expand_backward   template frame; offsets go to their owner
//!   gradients         [source]             gather_gradients             sums over instances, in instance order
//!   pose_gradients    [instance]           gather_pose_gradients        if places of instances are refined
//!   parameters, moments [source]           mcmc_regularise, adam, mcmc_noise     in place
//!   instances         [instance]           refine_poses                 in place
//! ```
//!
//! A step is one submission; two are in flight, and the host reads a record of each when it has finished. A step that
//! did not fit its buffers raises a sticky flag on the device, which turns it and all later steps into no-ops; the host
//! enlarges the buffers, lowers the flag and submits the same steps again ([`train::step_runner`]). Everything about a
//! step follows from its number, the seed and the configuration, so a resumed run ends in the same bytes. Between steps
//! [`train::strategy`] changes the number of Gaussians on the device: mark, select, scan, move.
//!
//! # From photos and masks to an instanced scene
//!
//! `train --method instgs` ([`mod@train::prepare`], `cli/train/instanced.rs`); each stage leaves a file in the run folder. The
//! commands `segment`, `register` and `merge` (`cli/stages/`) call the same functions on a folder of the same layout:
//!
//! ```text
//!   masks/                      given; or, from words, by detect, before all else; or, from boxes, by segment::boxes, after
//!                               the next
//!   vanilla/, point_cloud.ply   a plain cloud, by the steps above (or given)
//!   cameras.json                the training views', which the next two files count by
//!   consensus.json              mask_contribution per view: how much of every mask each Gaussian makes up;
//!                               segment::consensus: which masks are of one object, where ids differ from view to view
//!   labels.safetensors          segment::label: the object whose pixels a Gaussian feeds more than 0.8 times all others
//!   groups.json                 given, or register: which objects are alike, and where they stand; none may be
//!   initial.instgs              template::build: objects in their group's frame, as many Gaussians as they have on
//!                               average drawn from all of them; offsets from each template Gaussian to its match
//!   review.html                 every view with its masks and the objects that they show
//!   stages/*.png                train::stage_pictures: what each of these did, to be looked at; also in report.html
//!   scene.instgs                the joint phase: templates, offsets, background and places learn together
//! ```
//!
//! # Layers
//!
//! A module uses only modules of lower layers; `tests/suite/architecture.rs` checks it.
//!
//! - L0 `math`: spherical harmonics, covariances, similarities, lens distortion, nearest points, planes, seeded random
//!   numbers.
//! - L1 `gpu`: the only module that speaks Vulkan: device, buffers, pipelines, recorder with derived barriers,
//!   profiler, and the kernels' interfaces as Rust types, generated from the GLSL by `build.rs`.
//! - L1 `scene`: plain CPU data: Gaussians, offsets, instances, cameras, trajectories, flattening, editing, levels of detail.
//! - L2 `reference`: f64 twins of the kernels, slow and obvious.
//! - L2 `io`: files: `.instgs`, `.ply`, `.spz`, `.splat`, `.glb`, cameras, COLMAP,
//!   `transforms.json`, photos (undistorted, downscaled), instance masks, `groups.json`, points, checkpoints, KTX2.
//! - L2 `kernels`: one page per kernel, the compiled pipelines, and the variant (sizes) picked for a device.
//! - L3 `render`: scene on the device, buffer plan, the passes in order (forward and backward), growth and depth slabs,
//!   self-test.
//! - L3 `optim`: Adam, one state per parameter buffer.
//! - L4 `detect`: instance masks from a text prompt, by ONNX models whose runtime is loaded when it is used.
//! - L4 `segment`: which Gaussians of a plain cloud belong to which object, from masks; masks from boxes; what stands at a
//!   place.
//! - L4 `register`: which objects are alike, and the pose of each against its group's reference.
//! - L4 `eval`: PSNR, SSIM, LPIPS of rendered views against photos.
//! - L4 `template`: templates, instances and first offsets from a labelled cloud and posed groups; pruning.
//! - L5 `synth`: procedural scenes, and ray-traced data sets with known poses, among them that of `instgs-vk demo`.
//! - L5 `train`: configuration, start, steps, densification, checkpoints, events, report.
//! - L6 `bench`: measurements and their report; `evidence` makes the tables and plots of many of them.
//! - L6 `player`: a window on a scene: navigation, editing, boxes around objects, what is written over the picture, pictures
//!   without a window.
//! - L7 `cli`: the command line, one file per subcommand, one printer. Only this layer prints.
//!
//! # Conventions
//!
//! - Frames are in names: `world_from_template` maps template to world, `view_from_world` world to camera. A transform
//!   is `x -> A x + t` with `A = s R`, s > 0 uniform, R a rotation. Lengths are scene units unless a name ends in
//!   `_px`.
//! - Eq. 6: `mean_world = A (mean_t + d_mean) + t`, `cov_world = A cov_t A^T`, SH coefficient 0 and opacity logit plus
//!   their offsets. Offsets live in the template's frame, so an instance keeps its shape when it is moved. For ablations a
//!   scene may also have offsets of the other SH coefficients, log scales and quaternions (added before normalising);
//!   without them the kernels have no code for them.
//! - Places are refined in the template's frame: `A' = A e^s exp([w]x)`, `t' = t + A v` for the step (v, w, s).
//! - Colour = `max(0, SH + 0.5)`, rgb in the encoding of the training images (sRGB values). SH is evaluated in
//!   direction `R^T normalize(mean_world - camera)`: an instance looks the same from the same side, however it is
//!   turned.
//! - SH has INRIA's order and signs: coefficient `l^2 + l + m`, m = -l..=l, degree 0 to 3. Quaternions are (w, x, y, z)
//!   of any length but zero; users normalise. Scales are natural logarithms of standard deviations, opacities are
//!   logits.
//! - Cameras are OpenCV pinholes: x right, y down, z forward. Depth is the view-space z. Pixel (i, j) has its centre at
//!   (i + 0.5, j + 0.5); images are stored row by row from the top.
//! - Flat order: instances in file order, each in template order, then the background. It breaks ties in depth, on the
//!   device, in the twins and in `InstancedScene::flatten`.
//! - Index spaces: `source` (pool of templates and background), `slot` (work item times work-group size plus rank),
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
//!   `VK_KHR_portability_subset` where it is offered. Drawing needs 21 storage buffers per stage, training 26; what lacks
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
//! # Adding a pass `foo`
//!
//! Four files and one call: `glsl/foo.comp`, `src/kernels/foo.rs` (its page, and the re-export of its generated types),
//! `src/reference/foo.rs` (the f64 twin), `tests/kernels/foo.rs`, and the dispatch in `render/`. The lists that name it
//! are `kernels/mod.rs`, `kernels/pipelines.rs`, `reference/mod.rs` and `tests/kernels/main.rs`. `build.rs` compiles
//! and reflects the shader and generates `Params` and `Bindings`; a `readonly` buffer is a `&` field, any other a
//! `&mut` field, and the recorder derives barriers from that. Kernels that are steps of one algorithm may share a twin
//! and a test: `tests/suite/architecture.rs` lists them and fails if a file is missing.
//!
//! # Tests and tolerances
//!
//! - `tests/suite/golden_reference.rs`: the twins against golden files of an independent implementation: 1e-12 in f64, 1e-6
//!   for scenes rounded to f32.
//! - `tests/suite/golden_gradients.rs`, `tests/suite/gradients.rs`: the twins' gradients against those files (1e-11) and against central
//!   differences of the twins themselves (1e-4), for every kind of parameter, transforms of instances included.
//! - `tests/suite/cli_train.rs`: whole runs as a user starts them: a floor of quality, the same bytes twice, after kills too, and
//!   every kind of bad input.
//! - `tests/suite/cli_instanced.rs`: the joint phase on a small ray-traced data set: quality, the same bytes twice and after a kill,
//!   and the comparison's rows. `tests/suite/segment.rs`, `tests/suite/consensus.rs`, `tests/suite/template.rs`: labels, objects and
//!   templates against known truth.
//! - `tests/suite/boxes.rs`: masks from boxes in the world and in photos, with ids and without, against known objects.
//! - `tests/suite/cli_stages.rs`: `segment`, `register` and `merge` give what `train` starts from, byte for byte; bad masks are named
//!   before anything is trained, and of what cannot be shared the rest comes out.
//! - `tests/suite/detect.rs`: masks from a prompt within 1e-3 of PyTorch and transformers, on tiny models. What runs models says
//!   aloud that it did not run where there is no ONNX Runtime library, and fails with `INSTGS_NEED_ONNXRUNTIME=1`.
//! - `tests/suite/stage_pictures.rs`: colours of objects, and wrong poses, in the report's pictures.
//! - `tests/kernels/`: the kernels against the twins, on the device. Integer passes must be equal; colour and alpha of
//!   whole frames are within 1e-4 of the twins and of the golden files, a flattened scene within 5e-4 of the instanced
//!   one, and repeated frames identical. `tests/common/` holds the comparison.
//! - Gradients are within 1e-3 of the twins and of the golden files, in relative L2 per tensor; the image loss and its
//!   gradient within 1e-5, 1e-4 where its windows have no variance. Training steps give the same bytes when repeated and
//!   whatever the sizes of buffers.
//! - `tests/kernels/embedding.rs`: on a device and in images of a caller's, the same bytes; too small buffers are told of.
//! - `tests/kernels/lod.rs`: levels of detail within 1e-4 of the twin, full quality the same bytes, no jump where levels change.
//! - Pixels where f32 may rightly decide otherwise (alpha near 1/255, depths nearly equal, and the like) are excluded
//!   by the `robust` mask, at most 2 % of an image. Planted errors prove that the comparisons can fail.
//! - GPU tests run with validation and synchronisation validation, and any message fails them. Without a device they
//!   fail, unless `INSTGS_SKIP_GPU=1` is set. `tools/test` repeats them on lavapipe at subgroup sizes 4, 8 and, with AVX-512, 16.
#![deny(clippy::print_stdout, clippy::print_stderr)]

pub mod bench;
pub mod cli;
pub mod detect;
pub mod eval;
pub mod gpu;
pub mod io;
pub mod kernels;
pub mod math;
pub mod optim;
#[cfg(feature = "player")]
pub mod player;
pub mod reference;
pub mod register;
pub mod render;
pub mod scene;
pub mod segment;
pub mod synth;
pub mod template;
pub mod train;
