//! The simulator's shared library, taken from the pinned wheel and verified.
//!
//! The wheel is only a container here: it is chosen by explicit interpreter and platform tags, so the Python that the
//! user happens to have does not matter.

use crate::problem::{OnPath, Problem, Result};
use crate::process::{self, Workspace};
use crate::{offline, sha256};
use std::fs;
use std::path::{Path, PathBuf};

const VERSION: &str = "3.17.0";
const FOLDER_VARIABLE: &str = "MUJOCO_DYNAMIC_LINK_DIR";

/// One platform for which the pinned version has a wheel.
struct Wheel {
    os: &'static str,
    arch: &'static str,
    platform: &'static str,
    library: &'static str,
    /// The name the linker looks for.
    link: &'static str,
    library_sha256: &'static str,
}

const WHEELS: [Wheel; 3] = [
    Wheel {
        os: "linux",
        arch: "x86_64",
        platform: "manylinux_2_28_x86_64",
        library: "libmujoco.so.3.17.0",
        link: "libmujoco.so",
        library_sha256: "23496b023ee80fb61ab71167e94bc649f9941710fde96b18bb8204fb332523ad",
    },
    Wheel {
        os: "linux",
        arch: "aarch64",
        platform: "manylinux_2_28_aarch64",
        library: "libmujoco.so.3.17.0",
        link: "libmujoco.so",
        library_sha256: "e2edd0204fb9229f75f332a4fcd1a32345bb9f90651dc0fddfa20ec0670db789",
    },
    Wheel {
        os: "macos",
        arch: "aarch64",
        platform: "macosx_11_0_arm64",
        library: "libmujoco.3.17.0.dylib",
        link: "libmujoco.dylib",
        library_sha256: "454d51fa639100018579716bd68e61285e9b53c9241b029680d82dec95bc8d53",
    },
];

/// Takes these files out of a wheel: `script wheel folder`.
const UNPACK: &str = "\
import sys, zipfile, pathlib
wheel, folder, library = sys.argv[1], pathlib.Path(sys.argv[2]), sys.argv[3]
with zipfile.ZipFile(wheel) as z:
    for name in z.namelist():
        last = name.rsplit('/', 1)[-1]
        if last == library or last.startswith('LICENSE'):
            (folder / last).write_bytes(z.read(name))
";

/// Makes sure that the library is there and is the pinned one; does nothing when it is.
pub fn install(workspace: &Workspace) -> Result {
    let wheel = wheel_for(std::env::consts::OS, std::env::consts::ARCH)?;
    let folder = workspace.root.join("third_party/mujoco/lib");
    if let Some(own) = std::env::var_os(FOLDER_VARIABLE).map(PathBuf::from).filter(|own| !same(own, &folder)) {
        return accept_own(&own, wheel);
    }
    if fs::read(folder.join(wheel.library)).is_ok_and(|bytes| sha256::hex(&bytes) == wheel.library_sha256) {
        if !folder.join(wheel.link).exists() {
            link(&folder, wheel)?;
        }
        eprintln!("simulator: MuJoCo {VERSION} is in place, checksum verified");
        return Ok(());
    }
    let aside = workspace.root.join("third_party/mujoco/download.tmp");
    let _ = fs::remove_dir_all(&aside);
    fs::create_dir_all(&aside).on("make the folder", &aside)?;
    let done = fetch(workspace, wheel, &aside).and_then(|file| unpack(workspace, wheel, &file, &aside, &folder));
    let _ = fs::remove_dir_all(&aside);
    done?;
    eprintln!("simulator: MuJoCo {VERSION} installed, checksum verified");
    Ok(())
}

fn wheel_for(os: &str, arch: &str) -> Result<&'static Wheel> {
    WHEELS.iter().find(|wheel| wheel.os == os && wheel.arch == arch).ok_or_else(|| Problem {
        what: format!("there is no MuJoCo {VERSION} wheel for {os} on {arch}"),
        expected: "Linux on x86_64 (tested) or aarch64, or macOS on aarch64; Windows through WSL2".into(),
        hint: format!("build MuJoCo {VERSION} yourself and set {FOLDER_VARIABLE} to the folder of its library"),
    })
}

fn same(a: &Path, b: &Path) -> bool {
    a == b || matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}

/// The user's own library wins; its version is all we ask, since we cannot know its checksum.
fn accept_own(own: &Path, wheel: &Wheel) -> Result {
    for name in [wheel.link, wheel.library] {
        if own.is_relative() || !own.join(name).exists() {
            return Err(Problem {
                what: format!("{FOLDER_VARIABLE} is set, but this library is not there: {}", own.join(name).display()),
                expected: format!("an absolute folder with {} and {}", wheel.link, wheel.library),
                hint: format!("unset {FOLDER_VARIABLE} to use the verified download, or point it to MuJoCo {VERSION}"),
            });
        }
    }
    eprintln!("simulator: using yours, unverified, because {FOLDER_VARIABLE} is set: {}", own.display());
    Ok(())
}

