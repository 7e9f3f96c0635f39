//! The views of a data set's split.

use std::path::Path;

use instgs_io::{IoError, Split, View, read_views};
use pyo3::prelude::*;

use crate::error::{OrRaise, raised, warn};

/// The views of the split "test", "train" or "all", at least one. Remarks on how they were read are warnings.
pub(crate) fn views_of(py: Python<'_>, data: &Path, split: &str) -> PyResult<Vec<View>> {
    let wanted = match split {
        "test" => Some(Split::Test),
        "train" => Some(Split::Train),
        "all" => None,
        other => return Err(raised(format_args!("split \"{other}\" is none of test, train and all"))),
    };
    let dataset = py.detach(|| read_views(data)).or_raise()?;
    dataset.notes.iter().try_for_each(|note| warn(py, note))?;
    let is_of_split = |view: &View| wanted.is_none_or(|split| split == view.split);
    let views: Vec<View> = dataset.views.into_iter().filter(is_of_split).collect();
    if views.is_empty() {
        return Err(raised(
            IoError::new(data, format!("has no views in the split {split}")).advise("try split=\"all\""),
        ));
    }
    Ok(views)
}
