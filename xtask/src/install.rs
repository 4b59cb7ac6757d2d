//! `cargo xtask install`: the programs on the PATH, and the suites where they find them by name.

use crate::problem::{OnPath, Problem, Result};
use crate::process::{self, Workspace};
use crate::{features, setup};
use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};

const PROGRAMS: [&str; 2] = ["genmanip", "genmanip-lab"];
/// Folder of the suites in the repository, and below the root of an installation.
const SUITES: (&str, &str) = ("suites", "share/genmanip/suites");

/// Builds the programs and copies them into `bin` of the root; nothing is compiled again for it, and with `--learn` only
/// what learned policies need.
pub fn run(workspace: &Workspace, args: &[String]) -> Result {
    let (learn, args): (Vec<String>, Vec<String>) = args.iter().cloned().partition(|arg| arg == "--learn");
    let root = root(&args, |name| std::env::var_os(name).filter(|value| !value.is_empty()))?;
    setup::simulator(workspace)?;
    let features: &[&str] = if learn.is_empty() { &[] } else { &features::LEARN };
    process::visible(&mut workspace.cargo(["build", "--release"].iter().chain(features).copied()))?;
    let (built, bin) = (workspace.target_dir()?.join("release"), root.join("bin"));
    fs::create_dir_all(&bin).on("make the folder", &bin)?;
    for name in PROGRAMS {
        let name = format!("{name}{}", std::env::consts::EXE_SUFFIX);
        let (to, aside) = (bin.join(&name), bin.join(format!(".{name}.tmp")));
        fs::copy(built.join(&name), &aside).on("copy", &built.join(&name))?;
        process::rename(&aside, &to)?;
        // It must find the simulator's library from here: by the absolute path that the build has written into it.
        let version = process::output(workspace.command(&to).arg("--version").current_dir(&bin))?;
        println!("installed {}: {}", to.display(), version.trim());
    }
    let suites = root.join(SUITES.1);
    replace_folder(&workspace.root.join(SUITES.0), &suites)?;
    println!("installed {}: `--suite NAME` finds them from any folder", suites.display());
    if !is_on_path(&bin, &std::env::var_os("PATH").unwrap_or_default()) {
        println!(
            "hint: {bin} is not on the PATH; for this shell: export PATH=\"{bin}:$PATH\"; for all: add that line to \
             ~/.profile",
            bin = bin.display()
        );
    }
    println!("The programs use the simulator's library in {}: ", workspace.root.join("third_party/mujoco").display());
    println!("run `cargo xtask install` again after that folder has moved.");
    Ok(())
}

/// Folder of the installation: as named, else where cargo installs programs.
fn root(args: &[String], variable: impl Fn(&str) -> Option<OsString>) -> Result<PathBuf> {
    let wrong = |what: String| Problem {
        what,
        expected: "`cargo xtask install [--root DIR] [--learn]`".into(),
        hint: "without --root: CARGO_INSTALL_ROOT, CARGO_HOME or ~/.cargo".into(),
    };
    match args {
        [] => {}
        [option, folder] if option == "--root" => {
            return std::path::absolute(folder).on("find", Path::new(folder));
        }
        [option] if option.starts_with("--root=") && option.len() > 7 => {
            return std::path::absolute(&option[7..]).on("find", Path::new(&option[7..]));
        }
        _ => return Err(wrong(format!("the arguments are not understood: {}", args.join(" ")))),
    }
    let named = variable("CARGO_INSTALL_ROOT").or_else(|| variable("CARGO_HOME")).map(PathBuf::from);
    let usual = || variable("HOME").map(|home| Path::new(&home).join(".cargo"));
    named.or_else(usual).ok_or_else(|| wrong("there is no home folder to install into".into()))
}

/// Copies a folder of files and folders over what is at `to`.
fn replace_folder(from: &Path, to: &Path) -> Result {
    let parent = to.parent().unwrap_or(to);
    fs::create_dir_all(parent).on("make the folder", parent)?;
    let aside = to.with_extension("tmp");
    let remove = |folder: &Path| if folder.exists() { fs::remove_dir_all(folder).on("remove", folder) } else { Ok(()) };
    remove(&aside)?;
    copy(from, &aside)?;
    remove(to)?;
    process::rename(&aside, to)
}

fn copy(from: &Path, to: &Path) -> Result {
    fs::create_dir_all(to).on("make the folder", to)?;
    for entry in fs::read_dir(from).on("read", from)? {
        let entry = entry.on("read", from)?;
        let (path, target) = (entry.path(), to.join(entry.file_name()));
        if path.is_dir() {
            copy(&path, &target)?;
        } else {
            fs::copy(&path, &target).on("copy", &path)?;
        }
    }
    Ok(())
}

fn is_on_path(bin: &Path, path: &OsString) -> bool {
    std::env::split_paths(path).any(|folder| folder == bin)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_root_is_named_or_that_of_cargo() {
        let find = |args: &[&str], variables: &[(&str, &str)]| {
            let args: Vec<String> = args.iter().map(ToString::to_string).collect();
            let value = |name: &str| variables.iter().find(|(one, _)| *one == name).map(|(_, value)| (*value).into());
            root(&args, value).map(|root| root.display().to_string())
        };
        assert_eq!(find(&["--root", "/opt/x"], &[]).unwrap(), "/opt/x");
        assert_eq!(find(&["--root=/opt/x"], &[]).unwrap(), "/opt/x");
        let all = [("HOME", "/h"), ("CARGO_HOME", "/c"), ("CARGO_INSTALL_ROOT", "/i")];
        assert_eq!(find(&[], &all).unwrap(), "/i");
        assert_eq!(find(&[], &all[..2]).unwrap(), "/c");
        assert_eq!(find(&[], &all[..1]).unwrap(), "/h/.cargo");
        assert!(find(&[], &[]).is_err());
        assert!(find(&["--roof", "x"], &all).is_err());
        assert!(find(&["--root"], &all).is_err());
    }

    #[test]
    fn folders_are_replaced_as_a_whole() {
        let place = std::env::temp_dir().join(format!("xtask-install-{}", std::process::id()));
        let (from, to) = (place.join("from"), place.join("share/to"));
        fs::create_dir_all(from.join("inner")).unwrap();
        fs::create_dir_all(&to).unwrap();
        fs::write(from.join("inner/new.json"), "new").unwrap();
        fs::write(to.join("old.json"), "old").unwrap();
        replace_folder(&from, &to).unwrap();
        replace_folder(&from, &to).unwrap();
        assert_eq!(fs::read_to_string(to.join("inner/new.json")).unwrap(), "new");
        assert!(!to.join("old.json").exists() && !place.join("share/to.tmp").exists());
        fs::remove_dir_all(&place).unwrap();
    }

    #[test]
    fn the_path_is_searched() {
        assert!(is_on_path(Path::new("/a/bin"), &"/usr/bin:/a/bin".into()));
        assert!(!is_on_path(Path::new("/a/bin"), &"/usr/bin:/a".into()));
    }
}
