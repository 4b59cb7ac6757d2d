//! Pixar's USD library writes objects that `import` reads, and reads scenarios that `export --usd` writes.

use super::environment::environment;
use crate::problem::Result;
use crate::process::{self, Workspace};
use std::path::Path;

const COMPARISON: &str = "python/tests/interop_usd.py";
const PACKAGES: [&str; 2] = ["usd-core==26.11", "numpy==2.3.5"];
/// Folder that the tests of `import` read in place of the recorded files.
const FILES: &str = "GENMANIP_USD_FILES";
const SCENARIOS: [&str; 2] = ["009_appearance-000", "appearance-200-00055-000"];

/// Makes files of another seed than the recorded ones and compares both libraries on them; then exports scenarios.
pub fn run(workspace: &Workspace, place: &Path) -> Result {
    let python = environment(workspace, "python3", &place.join("usd"), &PACKAGES)?;
    let files = place.join("usd-files");
    process::output(workspace.command(&python).arg(COMPARISON).arg(&files).arg("57"))?;
    let test = ["test", "--release", "--workspace", "--test", "import", "--", "usd::files_of_pixars_library"];
    process::visible(workspace.cargo(test).env(FILES, &files))?;
    for name in SCENARIOS {
        let scenario = workspace.root.join(format!("suites/genmanip-200-rc/scenarios/{name}.json"));
        let scene = place.join(format!("{name}.usda"));
        let mut export = workspace.command(workspace.genmanip()?);
        process::output(export.args(["--quiet", "export", "--usd"]).arg(&scenario).arg("--out").arg(&scene))?;
        process::visible(workspace.command(&python).arg(COMPARISON).arg(&scene).arg(&scenario))?;
    }
    Ok(())
}
