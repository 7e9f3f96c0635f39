//! `instgs.synth`: data sets with known truth, to try things with.

use std::path::PathBuf;

use instgs_synth::dataset::{self, Options, SynthError};
use pyo3::prelude::*;

use crate::camera::size_of;
use crate::error::{Stopped, look_for_ctrl_c, raised};

/// Renders photos of a procedural scene with repeated objects, with masks, depths, poses, cameras and points, into a folder.
///
/// name: "cars", or another scene of `instgs-vk synth`; size: (width, height), pixels; instances: the number of objects, by
/// default the scene's. The same values give the same bytes. Ctrl-C stops it after a
/// photo: what is there stays, and the same call begins anew. Raises Error.
#[pyfunction]
#[pyo3(signature = (out, name = "cars", *, views = 48, size = (320, 180), seed = 1, instances = None))]
pub(crate) fn synth(
    py: Python<'_>,
    out: PathBuf,
    name: &str,
    views: i64,
    size: (i64, i64),
    seed: i64,
    instances: Option<i64>,
) -> PyResult<()> {
    let count = |name: &str, value: i64| {
        u32::try_from(value).map_err(|_| raised(format_args!("{name} is {value}: want a count")))
    };
    let (views, size) = (count("views", views)?, size_of(size)?);
    let instances = instances.map(|instances| count("instances", instances)).transpose()?;
    let seed = u64::try_from(seed).map_err(|_| raised(format_args!("seed is {seed}: want 0 or more")))?;
    let options = Options { views, size, seed, instances, ..Options::default() };
    let write = || dataset::write::<Stopped<SynthError>>(name, &out, &options, &mut |_| look_for_ctrl_c());
    py.detach(write)?;
    Ok(())
}
