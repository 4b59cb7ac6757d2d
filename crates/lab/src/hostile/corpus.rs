//! Valid inputs of every kind, and the calls that read them.

use std::fs;
use std::path::Path;

use genmanip_core::Seed;
use rand::{Rng, RngExt};
use serde_json::Value;

use super::child::{self, Limits};
use super::full::Filling;
use super::imports::Imports;
use super::{HostileArguments, Sandbox, imports, listing, mutate};
use crate::LabError;

/// Kinds of inputs, the keys of `Measured::by_kind`.
pub const KINDS: [&str; 24] = [
    "tasks",
    "answers",
    "scenarios",
    "worlds",
    "episodes",
    "evaluations",
    "problems",
    "robots",
    "cassettes",
    "settings",
    "grasps",
    "cameras",
    "import-glb",
    "import-gltf",
    "import-obj",
    "import-stl",
    "import-msh",
    "import-urdf",
    "import-mjcf",
    "dataset-lerobot",
    "dataset-v21",
    "dataset-zarr",
    "dataset-original",
    FULL,
];
/// Kind of files at their size limit; each takes seconds to read, so they are drawn rarely.
pub(super) const FULL: &str = "full";

/// Prefix of the kinds of datasets.
const DATASET: &str = "dataset-";

/// Content of an input file.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Content {
    Bytes(Vec<u8>),
    /// Symbolic link to a file outside the sandbox.
    LinkOutside,
    /// Symbolic link to an endless device (`/dev/zero`).
    LinkZero,
    Pipe,
    Folder,
    Nothing,
}

/// One call of the program with its input files.
#[derive(Clone, Debug)]
pub(super) struct Case {
    pub(super) kind: String,
    pub(super) files: Vec<(String, Content)>,
    /// Indices of the files that may be mutated.
    targets: Vec<usize>,
    pub(super) call: Vec<String>,
    /// True if a refusal must leave the folder unchanged.
    pub(super) only_reads: bool,
}

/// Valid inputs of every kind.
pub(super) struct Corpus {
    tasks: Vec<(String, Vec<u8>)>,
    /// Files of a run of two tasks with an evaluation.
    run: Vec<(String, Vec<u8>)>,
    scenario: Vec<u8>,
    world: Vec<u8>,
    problems: Vec<u8>,
    cassettes: Vec<(String, Vec<u8>)>,
    grasps: Vec<u8>,
    /// Files of the same run exported in several dataset formats.
    datasets: Vec<(String, Vec<u8>)>,
    imports: Imports,
    kept: Vec<Case>,
    fillings: Vec<Filling>,
}

/// URDF of a small arm with every kind of geometry.
const ARM: &str = include_str!("../../testdata/arm.urdf");
const RULES: &str = "<robot name=\"six\">\n  <disable_collisions link1=\"base\" link2=\"upper\" reason=\"Never\"/>\n  \
                     <end_effector name=\"tool\" parent_link=\"flange\" group=\"hand\"/>\n</robot>\n";
const BRICK: &str = "v -0.15 -0.03 -0.03\nv 0.15 -0.03 -0.03\nv -0.15 0.03 -0.03\nv 0.15 0.03 -0.03\n\
                     v -0.15 -0.03 0.03\nv 0.15 -0.03 0.03\nv -0.15 0.03 0.03\nv 0.15 0.03 0.03\n";
const SETTINGS: &str = "[server]\nbase_url = \"http://127.0.0.1:9/v1\"\nmodel = \"none\"\nmax_retries = 0\n\
                        [server.parameters]\ntemperature = 0.7\n[cassettes]\nmode = \"replay\"\nfolder = \"cassettes\"\n\
                        [generation]\nmax_rounds = 2\nworkers = 1\nmin_objects = 3\n[prices.none]\ninput_per_million = 1.0\n\
                        output_per_million = 2.0\n";
const TRIES: Limits = Limits { memory_mib: 8192, cpu_s: 600, idle_s: 600 };