/// The wheel file: put there by hand, or downloaded.
fn fetch(workspace: &Workspace, wheel: &Wheel, aside: &Path) -> Result<PathBuf> {
    if let Some(file) = find_wheel(&workspace.root.join(offline::HAND_PLACED), wheel) {
        return Ok(file);
    }
    eprintln!("simulator: downloading MuJoCo {VERSION} (26 MB)");
    let requirement = format!("mujoco=={VERSION}");
    let mut pip = workspace.command("python3");
    pip.args(["-m", "pip", "download", "--quiet", "--no-deps", "--only-binary=:all:", "--implementation", "cp"]);
    pip.args(["--python-version", "311", "--abi", "cp311", "--platform", wheel.platform, "--dest"]);
    pip.arg(aside).arg(requirement);
    let downloaded = process::output(&mut pip);
    downloaded.as_ref().ok().and_then(|_| find_wheel(aside, wheel)).ok_or_else(|| {
        let cause = downloaded.err().unwrap_or_else(|| Problem {
            what: "pip succeeded but left no wheel".into(),
            expected: String::new(),
            hint: String::new(),
        });
        offline::problem(
            "the simulator library could not be downloaded",
            &cause,
            &format!("python3 with pip, and a package index that has mujoco {VERSION}"),
            &format!(
                "put the wheel mujoco-{VERSION}-cp311-cp311-*{}.whl into {}/,\n  or {} into third_party/mujoco/lib/,\n  \
                 or set {FOLDER_VARIABLE} to the folder of a MuJoCo {VERSION} that you have; then run it again",
                wheel.platform,
                offline::HAND_PLACED,
                wheel.library
            ),
        )
    })
}

fn find_wheel(folder: &Path, wheel: &Wheel) -> Option<PathBuf> {
    let mut found: Vec<PathBuf> = fs::read_dir(folder).ok()?.flatten().map(|entry| entry.path()).collect();
    found.retain(|path| path.file_name().is_some_and(|name| is_wheel_name(&name.to_string_lossy(), wheel)));
    found.sort();
    found.into_iter().next()
}

fn is_wheel_name(name: &str, wheel: &Wheel) -> bool {
    name.starts_with(&format!("mujoco-{VERSION}-")) && name.ends_with(&format!("{}.whl", wheel.platform))
}

/// Library and licences out of the wheel into `folder`; nothing is put in place before the checksum is right.
fn unpack(workspace: &Workspace, wheel: &Wheel, file: &Path, aside: &Path, folder: &Path) -> Result {
    let mut python = workspace.command("python3");
    python.args(["-c", UNPACK]).arg(file).arg(aside).arg(wheel.library);
    process::output(&mut python).map_err(|problem| {
        let last = problem.what.lines().last().unwrap_or_default().trim().to_owned();
        Problem {
            what: format!("the wheel cannot be unpacked ({last}): {}", file.display()),
            expected: "a whole zip archive".into(),
            hint: "delete that file and run `cargo xtask setup` again".into(),
        }
    })?;
    let library = aside.join(wheel.library);
    let digest = sha256::hex(&fs::read(&library).on("read the library taken out of the wheel", &library)?);
    if digest != wheel.library_sha256 {
        return Err(Problem {
            what: format!("the downloaded {} has the wrong checksum {digest}; nothing was installed", wheel.library),
            expected: format!("sha256 {}", wheel.library_sha256),
            hint: format!(
                "do not use that file; empty {}/ and pip's cache (`python3 -m pip cache purge`) and try again, \
                 then ask who serves your package index",
                offline::HAND_PLACED
            ),
        });
    }
    fs::create_dir_all(folder).on("make the folder", folder)?;
    for entry in fs::read_dir(aside).on("read", aside)?.flatten() {
        let name = entry.file_name();
        if name.to_string_lossy().starts_with("LICENSE") {
            process::rename(&entry.path(), &folder.with_file_name(&name))?;
        }
    }
    process::rename(&library, &folder.join(wheel.library))?;
    link(folder, wheel)
}

/// The unversioned name beside the library, as a link.
fn link(folder: &Path, wheel: &Wheel) -> Result {
    let aside = folder.join("link.tmp");
    let _ = fs::remove_file(&aside);
    #[cfg(unix)]
    std::os::unix::fs::symlink(wheel.library, &aside).on("make the link", &aside)?;
    #[cfg(not(unix))]
    fs::copy(folder.join(wheel.library), &aside).on("copy the library to", &aside)?;
    process::rename(&aside, &folder.join(wheel.link))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_supported_platform_has_a_whole_pin() {
        for wheel in &WHEELS {
            assert_eq!(wheel.library_sha256.len(), 64, "{}", wheel.platform);
            assert!(wheel.library.contains(VERSION), "{}", wheel.library);
        }
        let problem = wheel_for("plan9", "riscv64").err().map(|problem| problem.to_string()).unwrap_or_default();
        assert!(problem.contains("plan9") && problem.contains(FOLDER_VARIABLE), "{problem}");
    }

    #[test]
    fn only_the_pinned_wheel_of_this_platform_is_taken() {
        let name = "mujoco-3.17.0-cp311-cp311-manylinux_2_27_x86_64.manylinux_2_28_x86_64.whl";
        assert!(is_wheel_name(name, &WHEELS[0]));
        assert!(!is_wheel_name(name, &WHEELS[1]));
        assert!(!is_wheel_name(&name.replace("3.17.0", "4.0.0"), &WHEELS[0]));
    }
}
