//! Features of libraries: programs, tests and wheel ask for the same, so that cargo compiles each library once.

use crate::problem::{Problem, Result};
use crate::process::{self, Workspace};
use std::collections::BTreeSet;

/// Builds that share the libraries of the tests' build.
const BUILDS: [(&str, &[&str]); 2] = [("the programs", &[]), ("the wheel", &["--package", "genmanip-python"])];

/// Fails if one of [`BUILDS`] would compile a library again.
pub fn check(workspace: &Workspace) -> Result {
    let libraries = |which: &[&str], edges| {
        let tree = ["tree", "--locked", "--prefix", "none", "--format", "{p} [{f}]", "--edges", edges];
        let listed = process::output(&mut workspace.cargo(tree.iter().chain(which).copied()))?;
        Ok(listed.lines().map(|line| line.trim_end_matches(" (*)").to_owned()).collect::<BTreeSet<String>>())
    };
    let known = libraries(&["--workspace"], "normal,build,dev")?;
    for (build, which) in BUILDS {
        if let Some(library) = libraries(which, "normal,build")?.difference(&known).next() {
            return Err(Problem {
                what: format!("{build} need `{library}`, with other features than the tests"),
                expected: "the same features, so that no library is compiled twice".into(),
                hint:
                    "raise them in crates/terminal/Cargo.toml or python/Cargo.toml; `cargo tree -e features -i LIBRARY`"
                        .into(),
            });
        }
    }
    Ok(())
}