impl Corpus {
    /// Makes the valid inputs with the program itself.
    pub(super) fn make(arguments: &HostileArguments, sandbox: &Sandbox) -> Result<Self, LabError> {
        let HostileArguments { project, .. } = arguments;
        let examples = project.join("examples/tasks");
        let run = |call: &[&str]| -> Result<(), LabError> {
            let call: Vec<String> = call.iter().map(|word| (*word).to_owned()).collect();
            let ended = child::run(arguments, &call, sandbox, TRIES)?;
            match ended.code {
                Some(0) => Ok(()),
                _ => Err(LabError::input(format!("a sound input cannot be made: {}", ended.stderr.trim()))
                    .with_hint("run in the project's folder, or name it with --project")),
            }
        };
        let example = |name: &str| examples.join(name).display().to_string();
        let (first, second) = (example("021_spatial.json"), example("024_appearance.json"));
        // Importing objects needs no inputs made by the program, so that such a measurement starts at once.
        let needs_program = arguments.readers || !arguments.kind.as_deref().is_some_and(imports::is_kind);
        if needs_program {
            run(&["collect", &first, &second, "--episodes", "1", "--no-dataset", "--seed", "3", "--out", "run"])?;
            run(&["evaluate", "run", "--policy", "do_nothing:seconds=0.1", "--keep-episodes"])?;
            run(&["world", "init", "--out", "world.toml"])?;
            run(&["lab", "motion", "--generate", "easy", "--count", "2", "--ik-poses", "1", "--out", "problems.json"])?;
            run(&["grasps", "bake", "--out", "grasps.json", "--objects", "001", "--count", "1", "--trials", "1"])?;
        }
        let made = listing(&sandbox.work());
        let mut datasets = Vec::new();
        if needs_program && arguments.kind.as_deref().is_none_or(|kind| kind.starts_with(DATASET)) {
            let pictures = ["--rate", "10", "--cameras", "wrist"];
            let numbers = ["--rate", "10", "--no-images"];
            for (format, name, more) in
                [("lerobot", "lerobot", &pictures[..]), ("lerobot-v2.1", "v21", &pictures), ("zarr", "zarr", &numbers)]
            {
                run(&[&["export", "run", "--to", format, "--out", name], more].concat())?;
            }
            let is_dataset = |name: &str| !name.starts_with("run/") && !name.ends_with('/') && !made.contains_key(name);
            datasets = listing(&sandbox.work()).into_iter().filter(|(name, _)| is_dataset(name)).collect();
            let original = read_all(&project.join("crates/dataset-tools/testdata/original"))?;
            datasets.extend(original.into_iter().map(|(name, bytes)| (format!("original/{name}"), bytes)));
        }
        let file = |name: &str| made.get(name).cloned().unwrap_or_default();
        let below = |folder: &str| -> Vec<(String, Vec<u8>)> {
            let inside = made.iter().filter(|(name, _)| name.starts_with(folder) && !name.ends_with('/'));
            inside.map(|(name, bytes)| (name.clone(), bytes.clone())).collect()
        };
        let mut corpus = Self {
            tasks: read_all(&examples)?,
            scenario: file("run/scenarios/021_spatial-000.json"),
            run: below("run/"),
            world: file("world.toml"),
            problems: file("problems.json"),
            cassettes: read_all(&project.join("crates/task-writer/testdata/cassettes"))?,
            grasps: file("grasps.json"),
            datasets,
            imports: Imports::read(project)?,
            kept: kept(&project.join("crates/lab/testdata/hostile"))?,
            fillings: Filling::fixed(),
        };
        let value = |name: &str| serde_json::from_slice(&corpus.run_file(name)?).ok();
        let sound = Filling::sound(value);
        corpus.fillings.extend(sound);
        sandbox.clear()?;
        Ok(corpus)
    }

