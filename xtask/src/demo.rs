//! `cargo xtask demo`: from a fresh clone to verified demonstrations and a report, in one command.

use crate::problem::Result;
use crate::process::{self, Workspace};
use crate::setup;

/// Sets up, builds, and hands over to `genmanip demo`.
pub fn run(workspace: &Workspace, args: &[String]) -> Result {
    setup::simulator(workspace)?;
    process::visible(&mut workspace.cargo(["build", "--release"]))?;
    let mut genmanip = workspace.command(workspace.genmanip()?);
    genmanip.args(demo_arguments(args));
    process::visible(&mut genmanip)
}

fn demo_arguments(args: &[String]) -> Vec<String> {
    let mut all = vec!["demo".to_owned()];
    if !args.iter().any(|arg| arg == "--out" || arg.starts_with("--out=") || arg == "--help") {
        all.extend(["--out".to_owned(), "out/demo".to_owned()]);
    }
    all.extend(args.iter().cloned());
    all
}

#[cfg(test)]
mod tests {
    use super::demo_arguments;

    #[test]
    fn a_given_folder_replaces_the_default_one() {
        let given = |args: &[&str]| demo_arguments(&args.iter().map(ToString::to_string).collect::<Vec<_>>()).join(" ");
        assert_eq!(given(&[]), "demo --out out/demo");
        assert_eq!(given(&["--fps", "60"]), "demo --out out/demo --fps 60");
        assert_eq!(given(&["--out=x"]), "demo --out=x");
        assert_eq!(given(&["--out", "x"]), "demo --out x");
    }
}
