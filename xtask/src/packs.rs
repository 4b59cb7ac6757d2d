//! `cargo xtask test --packs`: real objects of published packages come in, rest and are held.
//!
//! The manifest names wheels with their versions and the files in them; nothing of them is kept in the repository.

use crate::problem::{OnPath, Problem, Result};
use crate::process::{self, Workspace};
use std::fs;
use std::path::{Path, PathBuf};

const MANIFEST: &str = "crates/import/testdata/packs.txt";
/// Shares that must be reached: of files that come in and rest, and of what the hand could hold that was held.
const MIN_IMPORTED: f64 = 0.95;
const MIN_HELD: f64 = 0.80;

/// A wheel with the files that are imported of it.
struct Wheel {
    name: String,
    version: String,
    /// Folder in the wheel that no file leaves.
    root: String,
    files: Vec<String>,
}

/// Outcome of importing files.
#[derive(Debug, Default, PartialEq)]
struct Tally {
    files: usize,
    imported: usize,
    rests: usize,
    could_be_held: usize,
    held: usize,
}

/// Downloads the wheels, imports the files of the manifest and compares with the bars.
pub fn run(workspace: &Workspace) -> Result {
    let path = workspace.root.join(MANIFEST);
    let wheels = read(&fs::read_to_string(&path).on("read", &path)?)?;
    let place = workspace.target_dir()?.join("packs");
    let mut sum = Tally::default();
    for wheel in &wheels {
        let folder = unpacked(workspace, wheel, &place)?;
        let mut command = workspace.command(workspace.genmanip()?);
        command.current_dir(&folder).args(["--json", "--quiet", "--packs"]).arg(place.join("imported"));
        command.args(["assets", "import", "--pack", &wheel.name, "--root", &wheel.root]);
        command.args(wheel.files.iter().map(|file| format!("{}/{file}", wheel.root)));
        // Refused files end the program with 1; what it printed is counted all the same.
        let output = command.output().map_err(|error| process::cannot_start("genmanip assets import", &error))?;
        let tally = count(&String::from_utf8_lossy(&output.stdout), wheel.files.len());
        println!("{:<22} {tally}", format!("{} {}", wheel.name, wheel.version));
        sum.add(&tally);
    }
    println!("{:<22} {sum}", "together");
    let share = |part: usize, of: usize| part as f64 / of.max(1) as f64;
    if share(sum.rests.min(sum.imported), sum.files) < MIN_IMPORTED || share(sum.held, sum.could_be_held) < MIN_HELD {
        return Err(Problem {
            what: "too few of the files come in and rest, or too few of their objects are held".into(),
            expected: format!("{:.0} % that come in and rest, {:.0} % held", 100.0 * MIN_IMPORTED, 100.0 * MIN_HELD),
            hint: format!("the lists in {} say why", place.join("imported").display()),
        });
    }
    Ok(())
}

impl Tally {
    fn add(&mut self, other: &Self) {
        self.files += other.files;
        self.imported += other.imported;
        self.rests += other.rests;
        self.could_be_held += other.could_be_held;
        self.held += other.held;
    }
}

impl std::fmt::Display for Tally {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { files, imported, rests, could_be_held, held } = self;
        write!(
            f,
            "{imported} of {files} come in, {rests} rest, {held} of {could_be_held} that the hand could hold are held"
        )
    }
}

/// The manifest: `NAME VERSION ROOT` begins a wheel, lines that begin with blanks are files in it, # a comment.
fn read(text: &str) -> Result<Vec<Wheel>> {
    let mut wheels: Vec<Wheel> = Vec::new();
    for (index, line) in text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty() && !line.starts_with('#'))
    {
        let words: Vec<&str> = line.split_whitespace().collect();
        match (line.starts_with(' '), words.as_slice(), wheels.last_mut()) {
            (true, [file], Some(wheel)) => wheel.files.push((*file).to_owned()),
            (false, [name, version, root], _) => {
                let [name, version, root] = [name, version, root].map(|word| (*word).to_owned());
                wheels.push(Wheel { name, version, root, files: Vec::new() });
            }
            _ => {
                return Err(Problem {
                    what: format!("{MANIFEST}, line {}: `{line}`", index + 1),
                    expected: "`NAME VERSION ROOT`, or a file after blanks".into(),
                    hint: String::new(),
                });
            }
        }
    }
    Ok(wheels)
}

/// The unpacked wheel; it is downloaded once.
fn unpacked(workspace: &Workspace, wheel: &Wheel, place: &Path) -> Result<PathBuf> {
    let folder = place.join(format!("{}-{}", wheel.name, wheel.version));
    if folder.join(&wheel.root).is_dir() {
        return Ok(folder);
    }
    let aside = place.join("download");
    let _ = fs::remove_dir_all(&aside);
    fs::create_dir_all(&aside).on("make the folder", &aside)?;
    eprintln!("packs: downloading {} {}", wheel.name, wheel.version);
    let mut pip = workspace.command("python3");
    pip.args(["-m", "pip", "download", "--quiet", "--no-deps", "--only-binary=:all:", "--implementation", "cp"]);
    pip.args(["--python-version", "311", "--dest"]).arg(&aside).arg(format!("{}=={}", wheel.name, wheel.version));
    process::output(&mut pip)?;
    let file =
        fs::read_dir(&aside).on("read", &aside)?.flatten().map(|entry| entry.path()).next().ok_or_else(|| Problem {
            what: format!("pip succeeded but left no wheel of {}", wheel.name),
            expected: "one wheel".into(),
            hint: String::new(),
        })?;
    process::output(workspace.command("python3").args(["-m", "zipfile", "-e"]).arg(&file).arg(&folder))?;
    Ok(folder)
}

/// Sums over the rows of `assets import --json`; each starts with its file.
fn count(json: &str, files: usize) -> Tally {
    let dense: String = json.chars().filter(|c| !c.is_whitespace()).collect();
    let mut tally = Tally { files, ..Tally::default() };
    for row in dense.split("{\"file\":").skip(1) {
        let is_held = row.contains("\"can_grasp\":true") && !row.contains("\"grasps\":0");
        tally.imported += usize::from(!row.contains("\"error\":"));
        tally.rests += usize::from(row.contains("\"rests\":true"));
        tally.could_be_held += usize::from(row.contains("\"can_grasp\":true"));
        tally.held += usize::from(is_held);
    }
    tally
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn manifests_and_rows_are_read() {
        let wheels = read("# c\nrobosuite 1.5.2 robosuite/models\n  objects/can.xml\n  objects/milk.xml\n").unwrap();
        assert_eq!((wheels.len(), wheels[0].files.len(), wheels[0].root.as_str()), (1, 2, "robosuite/models"));
        assert!(read("robosuite\n").is_err());
        let rows = r#"[{"file": "a", "rests": true, "can_grasp": true, "grasps": 3}, {"file": "b", "error": "no", "rests": false,
            "can_grasp": false, "grasps": 0}, {"file": "c", "rests": true, "can_grasp": true, "grasps": 0}]"#;
        assert_eq!(count(rows, 4), Tally { files: 4, imported: 2, rests: 2, could_be_held: 2, held: 1 });
    }
}
