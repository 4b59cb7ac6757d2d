//! The ways on without a network.

use crate::problem::Problem;

/// Wheels put here by hand are used instead of the network.
pub const HAND_PLACED: &str = "third_party/wheels";

/// The ways on when a download was not possible.
pub fn problem(what: &str, cause: &Problem, files: &str, place: &str) -> Problem {
    Problem {
        what: format!("{what}\n  because {}", cause.what),
        expected: files.into(),
        hint: format!("with a network: run `cargo xtask setup` again\nwithout: {place}"),
    }
}
