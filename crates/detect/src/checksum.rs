//! Checksums of model files.

use std::io::Read;
use std::path::Path;

use sha2::{Digest, Sha256};

use instgs_io::IoError;

/// Bytes read at a time: models can be as large as memory.
const BLOCK: usize = 1 << 20;

/// SHA-256 of a file, in lower-case hexadecimal.
///
/// # Errors
/// A file that cannot be read.
pub(super) fn sha256(path: &Path) -> Result<String, IoError> {
    let fail = |e: std::io::Error| IoError::new(path, format!("cannot read: {e}"));
    let mut file = std::fs::File::open(path).map_err(fail)?;
    let mut hash = Sha256::new();
    let mut block = vec![0; BLOCK];
    loop {
        let read = file.read(&mut block).map_err(fail)?;
        if read == 0 {
            return Ok(hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect());
        }
        hash.update(&block[..read]);
    }
}
