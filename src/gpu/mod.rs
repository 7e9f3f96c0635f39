//! L1: the only module that speaks Vulkan. It knows nothing of Gaussians.
//!
//! `Gpu` is the device with its queue, allocator and timeline; `Buffer<T>` a typed storage buffer; `Pipeline<K>` a
//! compiled kernel; `Recorder` turns dispatches into a command buffer and derives the barriers from `&`/`&mut` of the
//! generated binding structs in [`interface`].

pub mod barrier;
pub mod buffer;
pub mod caps;
pub mod context;
pub mod error;
pub mod interface;
pub mod memory;
pub mod pipeline;
pub mod profiler;
pub mod recorder;
pub mod staging;
#[cfg(feature = "player")]
pub mod swapchain;
pub mod timeline;
#[cfg(feature = "player")]
pub mod ui_painter;
pub mod validation;

pub use buffer::Buffer;
pub use caps::DeviceCaps;
pub use context::{DeviceChoice, Gpu, GpuOptions};
pub use error::GpuError;
pub use pipeline::{Pipeline, PipelineCache, user_cache_path};
pub use recorder::{Grid, Recorder};
#[cfg(feature = "player")]
pub use swapchain::{PresentMode, Swapchain, Target, UI_PASS};
pub use timeline::{SubmissionCounts, Ticket};
#[cfg(feature = "player")]
pub use ui_painter::{UiFrame, UiPainter};
