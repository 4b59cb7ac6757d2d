//! Build script shared by every package whose binary, tests or doctests link the simulator.
//!
//! The simulator is a shared library, and a library crate's build script cannot tell *other* packages' binaries where
//! to find it at run time.
//! So each of those packages runs this file, which writes the library's absolute folder into what it links.
//! An absolute path also survives another target folder, where a path relative to the binary would not.
//! It never uses the network: `cargo xtask setup` does that, once and verified.
#![allow(clippy::print_stdout, reason = "printing is how a build script talks to cargo")]

use std::env;
use std::path::{Path, PathBuf};

const FOLDER: &str = "MUJOCO_DYNAMIC_LINK_DIR";

fn main() {
    println!("cargo::rerun-if-env-changed={FOLDER}");
    println!("cargo::rerun-if-env-changed=MUJOCO_STATIC_LINK_DIR");
    if env::var_os("MUJOCO_STATIC_LINK_DIR").is_some() {
        return; // linked in: nothing to find at run time
    }
    let Some(folder) = env::var_os(FOLDER).map(PathBuf::from) else {
        return fail(&format!("{FOLDER} is not set; .cargo/config.toml sets it, so build from inside the repository"));
    };
    let macos = env::var("CARGO_CFG_TARGET_OS").is_ok_and(|os| os == "macos");
    let library = folder.join(if macos { "libmujoco.dylib" } else { "libmujoco.so" });
    println!("cargo::rerun-if-changed={}", library.display());
    if !library.exists() {
        return fail(&format!("the simulator library is missing: {}", library.display()));
    }
    println!("cargo::rustc-link-arg=-Wl,-rpath,{}", absolute(&folder).display());
}

fn absolute(folder: &Path) -> PathBuf {
    folder.canonicalize().unwrap_or_else(|_| folder.to_path_buf())
}

fn fail(what: &str) {
    println!("cargo::error={what}");
    println!("cargo::error=hint: run `cargo xtask setup` once, it downloads and verifies the library");
}
