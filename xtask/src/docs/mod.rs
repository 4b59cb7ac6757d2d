//! Runs the shell and Python blocks of README.md and the guides, so that no page shows commands that fail.

mod marks;
pub mod plan;
mod runner;

use crate::problem::{OnPath, Problem, Result};
use crate::process::Workspace;
use plan::{Language, Plan, When};
use runner::Runner;
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs;
use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

/// Folders and files of the repository that blocks see in their folder.
const LINKED: [&str; 4] = ["examples", "suites", "schemas", "docs"];
/// World that blocks see in their folder, for `docs: replace`: the default one whose dataset cameras have small images.
/// Layouts are judged in the other cameras.
const SMALL_IMAGES: &str = "small.toml";
/// Pages that run at the same time; chosen: a page has phases on one core.
const AT_ONCE: usize = 2;

/// True for a page whose blocks run.
pub fn is_page(path: &str) -> bool {
    path == "README.md" || (path.starts_with("docs/guides/") && path.ends_with(".md"))
}

/// Choice of blocks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Blocks {
    /// All that need neither network nor other projects' packages.
    Usual,
    /// Those marked `interop`, on pages that have some, with the usual ones before them.
    Interop,
}

/// Result of one page.
#[derive(Debug, Default)]
struct Outcome {
    run: usize,
    skipped: usize,
    time: Duration,
    problem: Option<Problem>,
}

/// Runs pages, all when none is named; gives a sentence on what was run.
pub fn run(workspace: &Workspace, chosen: &[String], blocks: Blocks) -> Result<String> {
    let plans = plans(workspace)?;
    if let Some(wrong) = chosen.iter().find(|page| !plans.contains_key(*page)) {
        return Err(Problem {
            what: format!("not a page whose blocks run: {wrong}"),
            expected: "README.md or docs/guides/*.md".into(),
            hint: format!("pages are {}", plans.keys().cloned().collect::<Vec<_>>().join(", ")),
        });
    }
    let has_interop = |plan: &Plan| plan.steps.iter().any(|step| step.when == When::Interop);
    let is_chosen = |(page, plan): &(&String, &Plan)| {
        (chosen.is_empty() || chosen.contains(page)) && (blocks == Blocks::Usual || has_interop(plan))
    };
    let pages: Vec<&String> = plans.iter().filter(is_chosen).map(|(page, _)| page).collect();
    let place = Place::find(workspace)?;
    let (next, done) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
    std::thread::scope(|scope| {
        for _ in 0..AT_ONCE.min(pages.len()) {
            scope.spawn(|| {
                while let Some(page) = pages.get(next.fetch_add(1, Ordering::Relaxed)) {
                    let outcome = place.page(page, &plans, blocks);
                    report(page, plans[*page].off.as_deref(), &outcome);
                    done.lock().unwrap_or_else(std::sync::PoisonError::into_inner).push(outcome);
                }
            });
        }
    });
    let done = done.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
    let sum = |count: fn(&Outcome) -> usize| done.iter().map(count).sum::<usize>();
    let mut said =
        format!("{} pages, {} blocks run, {} skipped", done.len(), sum(|one| one.run), sum(|one| one.skipped));
    if place.python.is_none() {
        said += ", Python blocks too: `cargo xtask test python` installs the package for them";
    }
    let mut problems: Vec<Problem> = done.into_iter().filter_map(|outcome| outcome.problem).collect();
    match problems.len() {
        0 => Ok(said),
        1 => Err(problems.remove(0)),
        count => Err(Problem {
            what: problems.iter().map(|one| format!("{}\n  ({})", one.what, one.hint)).collect::<Vec<_>>().join("\n"),
            expected: "blocks that run as they are shown".into(),
            hint: format!("{count} pages fail; `cargo xtask docs PAGE` runs one"),
        }),
    }
}

fn report(page: &str, off: Option<&str>, outcome: &Outcome) {
    let said = match (off, &outcome.problem) {
        (Some(reason), _) => format!("off: {reason}"),
        (None, Some(_)) => "FAILED".into(),
        (None, None) => format!("{} blocks run, {} skipped", outcome.run, outcome.skipped),
    };
    println!("{page:<48} {:>6.1} s  {said}", outcome.time.as_secs_f64());
}

/// Plans of all pages by path.
fn plans(workspace: &Workspace) -> Result<BTreeMap<String, Plan>> {
    let mut paths = vec!["README.md".to_owned()];
    let guides = workspace.root.join("docs/guides");
    for entry in fs::read_dir(&guides).on("read", &guides)? {
        paths.push(format!("docs/guides/{}", entry.on("read", &guides)?.file_name().to_string_lossy()));
    }
    let mut plans = BTreeMap::new();
    for path in paths.into_iter().filter(|path| is_page(path)) {
        let file = workspace.root.join(&path);
        let plan = plan::read(&path, &fs::read_to_string(&file).on("read", &file)?)?;
        plans.insert(path, plan);
    }
    for (path, plan) in &plans {
        if let Some(wrong) = plan.needs.iter().find(|page| !plans.contains_key(*page)) {
            return Err(Problem {
                what: format!("{path} needs {wrong}, which is no page whose blocks run"),
                expected: "README.md or docs/guides/*.md".into(),
                hint: "name it from the root of the repository".into(),
            });
        }
    }
    Ok(plans)
}

/// Folders and programs for the blocks.
struct Place {
    root: PathBuf,
    /// `docs` in the target folder; one folder per page below it.
    scratch: PathBuf,
    path: OsString,
    python: Option<PathBuf>,
}

