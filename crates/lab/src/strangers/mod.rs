//! Robots, objects and datasets of other people, from a folder: files that are read, refused, or read with omissions,
//! and the time of reading.

mod arms;

use std::collections::BTreeMap;
use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

use genmanip_core::{Seed, limits};
use genmanip_data::files;
use genmanip_dataset_tools::check;
use genmanip_import::robots::{self, PlannedRobot};
use genmanip_import::{Given, import, packs};
use genmanip_workspace::{Progress, with_causes};
use serde::Serialize;

use crate::LabError;
use crate::clock::cpu_clock;
pub use arms::Planned;

/// CPU time above which a file counts as slow, s.
const SLOW_S: f64 = 5.0;
/// Maximum depth of the search in folders.
const MAX_DEPTH: usize = 24;
/// Range of degrees of freedom of robots that motions are planned for.
const PLANNED_DOF: std::ops::RangeInclusive<usize> = 3..=20;

/// Files to read, and amount of planning.
#[derive(Clone, Debug)]
pub struct StrangersArguments {
    /// Folder with files of other people.
    pub folder: PathBuf,
    /// Folders of meshes, and options of the reader of robots.
    pub urdf: robots::Settings,
    /// Kinds to try, some of [`KINDS`]; all if empty.
    pub kinds: Vec<String>,
    /// Number of random motions planned for each arm.
    pub pairs: usize,
}

/// Kinds of files that are recognised, by name.
pub const KINDS: [&str; 3] = ["robot", "object", "dataset"];

/// Outcome of one file, or one flaw in reading it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// Read without a flaw.
    Ok,
    /// Refused with a message.
    Said,
    /// Read, with parts dropped that no note mentions.
    Silent,
    /// Read, with a result that contradicts the file.
    Wrong,
    /// The reader panicked.
    Crashed,
}

/// Numbers of files by outcome.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Counts {
    /// Number of files tried.
    pub tried: usize,
    /// Number of files read without a flaw.
    pub ok: usize,
    /// Number of files refused with a message.
    pub said: usize,
    /// Number of files read with parts dropped that no note mentions.
    pub silent: usize,
    /// Number of files whose result contradicts them.
    pub wrong: usize,
    /// Number of files at which a reader panicked.
    pub crashed: usize,
    /// Number of files that took more than 5 s of CPU time.
    pub slow: usize,
}

/// A flaw of a file; a file may have several.
#[derive(Clone, Debug, Serialize)]
pub struct Problem {
    /// Path of the file, relative to the folder.
    pub file: String,
    /// Kind of the file, one of [`KINDS`].
    pub kind: &'static str,
    /// Outcome that the flaw gives the file.
    pub outcome: Outcome,
    /// Description of what happened.
    pub message: String,
}

/// A robot that was read.
#[derive(Clone, Debug, Serialize)]
pub struct RobotRow {
    /// Path of the file, relative to the folder.
    pub file: String,
    /// Degrees of freedom of the arm.
    pub joints: usize,
    /// Name of the tool frame's link.
    pub tool_frame: String,
    /// CPU time of reading the robot, s.
    pub load_s: f64,
    /// Notes of the reader: assumptions, repairs and omissions.
    pub notes: Vec<String>,
    /// Random motions; `None` for robots with fewer than 3 or more than 20 degrees of freedom, or without an arm.
    pub planned: Option<Planned>,
}

/// Outcomes of all files of a folder.
#[derive(Debug, Default, Serialize)]
pub struct Measured {
    /// Counts over all kinds.
    #[serde(flatten)]
    pub all: Counts,
    /// Counts by kind.
    pub by_kind: BTreeMap<&'static str, Counts>,
    /// Flaws of all files.
    pub problems: Vec<Problem>,
    /// Number of robots refused because a mesh file does not exist.
    pub without_meshes: usize,
    /// Median and largest CPU time of reading a robot, s.
    pub load_s: [f64; 2],
    /// Robots that were read.
    pub robots: Vec<RobotRow>,
}

