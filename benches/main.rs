//! Benchmarks of the parts that cost most: `cargo bench -p genmanip`, or `cargo bench -p genmanip -- relations`.
//!
//! Times are wall-clock times of one thread; `genmanip-lab` measures whole stages in CPU time.

mod planner;
mod relations;
mod render;
mod store;

use std::path::{Path, PathBuf};

fn main() {
    divan::main();
}

/// A path in the repository.
fn repository(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(path)
}