    /// Files of a dataset kind and of the datasets that belong to it, and the calls that read them.
    fn dataset(&self, kind: &str) -> (Vec<(String, Content)>, &'static [&'static str]) {
        let name = kind.trim_start_matches(DATASET);
        let content = |(name, bytes): &(String, Vec<u8>)| (name.clone(), Content::Bytes(bytes.clone()));
        let is_own = |(known, _): &&(String, Vec<u8>)| {
            known.strip_prefix(name).is_some_and(|rest| rest.starts_with('/') || rest.starts_with("-depth/"))
        };
        let mut files: Vec<_> = self.datasets.iter().filter(is_own).map(content).collect();
        if name == "lerobot" {
            files.extend(self.run.iter().map(content));
        }
        let calls: &[&str] = match name {
            "lerobot" => &[
                "data check lerobot",
                "data check lerobot --json",
                "data show lerobot",
                "data card lerobot",
                "data filter lerobot --where success=true --out out",
                "data merge lerobot --out out",
                "data delete lerobot --episodes 0 --out out",
                "data convert lerobot --to lerobot-v2.1 --out out",
                "evaluate run --policy playback:dataset=lerobot",
            ],
            "v21" => &["data check v21", "data show v21", "data import v21 --out out"],
            "original" => &["data import original --out out"],
            _ => &["data check zarr", "data show zarr"],
        };
        (files, calls)
    }

    /// Inputs of the kept corpus, which once caused a violation.
    pub(super) fn kept(&self) -> Vec<Case> {
        self.kept.clone()
    }

    /// A valid input of a kind with a call that reads it.
    pub(super) fn case(&self, kind: &str, rng: &mut impl Rng) -> Result<Case, LabError> {
        if kind == FULL {
            return self.full(rng);
        }
        if let Some((files, call)) = self.imports.case(kind, rng) {
            let files: Vec<_> =
                files.iter().map(|(name, bytes)| (name.clone(), Content::Bytes(bytes.clone()))).collect();
            let targets = (0..files.len()).collect();
            return Ok(Case { kind: kind.into(), files, targets, call, only_reads: false });
        }
        let one = |name: &str, bytes: &[u8]| vec![(name.to_owned(), Content::Bytes(bytes.to_vec()))];
        let task = || self.tasks.first().map(|(_, bytes)| bytes.clone()).unwrap_or_default();
        let answer = self.tasks.get(rng.random_range(0..self.tasks.len().max(1))).map(|(_, bytes)| bytes.clone());
        let document = self.run_file("run/run.json").and_then(|run| task_of(&run)).unwrap_or_else(task);
        let (files, calls): (Vec<(String, Content)>, &[&str]) = match kind {
            "tasks" => (
                one("task.json", &document),
                &["task show task.json --svg out.svg", "task show task.json", "task show task.json --json"],
            ),
            "answers" => (
                one("answer.json", &answer.unwrap_or_default()),
                &[
                    "task check answer.json",
                    "task show answer.json",
                    "task check answer.json --objects 001,002,019 --kind spatial",
                ],
            ),
            "scenarios" => (
                one("scenario.json", &self.scenario),
                &[
                    "export --mjcf scenario.json",
                    "camera list scenario.json",
                    "plan scenario.json --to 0.5,0.1,0.3",
                    "camera preview scenario.json --size 48x32 --out views",
                    "evaluate scenario.json --policy do_nothing:seconds=0.1",
                ],
            ),
            "worlds" => (
                one("world.toml", &self.world),
                &[
                    "world check world.toml",
                    "world show world.toml --json",
                    "camera list world.toml",
                    "camera preview world.toml --size 48x32 --out views",
                ],
            ),
            "cameras" => {
                let scenario: Value = serde_json::from_slice(&self.scenario).unwrap_or_default();
                let mut files = one("cameras.json", scenario["world"]["cameras"].to_string().as_bytes());
                files.push(("scenario.json".into(), Content::Bytes(self.scenario.clone())));
                (files, &["evaluate scenario.json --policy do_nothing:seconds=0.1 --cameras cameras.json"])
            }
            "episodes" | "evaluations" => (
                self.run.iter().map(|(name, bytes)| (name.clone(), Content::Bytes(bytes.clone()))).collect(),
                match kind {
                    "episodes" => &[
                        "replay --check run",
                        "replay --check run/episodes/021_spatial-000",
                        "evaluate run --policy do_nothing:seconds=0.1",
                        "report run",
                    ],
                    _ => &["evaluate run --policy do_nothing:seconds=0.1 --keep-episodes", "report run"],
                },
            ),
            "problems" => {
                (one("problems.json", &self.problems), &["lab motion --problems problems.json --count 10 --ik-poses 1"])
            }
            "robots" => {
                let mut robot = robot();
                if !rng.random_bool(0.5) {
                    robot.pop();
                }
                let file = |(name, bytes): (String, Vec<u8>)| (format!("six/{name}"), Content::Bytes(bytes));
                let mut files: Vec<_> = robot.into_iter().map(file).collect();
                files.push(("none.json".into(), Content::Bytes(b"{\"problems\": []}".to_vec())));
                (
                    files,
                    &[
                        "lab motion --problems none.json --ik-poses 1 --robot six",
                        "lab motion --problems none.json --ik-poses 1 --robot six",
                        "lab motion --generate easy --count 1 --ik-poses 1 --robot six",
                    ],
                )
            }
            "cassettes" | "settings" => {
                let cassette =
                    |(name, bytes): &(String, Vec<u8>)| (format!("cassettes/{name}"), Content::Bytes(bytes.clone()));
                let mut files: Vec<_> = self.cassettes.iter().map(cassette).collect();
                files.push(("settings.toml".into(), Content::Bytes(SETTINGS.into())));
                (
                    files,
                    &[
                        "task new --designer llm --settings settings.toml --cassettes replay --kind spatial --count 1 --out out",
                    ],
                )
            }
            "grasps" => (one("grasps.json", &self.grasps), &["grasps show 001 --file grasps.json"]),
            kind if kind.starts_with(DATASET) => self.dataset(kind),
            other => {
                return Err(LabError::input(format!("there is no kind `{other}`"))
                    .with_hint(format!("kinds are {}", KINDS.join(", "))));
            }
        };
        let call: Vec<String> = calls[rng.random_range(0..calls.len())].split(' ').map(String::from).collect();
        // These calls may leave the finished part of their output behind when they are refused.
        let writes = ["evaluate", "report", "new", "preview", "card"];
        let only_reads = !call.iter().take(2).any(|word| writes.contains(&word.as_str()));
        let is_target = |name: &str| match kind {
            "episodes" => name.starts_with("run/episodes/") || name == "run/run.json",
            "evaluations" => {
                name.starts_with("run/evaluation/") || name == "run/timings.json" || name == "run/run.json"
            }
            "cameras" => name == "cameras.json",
            "cassettes" => name.starts_with("cassettes/"),
            "settings" => name == "settings.toml",
            "robots" => name.starts_with("six/"),
            kind if kind.starts_with(DATASET) => !name.starts_with("run/"),
            _ => true,
        };
        let targets = (0..files.len()).filter(|&index| is_target(&files[index].0)).collect();
        Ok(Case { kind: kind.into(), files, targets, call, only_reads })
    }

    /// Files at their size limit, with their contents.
    pub(super) fn fillings(&self) -> &[Filling] {
        &self.fillings
    }

    /// The unmodified run of two tasks.
    pub(super) fn run_of_two(&self) -> Result<Case, LabError> {
        self.case("episodes", &mut Seed::new(0).rng())
    }

    /// Valid inputs with one file replaced by a random one at its size limit.
    fn full(&self, rng: &mut impl Rng) -> Result<Case, LabError> {
        self.filled(&self.fillings[rng.random_range(0..self.fillings.len())])
    }

    /// Valid inputs with one file replaced by this one at its size limit.
    pub(super) fn filled(&self, filling: &Filling) -> Result<Case, LabError> {
        let kind = match filling.file.split_once('/') {
            Some(("run", _)) => "episodes",
            Some(_) => "robots",
            None if filling.file == "cameras.json" => "cameras",
            None => "settings",
        };
        let mut case = self.case(kind, &mut Seed::new(0).rng())?;
        case.files.retain(|(name, _)| *name != filling.file);
        case.files.push((filling.file.clone().into_owned(), Content::Bytes(filling.bytes())));
        if filling.file == "cases.npz" {
            case.files.push(("cases.json".into(), Content::Bytes(b"{}".to_vec())));
        }
        case.targets = vec![case.files.len() - 1];
        case.call = filling.call.split(' ').map(String::from).collect();
        case.kind = FULL.into();
        case.only_reads = false;
        Ok(case)
    }

    fn run_file(&self, name: &str) -> Option<Vec<u8>> {
        self.run.iter().find(|(known, _)| known == name).map(|(_, bytes)| bytes.clone())
    }
}

