//! Readers with faults, to see that they are found. Each fails at a first byte above 250.

use std::path::Path;
use std::time::Duration;

use crate::{Seed, SeedError, Target};

/// Planted faults of all kinds.
pub(super) const TARGETS: &[Target] = &[
    Target { name: "planted-panic", seeds, repair: None, read: panics },
    Target { name: "planted-memory", seeds, repair: None, read: takes_memory },
    Target { name: "planted-time", seeds, repair: None, read: hangs },
    Target { name: "planted-stack", seeds, repair: None, read: takes_the_stack },
];

fn seeds() -> Result<Vec<Seed>, SeedError> {
    Ok(vec![Seed::new("zeros", [0; 4])])
}

fn is_bad(bytes: &[u8]) -> bool {
    bytes.first().is_some_and(|byte| *byte > 250)
}

fn panics(bytes: &[u8], _: &Path) -> bool {
    assert!(!is_bad(bytes), "planted");
    true
}

fn takes_memory(bytes: &[u8], _: &Path) -> bool {
    !is_bad(bytes) || std::hint::black_box(vec![1u8; 1 << 40]).len() == 1
}

fn hangs(bytes: &[u8], _: &Path) -> bool {
    while is_bad(bytes) {
        std::thread::sleep(Duration::from_millis(10));
    }
    true
}

fn takes_the_stack(bytes: &[u8], _: &Path) -> bool {
    fn deeper(bytes: &[u8]) -> bool {
        let here = std::hint::black_box([bytes.len(); 64]);
        here[0] > 0 && deeper(bytes) && here[1] > 0
    }
    !is_bad(bytes) || deeper(bytes)
}
