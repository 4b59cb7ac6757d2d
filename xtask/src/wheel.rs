//! The Python wheel: built, installed into an environment of its own, and tested there.

use crate::problem::{OnPath, Problem, Result};
use crate::process::{self, Workspace};
use std::fs;
use std::path::{Path, PathBuf};

const REQUIREMENTS: &str = "xtask/wheel-requirements.txt";
const TESTS: &str = "python/tests";

/// `cargo xtask wheel [--out DIR]`: a wheel that needs neither Rust nor another package's simulator.
pub fn run(workspace: &Workspace, arguments: &[String]) -> Result {
    let out = match arguments {
        [] => workspace.root.join("out/wheel"),
        [option, folder] if option == "--out" => PathBuf::from(folder),
        _ => {
            return Err(Problem {
                what: format!("cannot read `{}`", arguments.join(" ")),
                expected: "nothing, or --out DIR".into(),
                hint: "`cargo xtask help` says what each subcommand takes".into(),
            });
        }
    };
    environment(workspace)?;
    let built = build(workspace)?;
    check(workspace, &built)?;
    fs::create_dir_all(&out).on("make the folder", &out)?;
    let wheel = out.join(built.file_name().unwrap_or_default());
    fs::copy(&built, &wheel).on("write", &wheel)?;
    println!("{}", wheel.display());
    Ok(())
}

/// Fails if the wheel needs a library that its platform tag does not promise.
fn check(workspace: &Workspace, wheel: &Path) -> Result {
    if !cfg!(target_os = "linux") {
        return Ok(());
    }
    let python = workspace.target_dir()?.join("wheel/python/bin/python");
    let shown = process::output(workspace.command(python).args(["-m", "auditwheel", "show"]).arg(wheel))?;
    let shown = shown.split_whitespace().collect::<Vec<_>>().join(" ");
    let tag = wheel.file_stem().and_then(|name| name.to_str()).and_then(|name| name.rsplit('-').next());
    let tag = tag.unwrap_or_default();
    let needed =
        shown.split("is consistent with the following platform tag: \"").nth(1).and_then(|rest| rest.split('"').next());
    // A wheel that runs on an older C library than its tag asks for keeps the promise too.
    if needed.and_then(c_library).zip(c_library(tag)).is_some_and(|(needed, promised)| needed <= promised) {
        return Ok(());
    }
    Err(Problem {
        what: format!("the wheel does not keep what its platform tag {tag} promises"),
        expected: "the libraries of that platform and those inside the wheel alone".into(),
        hint: shown,
    })
}

/// Version of the C library in a tag such as `manylinux_2_35_x86_64`.
fn c_library(tag: &str) -> Option<[u32; 2]> {
    let mut parts = tag.strip_prefix("manylinux_")?.split('_').map(|part| part.parse().ok());
    Some([parts.next()??, parts.next()??])
}

/// Platform tag of wheels that are built here: manylinux with the version of the C library.
fn platform(workspace: &Workspace, python: &Path) -> Result<Option<String>> {
    if !cfg!(target_os = "linux") {
        return Ok(None);
    }
    let version =
        process::output(workspace.command(python).args(["-c", "import os; print(os.confstr('CS_GNU_LIBC_VERSION'))"]))?;
    Ok(version.trim().strip_prefix("glibc ").map(|version| format!("manylinux_{}", version.replace('.', "_"))))
}

/// Builds the wheel and runs its tests.
pub fn test(workspace: &Workspace) -> Result {
    let place = workspace.target_dir()?.join("wheel");
    let python = place.join("python/bin/python");
    let wheel = build(workspace)?;
    check(workspace, &wheel)?;
    install(workspace, &python, &wheel)?;
    let mut tests = workspace.command(&python);
    tests.args(["-W", "error::DeprecationWarning", "-m", "unittest", "discover", "--start-directory", TESTS]);
    tests.env("GENMANIP_PROGRAM", workspace.genmanip()?).env("TMPDIR", &place);
    process::visible(&mut tests)
}

/// Builds the wheel with the crates that the program was built of; the environment must be there.
pub fn build(workspace: &Workspace) -> Result<PathBuf> {
    let target = workspace.target_dir()?;
    let place = target.join("wheel");
    let python = place.join("python/bin/python");
    let wheels = place.join("built");
    if wheels.exists() {
        fs::remove_dir_all(&wheels).on("remove the wheel built before", &wheels)?;
    }
    let mut build = workspace.command(&python);
    build.args(["-m", "maturin", "build", "--release", "--locked", "--manifest-path", "python/Cargo.toml"]);
    build.args(["--features", "learn"]);
    if let Some(platform) = platform(workspace, &python)? {
        build.args(["--compatibility", &platform]);
    }
    build.arg("--interpreter").arg(&python).arg("--target-dir").arg(&target).arg("--out").arg(&wheels);
    process::visible(&mut build)?;
    only_file(&wheels)
}

/// Installs a wheel without looking for what it depends on.
pub fn install(workspace: &Workspace, python: &Path, wheel: &Path) -> Result {
    let mut install = workspace.command(python);
    install.args(["-m", "pip", "install", "--quiet", "--no-deps", "--force-reinstall", "--no-index"]);
    process::output(install.arg(wheel)).map(|_| ())
}

/// Makes sure that there is an environment with exactly the packages of the list; one with another list is made anew.
pub fn environment(workspace: &Workspace) -> Result {
    let place = &workspace.target_dir()?.join("wheel");
    let list = workspace.root.join(REQUIREMENTS);
    let wanted = fs::read_to_string(&list).on("read", &list)?;
    let (folder, marker) = (place.join("python"), place.join("python/requirements.txt"));
    if fs::read_to_string(&marker).is_ok_and(|text| text == wanted) {
        return Ok(());
    }
    eprintln!("python:    making an environment with the packages of {REQUIREMENTS} (250 MB, once)");
    if folder.exists() {
        fs::remove_dir_all(&folder).on("remove the unfinished environment", &folder)?;
    }
    fs::create_dir_all(place).on("make the folder", place)?;
    process::output(workspace.command("python3").args(["-m", "venv"]).arg(&folder)).map_err(|problem| Problem {
        expected: "python3 with its module venv".into(),
        hint: "on Debian and Ubuntu: apt install python3-venv python3-pip".into(),
        ..problem
    })?;
    let mut pip = workspace.command(folder.join("bin/python"));
    pip.args(["-m", "pip", "install", "--quiet", "--only-binary=:all:", "--requirement", REQUIREMENTS]);
    process::output(&mut pip)?;
    // Written last: an environment without it is not whole.
    let aside = place.join("requirements.tmp");
    fs::write(&aside, &wanted).on("write", &aside)?;
    process::rename(&aside, &marker)
}

/// The wheel in the folder.
fn only_file(folder: &Path) -> Result<PathBuf> {
    let mut entries = fs::read_dir(folder).on("read", folder)?;
    match entries.next() {
        Some(entry) => Ok(entry.on("read", folder)?.path()),
        None => Err(Problem {
            what: format!("maturin wrote no wheel into {}", folder.display()),
            expected: "one file".into(),
            hint: "its own messages above say why".into(),
        }),
    }
}