/// Reads every file of the requested kinds in a folder and the folders below it.
///
/// # Errors
/// If the folder cannot be listed, or holds no file of these kinds.
pub fn measure(arguments: &StrangersArguments, seed: Seed, progress: &dyn Progress) -> Result<Measured, LabError> {
    let mut found = Vec::new();
    list(&arguments.folder, 0, &mut found)?;
    let mut measured = Measured::default();
    let wants = |kind: &str| arguments.kinds.is_empty() || arguments.kinds.iter().any(|wanted| wanted == kind);
    let has_ending =
        |path: &Path, ending: &str| path.extension().is_some_and(|found| found.eq_ignore_ascii_case(ending));
    let described = found.iter().filter(|path| has_ending(path, "urdf") || has_ending(path, "xacro"));
    for path in described.filter(|path| wants("robot") && !is_object(path)) {
        robot(arguments, path, seed, &mut measured, progress);
    }
    if wants("object") {
        for candidate in packs::candidates(std::slice::from_ref(&arguments.folder), None).unwrap_or_default() {
            let path = candidate.root.join(&candidate.path);
            if !has_ending(&path, "urdf") || is_object(&path) {
                measured.object(&arguments.folder, &path, progress);
            }
        }
    }
    for path in found.iter().filter(|path| wants("dataset") && path.ends_with("meta/info.json")) {
        if let Some(folder) = path.ancestors().nth(2) {
            measured.dataset(&arguments.folder, folder, progress);
        }
    }
    if measured.all.tried == 0 {
        return Err(LabError::input(format!("{} holds nothing to try", arguments.folder.display()))
            .with_hint("expected URDF files, objects (GLB, OBJ, MJCF, …) or LeRobot datasets, at any depth"));
    }
    let mut times: Vec<f64> = measured.robots.iter().map(|robot| robot.load_s).collect();
    times.sort_by(f64::total_cmp);
    let at = |index: usize| times.get(index).copied().unwrap_or(0.0);
    measured.load_s = [at(times.len() / 2), at(times.len().saturating_sub(1))];
    Ok(measured)
}

/// True for URDF files of objects: by the file names that PartNet-Mobility and similar collections use, or since nothing
/// moves in them.
fn is_object(path: &Path) -> bool {
    let named = |names: &[&str]| path.file_name().is_some_and(|name| names.iter().any(|known| name == *known));
    let is_rigid = |text: &str| {
        let moves = ["revolute", "continuous", "prismatic"].iter().any(|kind| text.contains(kind));
        text.contains("<link") && !moves && !text.contains("xacro:")
    };
    named(&["mobility.urdf", "model.urdf"])
        || files::read(path, limits::ROBOT).is_ok_and(|bytes| is_rigid(&String::from_utf8_lossy(&bytes)))
}

fn list(folder: &Path, depth: usize, found: &mut Vec<PathBuf>) -> Result<(), LabError> {
    let entries = fs::read_dir(folder).map_err(|error| LabError::file("list", folder, error))?;
    let mut paths: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
    paths.sort();
    for path in paths {
        let is_link = fs::symlink_metadata(&path).is_ok_and(|about| about.is_symlink());
        if path.is_dir() && !is_link && depth < MAX_DEPTH {
            list(&path, depth + 1, found)?;
        } else if path.is_file() {
            found.push(path);
        }
    }
    Ok(())
}

/// Result of the work, `None` if it panicked, and its CPU time, s.
fn timed<T>(work: impl FnOnce() -> T) -> (Option<T>, f64) {
    let mut clock = cpu_clock();
    let done = catch_unwind(AssertUnwindSafe(work)).ok();
    (done, clock())
}

fn robot(arguments: &StrangersArguments, path: &Path, seed: Seed, measured: &mut Measured, progress: &dyn Progress) {
    let file = relative(&arguments.folder, path);
    let (read, load_s) = timed(|| robots::read(path, &arguments.urdf));
    let PlannedRobot { model, notes } = match read {
        None => return measured.count("robot", &file, &[(Outcome::Crashed, "panic".into())], load_s, progress),
        Some(Err(error)) => {
            let message = with_causes(&error);
            measured.without_meshes += usize::from(message.contains("no such file"));
            return measured.count("robot", &file, &[(Outcome::Said, message)], load_s, progress);
        }
        Some(Ok(read)) => read,
    };
    let mut flaws: Vec<(Outcome, String)> = Vec::new();
    if let Some(dropped) = dropped(path, &model, &notes) {
        flaws.push((Outcome::Silent, dropped));
    }
    let mut row = RobotRow {
        file: file.clone(),
        joints: model.arm_dof(),
        tool_frame: model.links[model.hand].name.clone(),
        load_s,
        notes,
        planned: None,
    };
    if arguments.pairs > 0 && PLANNED_DOF.contains(&model.arm_dof()) {
        match timed(|| arms::plan(model, arguments.pairs, seed)).0 {
            None => flaws.push((Outcome::Crashed, "panic while planning".into())),
            Some(Err(error)) => flaws.push((Outcome::Wrong, error)),
            Some(Ok(planned)) => {
                if planned.touching > 0 {
                    flaws.push((Outcome::Wrong, format!("{} paths touch something", planned.touching)));
                }
                row.planned = Some(planned);
            }
        }
    }
    measured.robots.push(row);
    measured.count("robot", &file, &flaws, load_s, progress);
}

