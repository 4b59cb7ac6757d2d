//! Features of libraries: programs, tests and wheel ask for the same, so that cargo compiles each library once.

use crate::problem::{Problem, Result};
use crate::process::{self, Workspace};
use std::collections::BTreeSet;

/// Features of programs with learned policies; only these ask for Burn.
pub const LEARN: [&str; 2] = ["--features", "genmanip-cli/learn"];

/// Packages and features of the tests' build, of which everything is built: the whole workspace with learned policies, so
/// that nothing is built twice with another choice of features.
pub const ALL: [&str; 3] = ["--workspace", LEARN[0], LEARN[1]];

/// Builds that share the libraries of the tests' build.
const BUILDS: [(&str, &[&str]); 4] = [
    ("the programs", &[]),
    ("programs that learn", &LEARN),
    ("the wheel", &["--package", "genmanip-python", "--features", "genmanip-python/learn"]),
    ("the Python module from source", &["--package", "genmanip-python"]),
];

/// Fails if one of [`BUILDS`] would compile a library again. Libraries that the tests' build does not have are new, and
/// our own packages with another feature are what a build is for.
pub fn check(workspace: &Workspace) -> Result {
    let libraries = |which: &[&str], edges| {
        let tree = ["tree", "--locked", "--prefix", "none", "--format", "{p} [{f}]", "--edges", edges];
        let listed = process::output(&mut workspace.cargo(tree.iter().chain(which).copied()))?;
        Ok(listed.lines().map(|line| line.trim_end_matches(" (*)").to_owned()).collect::<BTreeSet<String>>())
    };
    let known = libraries(&ALL, "normal,build,dev")?;
    for (build, which) in BUILDS {
        let needed = libraries(which, "normal,build")?;
        let is_again = |library: &&String| {
            let name = library.split(" [").next().unwrap_or(library);
            !name.starts_with("genmanip-") && known.iter().any(|one| one.split(" [").next() == Some(name))
        };
        let again: Vec<&str> = needed.difference(&known).filter(is_again).map(String::as_str).collect();
        if !again.is_empty() {
            return Err(Problem {
                what: format!("{build}: other features than in the tests' build:\n    {}", again.join("\n    ")),
                expected: "the same features, so that no library is compiled twice".into(),
                hint: "add the features to the Cargo.toml of crates/terminal, crates/policy or python; \
                       `cargo tree -e features -i LIBRARY` shows who asks for them"
                    .into(),
            });
        }
    }
    Ok(())
}
