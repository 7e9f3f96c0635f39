//! Settings of Mesa's CPU driver that must be in the environment before it is loaded.

/// The variable that sets the width of lavapipe's vectors in bits: 128, 256 or 512.
const WIDTH: &str = "LP_NATIVE_VECTOR_WIDTH";

/// Width without a setting by the user: Mesa 22.3's own choice, set explicitly because the measurements in
/// `docs/measurements.md` were made with it. 512 bits (AVX-512) are slower: the blend gains nothing, and every buffer
/// access is a loop over lanes.
const PREFERRED: &str = "256";

/// Picks lavapipe's vector width, unless the user has set it or the CPU has no 256-bit vectors.
///
/// # Safety
/// Sets an environment variable: must be called while the process has a single thread, at the start of `main`.
pub unsafe fn choose_lavapipe_width() {
    if std::env::var_os(WIDTH).is_none() && has_256_bit_vectors() {
        // SAFETY: the caller guarantees that there is no other thread.
        unsafe { std::env::set_var(WIDTH, PREFERRED) };
    }
}

#[cfg(target_arch = "x86_64")]
fn has_256_bit_vectors() -> bool {
    std::arch::is_x86_feature_detected!("avx2")
}

#[cfg(not(target_arch = "x86_64"))]
fn has_256_bit_vectors() -> bool {
    false
}