/// Description of parts of a URDF file that are neither in the model nor mentioned in a note; `None` if there are none.
/// The parts are counted in the text, independently of the reader.
fn dropped(path: &Path, model: &genmanip_core::RobotModel, notes: &[String]) -> Option<String> {
    let text = String::from_utf8_lossy(&files::read(path, limits::ROBOT).ok()?).into_owned();
    let text = without(&without(&text, "<!--", "-->"), "<gazebo", "</gazebo>");
    let said = |words: &[&str]| notes.iter().any(|note| words.iter().any(|word| note.contains(word)));
    let tags = |tag: &str| -> Vec<&str> {
        let starts = text.match_indices(tag).map(|(at, _)| &text[at + tag.len()..]);
        let of_tag = starts.filter(|rest| rest.starts_with(|c: char| c.is_whitespace() || c == '>' || c == '/'));
        of_tag.filter_map(|rest| rest.split('>').next()).collect()
    };
    let collisions = tags("<collision").len();
    // Counted per link: one mesh may give several pieces.
    let missing: usize = text.split("<link").skip(1).map(|link| missing_pieces(link, model)).sum();
    if missing > 0 && !said(&["left out", "no triangles"]) {
        return Some(format!("{missing} of {collisions} collision geometries are missing"));
    }
    let moving = |tag: &&str| {
        ["revolute", "continuous", "prismatic", "floating", "planar"]
            .iter()
            .any(|kind| [format!("\"{kind}\""), format!("'{kind}'")].iter().any(|quoted| tag.contains(quoted.as_str())))
    };
    let (joints, moved) = (
        tags("<joint").into_iter().filter(moving).count(),
        model.links.iter().filter(|link| link.joint.is_some()).count(),
    );
    if moved < joints && !said(&["fixed", "follows"]) {
        return Some(format!("{} of {joints} moving joints are missing", joints - moved));
    }
    let follows = |block: &&str| {
        moving(&block.split('>').next().unwrap_or_default())
            && block.split("</joint>").next().is_some_and(|joint| joint.contains("<mimic"))
    };
    let mimics = text.split("<joint").skip(1).filter(follows).count();
    let coupled =
        model.links.iter().filter(|link| link.joint.as_ref().is_some_and(|joint| joint.mimic.is_some())).count();
    if coupled < mimics && !said(&["fixed", "moves by itself"]) {
        return Some(format!("{} of {mimics} coupled joints do not follow", mimics - coupled));
    }
    (collisions == 0 && !tags("<visual").is_empty() && !said(&["collision geometry", "hulls of visual"]))
        .then(|| "nothing collides".into())
}

/// Number of `<collision>` elements of a link, its text after `<link`, beyond the link's collision pieces.
fn missing_pieces(link: &str, model: &genmanip_core::RobotModel) -> usize {
    let Some((tag, rest)) = link.split_once('>').filter(|(tag, _)| !tag.ends_with('/')) else { return 0 };
    let name = tag.split_once("name=").map_or("", |(_, name)| name);
    let name = name.get(1..).and_then(|name| name.split(['"', '\'']).next()).unwrap_or_default();
    let stated = rest.split("</link>").next().unwrap_or_default().matches("<collision").count();
    let found = model.links.iter().find(|link| link.name == name).map_or(0, |link| link.pieces.len());
    stated.saturating_sub(found)
}

/// A text without everything between two marks, the marks included.
fn without(text: &str, from: &str, to: &str) -> String {
    let mut kept = String::new();
    let mut rest = text;
    while let Some((before, after)) = rest.split_once(from) {
        kept.push_str(before);
        rest = after.split_once(to).map_or("", |(_, after)| after);
    }
    kept + rest
}

