//! Settings of Mesa's CPU driver that must be in the environment before it is loaded.

/// The variable that sets the width of lavapipe's vectors in bits: 128, 256 or 512.
const WIDTH: &str = "LP_NATIVE_VECTOR_WIDTH";

/// HOOK, does nothing yet: the place to pick lavapipe's vector width for this CPU where the user has not set it.
///
/// Called first thing in `main`, before any thread exists, because it may set an environment variable. Which of 256
/// and 512 is faster, and on which CPUs, is to be decided by measurement.
pub fn choose_lavapipe_width() {
    if std::env::var_os(WIDTH).is_some() {
        return;
    }
    // TO DECIDE: set WIDTH to "512" where the CPU has AVX-512 and it measures faster.
}
