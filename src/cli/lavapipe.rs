//! Settings of Mesa's CPU driver that must be in the environment before it is loaded.

/// The variable that sets the width of lavapipe's vectors in bits: 128, 256 or 512.
const WIDTH: &str = "LP_NATIVE_VECTOR_WIDTH";

/// Picks lavapipe's vector width for this CPU, unless the user has set it.
///
/// # Safety
/// It may set an environment variable: call it first thing in `main`, while there is one thread.
pub unsafe fn choose_lavapipe_width() {
    if let (None, Some(width)) = (std::env::var_os(WIDTH), preferred_width()) {
        // SAFETY: the caller says that there is no other thread.
        unsafe { std::env::set_var(WIDTH, width) };
    }
}

/// HOOK: nothing is set yet. Whether "512" beats Mesa's own "256", and on which CPUs, is to be decided by measurement.
fn preferred_width() -> Option<&'static str> {
    None
}
