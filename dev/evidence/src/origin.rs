//! The program and the device that a result comes from.

use std::hash::{DefaultHasher, Hasher};
use std::path::Path;

use serde::{Deserialize, Serialize};

use instgs_console::CliError;
use instgs_io::{IoError, read_bytes};
use instgs_vk::gpu::DeviceCaps;

/// The program and the device that a result comes from. Results of another one are not taken for those of now.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Origin {
    /// Version and checksum of the program, for instance `0.1.0 (1f3a5b7c9d0e2f48)`.
    #[serde(default)]
    pub program: String,
    /// Name of the Vulkan device, its driver, and the numbers of the kernels that replace those picked for it.
    pub device: String,
}

impl Origin {
    /// The running program on a device.
    ///
    /// # Errors
    /// The program's file cannot be read.
    pub(crate) fn here(caps: &DeviceCaps) -> Result<Self, CliError> {
        let program = std::env::current_exe().map_err(|e| CliError::msg(format!("cannot find this program: {e}")))?;
        // Its version is the same from commit to commit, and a commit says nothing about sources that were changed since.
        let program = format!("{} ({})", env!("CARGO_PKG_VERSION"), checksum(&program)?);
        let tuning: Vec<String> = caps.tuning.numbers().map(|(name, number)| format!(", {name}={number}")).collect();
        Ok(Self { program, device: format!("{}, {}{}", caps.name, caps.driver, tuning.concat()) })
    }
}

/// A checksum over all bytes of a file, in hexadecimal. Only sums of the same program may be compared: the hash may be another
/// one in another version of Rust, and then the program differs, too.
pub(crate) fn checksum(path: &Path) -> Result<String, IoError> {
    let mut hash = DefaultHasher::new();
    hash.write(&read_bytes(path)?);
    Ok(format!("{:016x}", hash.finish()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_checksum_is_of_every_byte() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let of = |name: &str, bytes: &[u8]| {
            let path = folder.path().join(name);
            std::fs::write(&path, bytes)?;
            Ok::<_, Box<dyn std::error::Error>>(checksum(&path)?)
        };
        let mut bytes = vec![7; 300_000];
        let first = of("a", &bytes)?;
        assert_eq!((first.len(), &of("b", &bytes)?), (16, &first));
        bytes[151_003] = 8;
        assert_ne!(of("a", &bytes)?, first);
        assert!(checksum(&folder.path().join("c")).is_err());
        Ok(())
    }
}
