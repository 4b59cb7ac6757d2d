//! The program `genmanip`, which some measurements start as a user would.

use std::path::PathBuf;

use crate::LabError;

/// Path of the `genmanip` executable, which must lie beside this one.
///
/// # Errors
/// If it does not exist.
pub fn program() -> Result<PathBuf, LabError> {
    let own = std::env::current_exe().map_err(|error| LabError::broken("cannot find this program", error))?;
    let name = format!("genmanip{}", std::env::consts::EXE_SUFFIX);
    // Test executables lie one folder deeper.
    let beside = own.ancestors().skip(1).take(2).map(|folder| folder.join(&name)).find(|path| path.is_file());
    beside.ok_or_else(|| {
        LabError::input(format!("there is no program genmanip beside {}", own.display()))
            .with_hint("build both: cargo build --release")
    })
}
