//! Finds the file of the runtime library. It is not part of this program, but loaded when models are used.

use std::env::consts::{DLL_PREFIX, DLL_SUFFIX};
use std::ffi::OsStr;
use std::io::Read;
use std::path::{Path, PathBuf};

use super::provider::Provider;
use instgs_io::IoError;

/// How the models are run.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RuntimeOptions {
    /// File of the runtime library, if the user names one; see [`find_library`].
    pub library: Option<PathBuf>,
    /// Device that runs the models.
    pub provider: Provider,
}

/// Environment variable that names the library; other programs with ONNX Runtime use the same.
pub const LIBRARY_VARIABLE: &str = "ORT_DYLIB_PATH";
/// Where `tools/setup_onnxruntime` puts the library, relative to the working directory.
const CACHE: &str = ".cache/onnxruntime";

/// How to get a library that works.
pub const ADVICE: &str = "run tools/setup_onnxruntime, which takes it from the PyPI wheel onnxruntime, or name the file \
                          with --runtime or ORT_DYLIB_PATH";

/// The library's file name: `libonnxruntime.so`, `libonnxruntime.dylib` or `onnxruntime.dll`.
pub fn library_name() -> String {
    format!("{DLL_PREFIX}onnxruntime{DLL_SUFFIX}")
}

/// The file to load: `given` by the user, else named by the `variable`, else in `.cache/onnxruntime` of the `working`
/// directory, else the system's library of that name.
///
/// # Errors
/// No file where the user or the variable names one. A variable without a folder is a name for the system to resolve.
pub fn find_library(given: Option<&Path>, variable: Option<&OsStr>, working: &Path) -> Result<PathBuf, IoError> {
    let missing = |path: &Path, by: &str| {
        Err(IoError::new(path, format!("is no file, but {by} names it as the ONNX Runtime library")).advise(ADVICE))
    };
    if let Some(path) = given {
        return if path.is_file() { Ok(working.join(path)) } else { missing(path, "--runtime") };
    }
    if let Some(path) = variable.filter(|v| !v.is_empty()).map(Path::new) {
        let is_name = path.components().count() == 1 && !working.join(path).is_file();
        return match path.is_file() {
            true => Ok(working.join(path)),
            false if is_name => Ok(path.into()),
            false => missing(path, LIBRARY_VARIABLE),
        };
    }
    let name = library_name();
    let cached = working.join(CACHE).join(&name);
    Ok(if cached.is_file() { cached } else { name.into() })
}

/// Checks that a library's file is complete: the loader maps the size that the header states, and reading beyond the
/// end of the file kills the process. Covers 64-bit ELF files, whose section table comes last; names for the system to
/// resolve are skipped.
///
/// # Errors
/// A file that ends before that table does, or that cannot be read.
pub fn check_whole(path: &Path) -> Result<(), IoError> {
    if !path.is_file() {
        return Ok(());
    }
    let fail = |e: std::io::Error| IoError::new(path, format!("cannot read: {e}"));
    let mut file = std::fs::File::open(path).map_err(fail)?;
    let length = file.metadata().map_err(fail)?.len();
    // "\x7fELF", 64 bits, little endian. The offset of the section table is at 40, the size and number of its entries
    // at 58 and 60.
    let mut head = [0; 64];
    if file.read_exact(&mut head).is_err() || head[..6] != *b"\x7fELF\x02\x01" {
        return Ok(());
    }
    let number = |at: usize, bytes: usize| head[at..][..bytes].iter().rev().fold(0, |n: u64, b| n << 8 | u64::from(*b));
    let end = number(40, 8).saturating_add(number(58, 2) * number(60, 2));
    match length < end {
        true => Err(IoError::new(path, format!("is truncated to {length} of {end} bytes")).advise(ADVICE)),
        false => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_wish_counts() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let working = folder.path();
        let name = library_name();
        assert_eq!(find_library(None, None, working)?, Path::new(&name));
        let cached = working.join(CACHE).join(&name);
        std::fs::create_dir_all(working.join(CACHE))?;
        std::fs::write(&cached, "")?;
        assert_eq!(find_library(None, None, working)?, cached);
        assert_eq!(find_library(None, Some(OsStr::new("")), working)?, cached);
        let other = working.join("other.so");
        std::fs::write(&other, "")?;
        assert_eq!(find_library(None, Some(other.as_os_str()), working)?, other);
        assert_eq!(find_library(None, Some(OsStr::new("libort.so.1")), working)?, Path::new("libort.so.1"));
        assert_eq!(find_library(Some(&cached), Some(other.as_os_str()), working)?, cached);
        let none = working.join("none.so");
        for (given, variable, by) in [(Some(none.as_path()), None, "--runtime"), (None, Some(none.as_os_str()), "ORT_")]
        {
            let text = find_library(given, variable, working).err().map(|e| e.to_string()).unwrap_or_default();
            assert!(text.contains("none.so") && text.contains(by) && text.contains("setup_onnxruntime"), "{text}");
        }
        Ok(())
    }

    #[test]
    fn a_cut_library_is_noticed() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("cut.so");
        // A table of two entries of 64 bytes at offset 100.
        let mut bytes = vec![0; 228];
        bytes[..6].copy_from_slice(b"\x7fELF\x02\x01");
        (bytes[40], bytes[58], bytes[60]) = (100, 64, 2);
        std::fs::write(&path, &bytes)?;
        check_whole(&path)?;
        std::fs::write(&path, &bytes[..227])?;
        let text = check_whole(&path).err().map(|e| e.to_string()).unwrap_or_default();
        assert!(
            text.contains("cut.so: is truncated to 227 of 228 bytes") && text.contains("setup_onnxruntime"),
            "{text}"
        );
        std::fs::write(&path, "no library")?;
        check_whole(&path)?;
        Ok(check_whole(Path::new("libonnxruntime.so"))?)
    }
}
