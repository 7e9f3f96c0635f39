//! Settings of Mesa's CPU driver that must be in the environment before it is loaded.

/// The variable that sets the vector width of lavapipe in bits: 128, 256 or 512.
const WIDTH: &str = "LP_NATIVE_VECTOR_WIDTH";

/// The width used if the user sets none: Mesa 22.3's own choice, set explicitly because the measurements in
/// `docs/measurements.md` were made with it. 512 bits (AVX-512) are slower: the blend gains nothing, and every buffer
/// access is a loop over lanes.
const PREFERRED: &str = "256";

/// Sets lavapipe's vector width, unless the user has set it or the CPU has no 256-bit vectors.
///
/// # Safety
/// It may set an environment variable: it must be called at the start of `main`, while there is only one thread.
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
