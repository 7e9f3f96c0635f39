//! Available memory of the host.

/// Memory that is available without swapping, bytes; `None` if it is unknown, as it is on systems other than Linux.
pub fn available_bytes() -> Option<u64> {
    available_of(&std::fs::read_to_string("/proc/meminfo").ok()?)
}

/// Parses the text of `/proc/meminfo`; the result is in bytes.
fn available_of(text: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn available_memory_is_read_or_unknown() {
        let text = "MemTotal:       16318412 kB\nMemFree:          201044 kB\nMemAvailable:   12021044 kB\n";
        assert_eq!(available_of(text), Some(12_021_044 << 10));
        for text in ["", "MemAvailable: much kB\n", "MemAvailable: 12\n", "MemAvailable: 99999999999999999 kB\n"] {
            assert_eq!(available_of(text), None, "{text}");
        }
    }
}
