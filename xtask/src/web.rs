//! The studio's page in `web/`: pinned packages, tests, and the committed build in `web/dist`.

use crate::features::ALL;
use crate::problem::{OnPath, Problem, Result};
use crate::process::{self, Workspace};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

const FOLDER: &str = "web";
const LOCK: &str = "web/package-lock.json";
/// Written last, with the text of the lock file: an installation without it is not whole and is made anew.
const MARKER: &str = "web/node_modules/genmanip-lock.json";
/// Folder of the build that is compared with `web/dist`, relative to [`FOLDER`].
const REBUILT: &str = "node_modules/.rebuilt";
/// Variable with the path of a Chromium elsewhere.
const CHROMIUM: &str = "CHROMIUM";
const USUAL_CHROMIUM: [&str; 2] = ["/usr/bin/chromium", "/usr/bin/google-chrome"];

/// Installs the pinned packages and reports a missing Chromium.
pub fn set_up(workspace: &Workspace) -> Result {
    packages(workspace)?;
    match chromium() {
        Some(path) => eprintln!("chromium:  {}", path.display()),
        None => eprintln!(
            "chromium:  not there, so the browser tests are skipped; on Debian: apt install chromium (or name another one \
             in {CHROMIUM})"
        ),
    }
    Ok(())
}

/// Makes sure that the packages are there and as pinned.
pub fn packages(workspace: &Workspace) -> Result {
    let lock = workspace.root.join(LOCK);
    let wanted = fs::read_to_string(&lock).on("read", &lock)?;
    let marker = workspace.root.join(MARKER);
    if fs::read_to_string(&marker).is_ok_and(|text| text == wanted) {
        eprintln!("web:       the packages of {LOCK} are in place");
        return Ok(());
    }
    eprintln!("web:       installing the packages of {LOCK} (130 MB, once)");
    process::output(npm(workspace).args(["ci", "--ignore-scripts"])).map_err(|cause| {
        let what = format!("the packages of the studio's page could not be installed\n  because {}", cause.what);
        let hint = "they need a network, Node.js 20 and npm 11 or newer; then run `cargo xtask setup web` again".into();
        Problem { what, expected: format!("the packages of {LOCK}"), hint }
    })?;
    let aside = marker.with_extension("tmp");
    fs::write(&aside, &wanted).on("write", &aside)?;
    process::rename(&aside, &marker)
}

/// Types, unit tests, the committed build against a new one, browser tests; gives a note for the table of phases.
///
/// `needs_browser` makes a missing Chromium an error.
pub fn test(workspace: &Workspace, needs_browser: bool) -> Result<String> {
    process::visible(npm(workspace).args(["run", "--silent", "check"]))?;
    process::visible(npm(workspace).args(["test", "--silent"]))?;
    compare_builds(workspace)?;
    let Some(path) = chromium() else {
        let hint = format!("on Debian: apt install chromium; or name another one in {CHROMIUM}");
        if needs_browser {
            let what = "the browser tests of the studio's page cannot run: Chromium is missing".into();
            return Err(Problem { what, expected: USUAL_CHROMIUM.join(" or "), hint });
        }
        return Ok(format!("ok; browser tests skipped: no Chromium ({hint})"));
    };
    process::visible(npm(workspace).args(["run", "--silent", "browser"]).env(CHROMIUM, path))?;
    Ok("ok, in Chromium too".into())
}

/// Options of [`long`] for the tests with a browser; a number follows each.
const LONG_OPTIONS: [&str; 6] = ["--seed", "--tabs", "--faults", "--cut-s", "--orbit-s", "--suite"];
/// Option of [`long`] for the number of kills, and the variable that tells it to the test.
const KILLS: (&str, &str) = ("--kills", "GENMANIP_KILLS");

/// Long tests with the real program: kills at random moments, then in a browser many tabs, a newcomer's trial, faults of
/// connection, server, token and disk, and orbiting. `options` change how long each part is.
pub fn long(workspace: &Workspace, options: &[String]) -> Result {
    let (kills, others) = long_options(options)?;
    packages(workspace)?;
    let Some(path) = chromium() else {
        return Err(Problem {
            what: "the long tests need Chromium".into(),
            expected: USUAL_CHROMIUM.join(" or "),
            hint: format!("on Debian: apt install chromium; or name another one in {CHROMIUM}"),
        });
    };
    process::visible(&mut workspace.cargo(["build", "--release"].into_iter().chain(ALL)))?;
    let test =
        ["test", "--release"].into_iter().chain(ALL).chain(["--test", "cli", "--", "--ignored", "studio_killed"]);
    let mut killing = workspace.cargo(test);
    if let Some(kills) = kills {
        killing.env(KILLS.1, kills);
    }
    process::visible(&mut killing)?;
    let mut browser = npm(workspace);
    browser.args(["run", "--silent", "long", "--", "--program"]).arg(workspace.genmanip()?).args(others);
    process::visible(browser.env(CHROMIUM, path))
}

