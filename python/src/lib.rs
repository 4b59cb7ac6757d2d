//! The Python module `genmanip._genmanip`: what `genmanip_pipeline` and `genmanip_rollout` do, for Python programs.
//!
//! The simulator's library lies beside it, see `build.rs`. The package around it, in `genmanip/`, holds what is easier
//! said in Python: Gymnasium's environments and how functions are called. Nothing is decided here: a function turns its
//! arguments into those of a Rust function, releases the GIL while that runs, and turns the result into
//! dictionaries and NumPy arrays.

mod environment;
mod errors;
mod evaluation;
mod observation;
mod pool;
mod progress;
mod projection;
mod stages;

use pyo3::prelude::*;

/// Adds everything to the module.
#[pymodule]
fn _genmanip(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add("Error", module.py().get_type::<errors::Error>())?;
    module.add_class::<environment::SceneSource>()?;
    module.add_class::<environment::Env>()?;
    module.add_class::<environment::SessionState>()?;
    module.add_class::<pool::Pool>()?;
    module.add_class::<projection::Projection>()?;
    module.add_function(wrap_pyfunction!(engine, module)?)?;
    module.add_function(wrap_pyfunction!(evaluation::evaluate, module)?)?;
    module.add_function(wrap_pyfunction!(evaluation::policies, module)?)?;
    module.add_function(wrap_pyfunction!(evaluation::success_interval, module)?)?;
    module.add_function(wrap_pyfunction!(evaluation::spec_mistakes, module)?)?;
    module.add_function(wrap_pyfunction!(stages::tasks, module)?)?;
    module.add_function(wrap_pyfunction!(stages::design, module)?)?;
    module.add_function(wrap_pyfunction!(stages::layout, module)?)?;
    module.add_function(wrap_pyfunction!(stages::collect, module)?)?;
    module.add_function(wrap_pyfunction!(stages::export, module)?)?;
    module.add_function(wrap_pyfunction!(stages::train, module)?)?;
    module.add_function(wrap_pyfunction!(stages::render, module)?)?;
    module.add_function(wrap_pyfunction!(stages::plan, module)?)?;
    module.add_function(wrap_pyfunction!(stages::dataset, module)?)?;
    module.add_function(wrap_pyfunction!(stages::dataset_actions, module)?)?;
    Ok(())
}

/// Version of the simulator that was loaded, as it says itself.
#[pyfunction]
fn engine() -> String {
    genmanip_pipeline::sessions::engine_version()
}
