//! From a scene and a camera to a picture on the device.
//!
//! [`DeviceScene`] is the scene in device memory; only its instance table changes. [`plan`] computes buffer sizes.
//! [`FrameBuffers`] are the buffers of one frame. [`Renderer`] records the passes in order and acts when a buffer was
//! too small: it grows it and redoes the frame, or continues with the next depth slab. No splat is ever dropped.

pub mod ahead;
pub mod backward;
pub mod contributions;
pub mod device_scene;
pub mod error;
pub mod extra_passes;
pub mod forward;
pub mod frame_buffers;
mod frame_slot;
pub mod frame_stats;
mod frustum;
pub mod gradients;
pub mod image_frames;
mod instance_table;
mod layers;
mod level_tables;
pub mod marks;
pub mod packed_buffers;
pub mod packed_scene;
mod page_slots;
pub mod paged_scene;
pub mod parameter_buffers;
pub mod picture;
pub mod plan;
pub mod presenter;
pub mod readback;
pub mod render_options;
pub mod renderer;
pub mod scan;
pub mod scene_download;
mod scene_tables;
pub mod self_test;
pub mod show;
pub mod sort;
pub mod source_windows;
pub mod surfaces;
pub mod train_frame;

pub use ahead::{Ahead, Arrived, FRAMES_IN_FLIGHT};
pub use backward::{LossInputs, WantedGradients};
pub use contributions::{CONTRIBUTION_ONE, Contribution, ContributionRenderer};
pub use device_scene::{DeviceScene, SceneCounts};
pub use error::RenderError;
pub use extra_passes::ExtraPasses;
pub use frame_buffers::FrameBuffers;
pub use frame_stats::FrameStats;
pub use gradients::{GradientBuffers, SourceTables, StepLog};
pub use image_frames::ImageFrames;
pub use marks::{MarkShape, Marks};
pub use packed_buffers::PackedBuffers;
pub use packed_scene::PackedScene;
pub use paged_scene::{PagedScene, PagesInView};
pub use parameter_buffers::ParameterBuffers;
pub use picture::Picture;
pub use plan::{Capacities, FramePlan};
pub use presenter::{InstanceLook, Presenter, ShownPicture};
pub use readback::Readback;
pub use render_options::RenderOptions;
pub use renderer::Renderer;
pub use show::Show;
pub use surfaces::{SurfacePoint, Surfaces};
pub use train_frame::{GradientStep, TrainFrame, TrainView};
