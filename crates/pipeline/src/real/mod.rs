//! Policies on a real arm, and on a simulated one in its place, behind the bridge of `crates/real`.
//!
//! ```text
//! Policy ─ episode loop ─ RealArm ─ ArmClient ─▶ TCP ─▶ bridge ─▶ arm, or SimulatedArm
//!                           │ Rig: images of the bridge, or of files
//!                           └─▶ record: episode store with camera tracks
//! ```

pub mod alongside;
pub mod arm;
pub mod cameras;
pub mod points;
pub mod rehearsal;
pub mod run;
pub mod simulated;
