//! Freezing of the layouts of a suite of task distributions: their hashes are stored.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use genmanip_assets::worlds::default_world;
use genmanip_motion::PlannerSettings;
use genmanip_rollout::collect::{Resources, in_parallel};
use genmanip_workspace::{Progress, WorkspaceError, documents, worlds};

use super::draw::{Place, draw};
use super::format::{Distribution, Split};
use super::frozen::{FrozenLayout, FrozenLayouts, layout_hash, to_text};
use super::suite::{Distributions, layouts_file};

/// Maximum number of attempts at a layout, each with a newly drawn task; freezing fails if all fail. Chosen by hand: a
/// distribution that fails this often is too hard to lay out for training.
const MAX_ATTEMPTS: u64 = 20;

/// Lays out every task of a suite and writes the hashes of the layouts, one file per distribution.
///
/// Distributions that already have a file are skipped, so an interrupted call can be repeated. Returns `None` if
/// interrupted; the distribution in progress then has no file.
///
/// # Errors
/// If all distributions are frozen already, a layout cannot be made, or a file cannot be written.
pub fn freeze(
    folder: &Path,
    workers: usize,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<Option<()>, WorkspaceError> {
    let suite = Distributions::open(folder)?;
    let is_left = |one: &&Distribution| !layouts_file(folder, &one.name).is_file();
    let left: Vec<&Distribution> = suite.file.distributions.iter().filter(is_left).collect();
    if left.is_empty() {
        return Err(WorkspaceError::input(format!("{} is frozen already", folder.display()))
            .with_hint("`genmanip suite check` says whether it still is what it was; remove layouts/ to freeze anew"));
    }
    let world = suite.judged_in(&default_world());
    let planner = worlds::planner(&world, &PlannerSettings::default())?;
    let resources = Resources::builtin(&planner);
    for distribution in left {
        let places = |split: Split| (0..suite.file.size(split)).map(move |number| (split, number));
        let jobs: Vec<(Split, u64)> = Split::ALL.into_iter().flat_map(places).collect();
        progress.begin(&distribution.name, jobs.len());
        let one = |&(split, number): &(Split, u64)| {
            let mut refusal = None;
            for attempt in 1..=MAX_ATTEMPTS {
                let task = draw(&suite.file, distribution, Place { split, number, attempt });
                match suite.lay_out(&task, resources, &world) {
                    Ok(scenario) => {
                        progress.advance();
                        return Ok((split, FrozenLayout { hash: layout_hash(&scenario), attempt }));
                    }
                    Err(error) if error.is_defect() => {
                        return Err(WorkspaceError::broken(format!("laying out {} stopped", task.id), error));
                    }
                    Err(error) => refusal = Some((task.id, error)),
                }
            }
            let (task, error) = refusal.unzip();
            let what = format!("no layout of {} in {MAX_ATTEMPTS} attempts", task.unwrap_or_default());
            let refused = WorkspaceError::input(what);
            Err(match error {
                Some(error) => refused.because(error),
                None => refused,
            })
        };
        let made = in_parallel(&jobs, workers, stop, &one)?;
        progress.end();
        if stop.load(Ordering::Relaxed) {
            return Ok(None);
        }
        let mut layouts = FrozenLayouts::new();
        for (split, layout) in made {
            layouts.entry(split).or_default().push(layout);
        }
        let replaced = layouts.values().flatten().filter(|layout| layout.attempt > 1).count();
        progress.note(&format!("{}: {replaced} of {} layouts took several attempts", distribution.name, jobs.len()));
        let text = to_text(&layouts, &genmanip_sim::engine_version());
        documents::write_file(&layouts_file(folder, &distribution.name), text.as_bytes())?;
    }
    Ok(Some(()))
}