impl Place {
    fn find(workspace: &Workspace) -> Result<Self> {
        let target = workspace.target_dir()?;
        let program = workspace.genmanip()?;
        if !program.exists() {
            return Err(Problem {
                what: format!("the program is not built: {}", program.display()),
                expected: "a release build".into(),
                hint: "run `cargo build --release`".into(),
            });
        }
        // The environment in which the phase `python` has installed and tested the wheel.
        let wheel = target.join("wheel/python/bin/python");
        let has_package = |python: &PathBuf| {
            let mut import = workspace.command(python);
            crate::process::output(import.args(["-c", "import genmanip"])).is_ok()
        };
        let python = Some(wheel).filter(has_package);
        let folders = [Some(target.join("release")), python.as_ref().and_then(|path| Some(path.parent()?.to_owned()))];
        let usual = std::env::var_os("PATH").unwrap_or_default();
        let path = std::env::join_paths(folders.into_iter().flatten().chain(std::env::split_paths(&usual)));
        let path = path.map_err(|error| Problem {
            what: format!("cannot put the built programs on the PATH: {error}"),
            expected: "a target folder without `:`".into(),
            hint: "CARGO_TARGET_DIR chooses another".into(),
        })?;
        Ok(Self { root: workspace.root.clone(), scratch: target.join("docs"), path, python })
    }

    fn page(&self, page: &str, plans: &BTreeMap<String, Plan>, blocks: Blocks) -> Outcome {
        let begun = Instant::now();
        let mut outcome = Outcome::default();
        if plans[page].off.is_none() {
            outcome.problem = self.run_page(page, plans, blocks, &mut outcome).err();
        }
        outcome.time = begun.elapsed();
        outcome
    }

    fn run_page(&self, page: &str, plans: &BTreeMap<String, Plan>, blocks: Blocks, outcome: &mut Outcome) -> Result {
        let place = self.scratch.join(page.trim_end_matches(".md").replace('/', "-"));
        if place.exists() {
            fs::remove_dir_all(&place).on("remove", &place)?;
        }
        let (folder, logs) = (place.join("page"), place.join("logs"));
        fs::create_dir_all(&folder).on("make the folder", &folder)?;
        fs::create_dir_all(&logs).on("make the folder", &logs)?;
        for name in LINKED {
            let link = folder.join(name);
            std::os::unix::fs::symlink(self.root.join(name), &link).on("link", &link)?;
        }
        let world = self.root.join("crates/assets/data/world.toml");
        let small = small_images(&fs::read_to_string(&world).on("read", &world)?);
        fs::write(folder.join(SMALL_IMAGES), small).on("write", &folder)?;
        let mut order: Vec<&str> = Vec::new();
        add_with_needs(page, plans, &mut Vec::new(), &mut order);
        for one in order {
            let (folder, logs) = (folder.clone(), logs.clone());
            let mut runner = Runner::new(one, folder, logs, self.path.clone(), self.python.clone());
            for step in &plans[one].steps {
                let is_run = match step.when {
                    When::Always => true,
                    When::Interop => blocks == Blocks::Interop,
                    When::Never(_) => false,
                };
                if is_run && (step.language == Language::Shell || self.python.is_some()) {
                    runner.run(step)?;
                    outcome.run += 1;
                } else {
                    outcome.skipped += 1;
                }
            }
            runner.finish()?;
        }
        // Kept after a failure, to be looked into.
        fs::remove_dir_all(&place).on("remove", &place)
    }
}

/// [`SMALL_IMAGES`] from the default world.
fn small_images(world: &str) -> String {
    let (others, cameras) = world.split_at(world.find("name = \"static\"").unwrap_or(world.len()));
    format!("{others}{}", cameras.replace("[512, 288]", "[128, 72]"))
}

/// Adds a page behind the pages that it needs, each once.
fn add_with_needs<'a>(
    page: &'a str,
    plans: &'a BTreeMap<String, Plan>,
    open: &mut Vec<&'a str>,
    order: &mut Vec<&'a str>,
) {
    if open.contains(&page) {
        return;
    }
    open.push(page);
    for needed in &plans[page].needs {
        add_with_needs(needed, plans, open, order);
    }
    order.push(page);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn needed_pages_come_first_and_once() {
        let plan = |needs: &[&str]| Plan { needs: needs.iter().map(ToString::to_string).collect(), ..Plan::default() };
        let plans: BTreeMap<String, Plan> =
            [("a", plan(&["b", "c"])), ("b", plan(&["c"])), ("c", plan(&["a"]))].map(|(k, v)| (k.to_owned(), v)).into();
        let mut order = Vec::new();
        add_with_needs("a", &plans, &mut Vec::new(), &mut order);
        assert_eq!(order, ["c", "b", "a"]);
    }

    #[test]
    fn the_cameras_of_datasets_have_small_images() {
        let world = include_str!("../../../crates/assets/data/world.toml");
        let sizes = |world: &str, size| world.matches(size).count();
        assert_eq!((sizes(world, "[512, 288]"), sizes(&small_images(world), "[512, 288]")), (5, 3));
        assert_eq!(sizes(&small_images(world), "[128, 72]"), 2);
    }

    #[test]
    fn pages_are_readme_and_guides() {
        assert!(is_page("README.md") && is_page("docs/guides/x.md"));
        assert!(!is_page("docs/README.md") && !is_page("docs/concepts/x.md"));
    }
}
