//! Lists the robots, arms and grippers under `data/robots`, so that a file dropped there is a robot of the program.
//!
//! It writes one Rust table of `(kind, name, text)` and reads nothing but the names of the files.
#![allow(clippy::print_stdout, reason = "printing is how a build script talks to cargo")]

use std::fmt::Write as _;
use std::path::Path;
use std::{env, fs};

/// Kind of file and its folder below `data/robots`.
const KINDS: [(&str, &str); 3] = [("Robot", ""), ("Arm", "arms"), ("Gripper", "grippers")];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let root = Path::new(&env::var("CARGO_MANIFEST_DIR")?).join("data/robots");
    let mut table = String::from("&[\n");
    for (kind, folder) in KINDS {
        let folder = root.join(folder);
        println!("cargo::rerun-if-changed={}", folder.display());
        let mut paths = Vec::new();
        for entry in fs::read_dir(&folder)? {
            let path = entry?.path();
            if path.extension().is_some_and(|extension| extension == "json") {
                paths.push(path);
            }
        }
        paths.sort();
        for path in paths {
            let name = path.file_stem().unwrap_or_default().to_string_lossy();
            writeln!(table, "(PartKind::{kind}, {name:?}, include_str!({:?})),", path.display().to_string())?;
        }
    }
    table.push(']');
    fs::write(Path::new(&env::var("OUT_DIR")?).join("robot_files.rs"), table)?;
    Ok(())
}
