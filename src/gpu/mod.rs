//! Device layer: the only module that calls Vulkan. It knows nothing of Gaussians.
//!
//! `Gpu` is the device with its queue, allocator and timeline; `Buffer<T>` a typed storage buffer; `Pipeline<K>` a
//! compiled kernel; `Recorder` turns dispatches into a command buffer and derives the barriers from `&`/`&mut` of the
//! generated binding structs in [`interface`].
//!
//! A buffer may be dropped at any time: recorders and submissions keep what they use. [`Gpu::from_raw`] takes a device
//! of the caller's ([`RawDevice`] lists what it must have). `Gpu::raw_*`, [`Gpu::with_queue`], [`Recorder::raw_copy`]
//! and [`Recorder::submit_between`] are what a window system needs. See "Embedding" in the crate's documentation.

mod address_space;
pub mod barrier;
pub mod buffer;
pub mod caps;
pub mod context;
mod descriptors;
pub mod device;
pub mod dispatch;
pub mod error;
pub mod external;
pub mod faults;
mod instance;
pub mod interface;
pub mod memory;
pub mod pipeline;
pub mod profiler;
pub mod recorder;
pub mod staging;
mod statistics;
pub mod timeline;
mod transfers;
mod tuning;
pub mod validation;

pub use ash::vk;
pub use buffer::{Buffer, BufferPart, Home, PART_ALIGNMENT, bound_runs};
pub use caps::DeviceCaps;
pub use context::{DeviceChoice, Gpu, GpuOptions, QueueLock};
pub use device::{RawDevice, RequiredFeatures};
pub use dispatch::Grid;
pub use error::GpuError;
pub use external::{ImageTarget, Signal};
pub use faults::{FaultPlan, Faults};
pub use pipeline::{Pipeline, PipelineCache, user_cache_path};
pub use recorder::Recorder;
pub use statistics::{CompiledPipeline, Executable};
pub use timeline::{SubmissionCounts, Ticket};
pub use tuning::Tuning;
