//! `genmanip lab`: one module per measurement; figures are of one thread and in processor time.

pub mod answers;
pub mod design;
pub mod expert;
pub mod grasp;
pub mod layout;
pub mod motion;
pub mod relations;
mod rendered;

use cpu_time::ThreadTime;

/// A clock of this thread's processor time, in seconds since it was made.
pub fn cpu_clock() -> impl FnMut() -> f64 {
    let start = ThreadTime::now();
    move || start.elapsed().as_secs_f64()
}
