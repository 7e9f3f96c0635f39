//! The limit on this process's address space, which the compiler of CPU drivers does not survive.

use super::caps::DeviceCaps;
use super::error::GpuError;

/// What lavapipe needs: with 400 and 700 MB it crashed while it compiled kernels, from 950 MB on a small picture was drawn.
const LEAST_BYTES: u64 = 1 << 30;

/// Fails if the device is lavapipe and the process has too little address space (`ulimit -v`) for it. Unlimited, or on a system
/// without /proc: no error.
pub(super) fn check_address_space(caps: &DeviceCaps) -> Result<(), GpuError> {
    let limits = std::fs::read_to_string("/proc/self/limits").unwrap_or_default();
    match limit_of(&limits) {
        Some(bytes) if caps.is_llvmpipe && bytes < LEAST_BYTES => {
            let (device, limit_mib, least_mib) = (caps.name.clone(), bytes >> 20, LEAST_BYTES >> 20);
            Err(GpuError::AddressSpace { device, limit_mib, least_mib })
        }
        _ => Ok(()),
    }
}

/// The soft limit in the text of /proc/self/limits, bytes; `None` = unlimited or not said.
fn limit_of(limits: &str) -> Option<u64> {
    let columns = limits.lines().find_map(|line| line.strip_prefix("Max address space"))?;
    columns.split_whitespace().next()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_are_read() {
        let limits = |value: &str| {
            format!(
                "Limit                     Soft Limit           Hard Limit           Units\n\
                     Max locked memory         67108864             67108864             bytes\n\
                     Max address space         {value}            unlimited            bytes\n"
            )
        };
        assert_eq!(limit_of(&limits("716800000")), Some(716_800_000));
        assert_eq!(limit_of(&limits("unlimited")), None);
        assert_eq!(limit_of(""), None);
    }
}