impl Case {
    /// Mutates one random target file in one place.
    pub(super) fn change(&mut self, rng: &mut impl Rng) {
        if self.kind == FULL {
            return;
        }
        let Some(&target) = self.targets.get(rng.random_range(0..self.targets.len().max(1))) else { return };
        let name = self.files[target].0.clone();
        let Content::Bytes(bytes) = &mut self.files[target].1 else { return };
        if rng.random_bool(0.06) {
            let others = [
                Content::LinkOutside,
                Content::LinkZero,
                Content::Pipe,
                Content::Folder,
                Content::Nothing,
                Content::Bytes(vec![]),
            ];
            self.files[target].1 = others[rng.random_range(0..others.len())].clone();
            return;
        }
        mutate::file(&name, bytes, rng);
        // In 60 % of the mutations, size and hash are updated, so that the mutation passes the integrity check.
        if self.kind == "episodes" && rng.random_bool(0.6) {
            self.hash_again(&name);
        }
    }

    /// Updates size and hash of a file in the record of its episode.
    fn hash_again(&mut self, name: &str) {
        let Some((folder, file)) = name.rsplit_once('/') else { return };
        let changed = self.files.iter().find(|(known, _)| known == name);
        let Some((_, Content::Bytes(bytes))) = changed.cloned() else { return };
        let record = format!("{folder}/episode.json");
        if let Some((_, Content::Bytes(text))) = self.files.iter_mut().find(|(known, _)| *known == record) {
            mutate::hash_again(text, file, &bytes);
        }
    }

