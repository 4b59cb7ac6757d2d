//! `cargo xtask fuzz`: builds the fuzz targets with the features of the tests' build, and runs one.

use crate::problem::Result;
use crate::process::{self, Workspace};

/// Passes the arguments on to `genmanip-fuzz`; it lists the targets when there are none.
pub fn run(workspace: &Workspace, args: &[String]) -> Result {
    process::visible(&mut workspace.cargo(["build", "--release", "--quiet", "--workspace", "--bin", "genmanip-fuzz"]))?;
    let program = workspace.genmanip()?.with_file_name(format!("genmanip-fuzz{}", std::env::consts::EXE_SUFFIX));
    process::visible(workspace.command(program).args(args))
}
