//! The engine's own log.

use std::ffi::c_char;
use std::sync::Once;

use mujoco_rs::mujoco_c::mju_user_warning;

/// Keeps the engine from writing its warnings into `MUJOCO_LOG.TXT` in the current folder. Their causes, such as
/// numbers that are not finite, are checked where models and states are read.
#[expect(unsafe_code, reason = "the engine has no other switch for its log")]
pub(crate) fn silence() {
    static ONCE: Once = Once::new();
    unsafe extern "C" fn ignore(_warning: *const c_char) {}
    // SAFETY: the engine only reads this pointer, when it warns; it is written once, before this crate's first model is
    // compiled, and the function it points to does nothing.
    ONCE.call_once(|| unsafe { mju_user_warning = Some(ignore) });
}
