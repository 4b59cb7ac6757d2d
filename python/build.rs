//! Build script of the Python module: puts the simulator's library and its licences where maturin packs them from, and
//! lets the module find the library beside itself.
//!
//! It never uses the network: `cargo xtask setup` does that, once and verified.
#![allow(clippy::print_stdout, reason = "printing is how a build script talks to cargo")]

use std::path::{Path, PathBuf};
use std::{env, fs, io};

const FOLDER: &str = "MUJOCO_DYNAMIC_LINK_DIR";

fn main() {
    println!("cargo::rerun-if-env-changed={FOLDER}");
    let macos = env::var("CARGO_CFG_TARGET_OS").is_ok_and(|os| os == "macos");
    let origin = if macos { "@loader_path" } else { "$ORIGIN" };
    println!("cargo::rustc-link-arg-cdylib=-Wl,-rpath,{origin}");
    let (Some(folder), Some(out)) = (env::var_os(FOLDER).map(PathBuf::from), env::var_os("OUT_DIR")) else {
        return fail(&format!("{FOLDER} is not set; .cargo/config.toml sets it, so build from inside the repository"));
    };
    println!("cargo::rerun-if-changed={}", folder.display());
    if let Err(error) = copy(&folder, Path::new(&out)) {
        fail(&format!("cannot copy the simulator's library from {}: {error}", folder.display()));
    }
}

/// Copies the libraries with a version in their name, and the licences that lie beside their folder.
fn copy(folder: &Path, out: &Path) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if name.starts_with("libmujoco") && name.contains(|c: char| c.is_ascii_digit()) {
            fs::copy(&path, out.join(name))?;
        }
    }
    let package = folder.parent().unwrap_or(folder);
    for (name, copied) in [("LICENSE", "LICENSE-mujoco"), ("LICENSES_THIRD_PARTY.md", "LICENSES-mujoco-third-party.md")]
    {
        if package.join(name).is_file() {
            fs::copy(package.join(name), out.join(copied))?;
        }
    }
    Ok(())
}

fn fail(what: &str) {
    println!("cargo::error={what}");
    println!("cargo::error=hint: run `cargo xtask setup` once, it downloads and verifies the library");
}
