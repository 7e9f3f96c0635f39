//! The scene as plain CPU data, independent of file formats and of the GPU.

pub mod camera;
pub mod device_precision;
pub mod edit;
pub mod flatten;
pub mod gaussians;
pub mod instanced_scene;
pub mod labels;
pub mod lod;
pub mod object_box;
pub mod offset_runs;
pub mod offsets;
pub mod parameters;
pub mod pixel_filter;
pub mod point_cloud;
pub mod posed_group;
pub mod prune;
pub mod recentre;
pub mod repeated_bytes;
pub mod single_use;
pub mod source_layout;
pub mod trajectory;
pub mod up;

pub use camera::{Camera, CameraError};
pub use device_precision::DevicePrecision;
pub use gaussians::Gaussians;
pub use instanced_scene::{Group, Instance, InstancedScene, SourceRange};
pub use labels::InstanceLabel;
pub use object_box::{Boxes, ObjectBox, ViewBox};
pub use offsets::Offsets;
pub use parameters::{Owner, Parameter, ParameterSet};
pub use pixel_filter::{PixelFilter, PixelFilterChoice};
pub use point_cloud::PointCloud;
pub use posed_group::{PosedGroup, PosedInstance};
pub use repeated_bytes::RepeatedBytes;
pub use source_layout::SourceLayout;
pub use up::up_direction;
