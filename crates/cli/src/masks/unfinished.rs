//! How a folder of masks says that it is not complete. While masks are made, the file of categories, which is written last, has
//! a sentence for the user in the place of categories. Whatever reads masks refuses such a folder with that sentence, as it does
//! any file of categories without ids; a command that was stopped leaves it.

use std::collections::BTreeMap;
use std::path::Path;

use super::{first_file, is_png};
use instgs_console::CliError;
use instgs_console::args::create_folder;
use instgs_io::json::{read_json, write_json};
use instgs_io::masks::CATEGORIES;
use instgs_io::{IoError, remove_if_there};

/// What stands in the place of an id.
const SENTENCE: &str =
    "these masks are not complete: the command that made them was stopped; delete their folder and make them again";

/// Makes masks in a folder that is marked as not complete until `make` writes their categories. If it fails before the first
/// mask, the folder is as it was.
///
/// # Errors
/// The folder cannot be created or written; the errors of `make`.
pub(super) fn marked<T>(folder: &Path, make: impl FnOnce() -> Result<T, CliError>) -> Result<T, CliError> {
    let is_new = !folder.exists();
    create_folder(folder)?;
    mark_unfinished(folder)?;
    make().inspect_err(|_| {
        if first_file(folder, is_png).is_none() {
            let _ = remove_if_there(&folder.join(CATEGORIES));
            if is_new {
                // Only if it is empty.
                let _ = std::fs::remove_dir(folder);
            }
        }
    })
}

/// Marks a folder of masks as not complete. Writing the categories takes the mark away.
///
/// # Errors
/// The file cannot be written.
pub(super) fn mark_unfinished(folder: &Path) -> Result<(), IoError> {
    write_json(&folder.join(CATEGORIES), &BTreeMap::from([(SENTENCE, "")]))
}

/// True if a folder is marked as not complete.
pub(super) fn is_unfinished(folder: &Path) -> bool {
    read_json::<BTreeMap<String, String>>(&folder.join(CATEGORIES)).is_ok_and(|keys| keys.contains_key(SENTENCE))
}

#[cfg(test)]
mod tests {
    use super::*;
    use instgs_io::{Mask, MaskFolder, write_categories, write_mask};

    type Test = Result<(), Box<dyn std::error::Error>>;

    fn write_one(folder: &Path) -> Result<(), CliError> {
        Ok(write_mask(&folder.join("a.png"), &Mask { width: 1, height: 1, ids: vec![1] })?)
    }

    #[test]
    fn readers_of_masks_refuse_a_folder_that_is_not_complete() -> Test {
        let folder = tempfile::tempdir()?;
        let out = folder.path().join("masks");
        let stopped: Result<(), CliError> = marked(&out, || {
            write_one(&out)?;
            Err(CliError::msg("stopped"))
        });
        assert!(stopped.is_err_and(|error| error.to_string() == "stopped") && is_unfinished(&out));
        let error = MaskFolder::open(&out, &[]).err().map(|error| error.to_string()).unwrap_or_default();
        assert!(error.contains("not complete") && error.contains("delete their folder"), "{error}");
        marked(&out, || {
            write_one(&out)?;
            Ok(write_categories(&out.join(CATEGORIES), &[(1, "car".to_owned())].into())?)
        })?;
        assert!(!is_unfinished(&out));
        MaskFolder::open(&out, &[])?;
        Ok(())
    }

    #[test]
    fn what_fails_at_once_leaves_nothing() -> Test {
        let folder = tempfile::tempdir()?;
        let out = folder.path().join("masks");
        let fail = || -> Result<(), CliError> { Err(CliError::msg("no models")) };
        assert!(marked(&out, fail).is_err() && !out.exists());
        // A folder of the user stays, with what is in it.
        std::fs::create_dir(&out)?;
        assert!(marked(&out, fail).is_err() && out.is_dir() && !is_unfinished(&out));
        Ok(())
    }
}
