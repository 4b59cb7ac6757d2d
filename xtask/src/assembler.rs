//! NASM, which halves the time of the video encoder; videos are the same without it.

use crate::process::{self, Workspace};
use std::fs;
use std::path::Path;

/// Message of the encoder's build script when NASM is missing.
const WITHOUT: &str = "Failed to compile NASM files";

/// Reports whether NASM is missing or unused; a build without it works.
pub fn report(workspace: &Workspace) {
    if !cfg!(target_arch = "x86_64") {
        return;
    }
    let there = process::output(workspace.command("nasm").arg("-v")).is_ok();
    let without = workspace.target_dir().is_ok_and(|target| built_without(&target.join("release/build")));
    eprintln!("{}", advice(there, without));
}

fn advice(there: bool, built_without: bool) -> &'static str {
    match (there, built_without) {
        (false, _) => {
            "nasm:      not there, so videos take twice as long to encode (the same videos); on Debian and Ubuntu: apt \
             install nasm, before the first build"
        }
        (true, true) => {
            "nasm:      there, but the encoder was built without it: `cargo clean --release -p openh264-sys2`, then \
             build again"
        }
        (true, false) => "nasm:      in place",
    }
}

/// True if a build of the encoder in cargo's build folder did not use NASM.
fn built_without(builds: &Path) -> bool {
    let builds = fs::read_dir(builds).into_iter().flatten().flatten();
    builds
        .filter(|build| build.file_name().to_string_lossy().starts_with("openh264-sys2-"))
        .filter_map(|build| fs::read_to_string(build.path().join("output")).ok())
        .any(|output| output.contains(WITHOUT))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_advice_fits_the_state() {
        for (there, built_without, expected) in
            [(false, true, "apt install nasm"), (true, true, "cargo clean"), (true, false, "in place")]
        {
            assert!(advice(there, built_without).contains(expected), "{there} {built_without}");
        }
    }
}