    /// Names that count as a location in an error message.
    pub(super) fn places(&self) -> Vec<String> {
        let names = self.targets.iter().map(|&index| self.files[index].0.as_str());
        let mut places: Vec<String> = names.flat_map(|name| name.rsplit('/').next()).map(String::from).collect();
        places.extend(
            [
                "run/",
                "run holds",
                "run at run",
                "robot `",
                "six",
                "cassettes",
                "cases.npz",
                // Names of records within a file.
                "original/lmdb/",
                "021_spatial",
                "024_appearance",
                "'--",
            ]
            .map(String::from),
        );
        places
    }

    pub(super) fn describe(&self) -> String {
        format!("{}: genmanip {}", self.kind, self.call.join(" "))
    }
}

impl Content {
    /// Writes the content to a path; `outside` is the folder that calls must not change.
    pub(super) fn write(&self, path: &Path, outside: &Path) -> std::io::Result<()> {
        use std::os::unix::fs::symlink;
        match self {
            Self::Bytes(bytes) => fs::write(path, bytes),
            Self::LinkOutside => symlink(outside.join("canary"), path),
            Self::LinkZero => symlink("/dev/zero", path),
            Self::Pipe => std::process::Command::new("mkfifo").arg(path).status().map(drop),
            Self::Folder => fs::create_dir(path),
            Self::Nothing => Ok(()),
        }
    }
}

/// Files below a folder, sorted by name.
fn read_all(folder: &Path) -> Result<Vec<(String, Vec<u8>)>, LabError> {
    let files: Vec<_> = listing(folder).into_iter().filter(|(name, _)| !name.ends_with('/')).collect();
    if files.is_empty() {
        return Err(LabError::input(format!("there is nothing in {}", folder.display()))
            .with_hint("run in the project's folder, or name it with --project"));
    }
    Ok(files)
}

/// Cases of the kept corpus. Each has a folder with its files and `call.txt`: the kind, then the words of the call, one
/// per line.
fn kept(folder: &Path) -> Result<Vec<Case>, LabError> {
    let mut cases = Vec::new();
    let mut names: Vec<_> = fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path()).collect();
    names.sort();
    for path in names.into_iter().filter(|path| path.is_dir()) {
        let mut files = listing(&path);
        let call = files.remove("call.txt").unwrap_or_default();
        let call = String::from_utf8_lossy(&call).into_owned();
        let Some((kind, words)) = call.trim().split_once(": genmanip ") else {
            return Err(LabError::input(format!("{} has no call.txt", path.display()))
                .with_hint("expected `KIND: genmanip VERB ARGUMENTS`"));
        };
        let files: Vec<_> = files
            .into_iter()
            .filter(|(name, _)| !name.ends_with('/'))
            .map(|(name, bytes)| (name, Content::Bytes(bytes)))
            .collect();
        let targets = (0..files.len()).collect();
        let call = words.split(' ').map(String::from).collect();
        cases.push(Case { kind: kind.into(), files, targets, call, only_reads: false });
    }
    Ok(cases)
}

/// Task document of the first task in the record of a run.
fn task_of(run: &[u8]) -> Option<Vec<u8>> {
    let run: Value = serde_json::from_slice(run).ok()?;
    let mut task = run.get("tasks")?.get(0)?.clone();
    task.as_object_mut()?.shift_insert(0, "schema".into(), "genmanip.task/2".into());
    Some(task.to_string().into_bytes())
}

/// Files of a small valid robot named `six`; the last one, the SRDF, is optional.
pub fn robot() -> Vec<(String, Vec<u8>)> {
    let file = |name: &str, bytes: &[u8]| (name.to_owned(), bytes.to_vec());
    vec![
        file("six.urdf", ARM.as_bytes()),
        file("fore.obj", BRICK.as_bytes()),
        file("tip.stl", &stl()),
        file("six.srdf", RULES.as_bytes()),
    ]
}

/// Tetrahedron as a binary STL file.
fn stl() -> Vec<u8> {
    let corners = [[0.0_f32; 3], [0.05, 0.0, 0.0], [0.0, 0.05, 0.0], [0.0, 0.0, 0.05]];
    let mut bytes = vec![0; 80];
    bytes.extend(4_u32.to_le_bytes());
    for face in [[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]] {
        bytes.extend([0; 12]);
        bytes.extend(face.iter().flat_map(|&corner: &usize| corners[corner]).flat_map(f32::to_le_bytes));
        bytes.extend([0; 2]);
    }
    bytes
}