fn relative(folder: &Path, path: &Path) -> String {
    path.strip_prefix(folder).unwrap_or(path).display().to_string()
}

impl Measured {
    /// Counts a file by the worst of its flaws.
    fn count(
        &mut self,
        kind: &'static str,
        file: &str,
        flaws: &[(Outcome, String)],
        cpu_s: f64,
        progress: &dyn Progress,
    ) {
        let outcome = flaws.iter().map(|(outcome, _)| *outcome).max().unwrap_or(Outcome::Ok);
        for counts in [&mut self.all, self.by_kind.entry(kind).or_default()] {
            counts.tried += 1;
            counts.slow += usize::from(cpu_s > SLOW_S);
            match outcome {
                Outcome::Ok => counts.ok += 1,
                Outcome::Said => counts.said += 1,
                Outcome::Silent => counts.silent += 1,
                Outcome::Wrong => counts.wrong += 1,
                Outcome::Crashed => counts.crashed += 1,
            }
        }
        let messages = flaws.iter().map(|(_, message)| message.as_str()).collect::<Vec<_>>().join("; ");
        progress.note(&format!("{kind} {file}: {}{messages} ({cpu_s:.2} s)", outcome.word()));
        for (outcome, message) in flaws {
            self.problems.push(Problem { file: file.to_owned(), kind, outcome: *outcome, message: message.clone() });
        }
    }

    fn object(&mut self, folder: &Path, path: &Path, progress: &dyn Progress) {
        let root = path.parent().unwrap_or(folder);
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let mut from_disk = |named: &str, limit| match root.join(named) {
            found if found.is_file() => files::read(&found, limit).map_err(|error| error.to_string()),
            _ => Err("no such file".to_owned()),
        };
        let (read, cpu_s) = timed(|| import(&name, &mut from_disk, &Given::default(), None).map(drop));
        let flaws = match read {
            None => vec![(Outcome::Crashed, "panic".into())],
            Some(Err(error)) => vec![(Outcome::Said, error.to_string())],
            Some(Ok(())) => vec![],
        };
        self.count("object", &relative(folder, path), &flaws, cpu_s, progress);
    }

    fn dataset(&mut self, folder: &Path, dataset: &Path, progress: &dyn Progress) {
        let (checked, cpu_s) = timed(|| check::check(dataset, &[]));
        let flaws = match checked {
            None => vec![(Outcome::Crashed, "panic".into())],
            Some(Err(error)) => vec![(Outcome::Said, with_causes(&error))],
            Some(Ok(checked)) => {
                let said = |finding: &check::Finding| {
                    (Outcome::Said, format!("{}: {}: expected {}", finding.check, finding.file, finding.expected))
                };
                checked.findings.iter().map(said).collect()
            }
        };
        self.count("dataset", &relative(folder, dataset), &flaws, cpu_s, progress);
    }
}

impl Outcome {
    fn word(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::Said => "refused: ",
            Self::Silent => "dropped without a note: ",
            Self::Wrong => "wrong: ",
            Self::Crashed => "crashed: ",
        }
    }
}

/// Text summary: a row per kind, then a Markdown table of the robots.
pub fn describe(measured: &Measured) -> String {
    let mut text = String::new();
    for (kind, counts) in &measured.by_kind {
        let Counts { tried, ok, said, silent, wrong, crashed, slow } = counts;
        text += &format!(
            "{kind:8} {tried} tried: {ok} ok, {said} refused, {silent} dropped something silently, {wrong} wrong, {crashed} \
             crashed; {slow} slow\n"
        );
    }
    let [median_s, worst_s] = measured.load_s;
    text += &format!(
        "{} robots lack a mesh; those read took {median_s:.2} s at the median, {worst_s:.2} s at most\n\n\
         | robot | joints | tool frame | load, CPU s | solved of solvable pairs |\n|---|---|---|---|---|\n",
        measured.without_meshes
    );
    for RobotRow { file, joints, tool_frame, load_s, planned, .. } in &measured.robots {
        let planned = planned.as_ref().map_or("–".into(), |planned| match &planned.refused {
            Some(reason) => format!("– ({reason})"),
            None => format!("{} of {}", planned.solved, planned.solvable),
        });
        text += &format!("| {file} | {joints} | {tool_frame} | {load_s:.2} | {planned} |\n");
    }
    text
}