/// The number of kills, if given, and the options for the browser.
fn long_options(options: &[String]) -> Result<(Option<String>, Vec<String>)> {
    let (mut kills, mut others) = (None, Vec::new());
    for pair in options.chunks(2) {
        let is_number = pair.get(1).is_some_and(|value| value.parse::<u32>().is_ok());
        match pair {
            [name, value] if is_number && name == KILLS.0 => kills = Some(value.clone()),
            [name, _] if is_number && LONG_OPTIONS.contains(&name.as_str()) => others.extend_from_slice(pair),
            _ => {
                return Err(Problem {
                    what: format!("the long tests do not know `{}`", pair.join(" ")),
                    expected: format!("{} or {}, each with a number", LONG_OPTIONS.join(", "), KILLS.0),
                    hint: "such as `cargo xtask test web --long --faults 50 --orbit-s 60`".into(),
                });
            }
        }
    }
    Ok((kills, others))
}

fn npm(workspace: &Workspace) -> Command {
    let mut npm = workspace.command("npm");
    npm.current_dir(workspace.root.join(FOLDER)).env("PLAYWRIGHT_SKIP_BROWSER_DOWNLOAD", "1");
    npm
}

/// Chromium of the variable, else of the usual places.
fn chromium() -> Option<PathBuf> {
    let named = std::env::var_os(CHROMIUM).map(PathBuf::from);
    named.into_iter().chain(USUAL_CHROMIUM.map(PathBuf::from)).find(|path| path.is_file())
}

fn compare_builds(workspace: &Workspace) -> Result {
    process::visible(npm(workspace).args(["run", "--silent", "build", "--", "--emptyOutDir", "--outDir", REBUILT]))?;
    let folder = workspace.root.join(FOLDER);
    let (committed, rebuilt) = (files(&folder.join("dist"))?, files(&folder.join(REBUILT))?);
    let Some(name) = first_difference(&committed, &rebuilt) else { return Ok(()) };
    Err(Problem {
        what: format!("web/dist/{name} is not what web/src builds to"),
        expected: "the same bytes from the same sources and packages".into(),
        hint: "`cargo xtask setup web`, then `npm run build` in web/, and commit web/dist".into(),
    })
}

/// Contents of all files beneath a folder, by their path in it.
fn files(folder: &Path) -> Result<BTreeMap<String, Vec<u8>>> {
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(folder).on("list", folder)? {
        let path = entry.on("list", folder)?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if path.is_dir() {
            found.extend(files(&path)?.into_iter().map(|(inner, bytes)| (format!("{name}/{inner}"), bytes)));
        } else {
            found.insert(name, fs::read(&path).on("read", &path)?);
        }
    }
    Ok(found)
}

/// Name of the first file that only one side has, or that differs.
fn first_difference<'a>(left: &'a BTreeMap<String, Vec<u8>>, right: &'a BTreeMap<String, Vec<u8>>) -> Option<&'a str> {
    left.keys().chain(right.keys()).find(|name| left.get(*name) != right.get(*name)).map(String::as_str)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_difference_of_builds_is_named() {
        let build = |files: &[(&str, &str)]| {
            files.iter().map(|(name, text)| ((*name).to_owned(), text.as_bytes().to_vec())).collect::<BTreeMap<_, _>>()
        };
        let committed = build(&[("assets/app.js", "a"), ("index.html", "b")]);
        assert_eq!(first_difference(&committed, &committed), None);
        for (rebuilt, expected) in [
            (build(&[("assets/app.js", "changed"), ("index.html", "b")]), "assets/app.js"),
            (build(&[("assets/app.js", "a")]), "index.html"),
            (build(&[("assets/app.js", "a"), ("assets/new.js", "c"), ("index.html", "b")]), "assets/new.js"),
        ] {
            assert_eq!(first_difference(&committed, &rebuilt), Some(expected));
        }
    }

    #[test]
    fn options_of_long_tests_go_where_they_belong() {
        let split = |text: &str| long_options(&text.split_whitespace().map(String::from).collect::<Vec<_>>());
        let (kills, others) = split("--faults 50 --kills 3 --seed 2").unwrap();
        assert_eq!((kills.as_deref(), others.join(" ").as_str()), (Some("3"), "--faults 50 --seed 2"));
        for wrong in ["--faults", "--faults many", "--fault 5", "5"] {
            assert!(split(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn packages_are_pinned_and_name_no_registry() {
        let package = include_str!("../../web/package.json");
        let ranges = package.lines().filter(|line| line.contains("\": \"^") || line.contains("\": \"~"));
        assert_eq!(ranges.collect::<Vec<_>>(), Vec::<&str>::new());
        assert!(!include_str!("../../web/package-lock.json").contains("\"resolved\""));
    }
}
