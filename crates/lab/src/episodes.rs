//! Fresh tasks and layouts for measurements of policies.

use genmanip_assets::Catalogue;
use genmanip_core::{Atom, Relation, Scenario, Seed, Task, TaskKind};
use genmanip_rollout::collect::{Attempt, PipelineSettings, Resources};
use genmanip_tasks::designer::{DesignSettings, Series, design_many};

use crate::LabError;

/// Layouts tried per task; a task without a layout gives no episode.
const LAYOUTS: u64 = 5;
/// Maximum number of tasks composed per wanted task about a given relation.
const MAX_SHARE: usize = 200;

/// New designed tasks, the kinds in turn, with objects of the built-in catalogue.
pub(crate) fn tasks(kinds: &[TaskKind], count: usize, seed: Seed) -> Result<Vec<Task>, LabError> {
    let batch = design_many(kinds, count, Catalogue::builtin().cards(), seed, &DesignSettings::default());
    Ok(batch.map_err(|error| LabError::broken("the designer gave up", error))?.tasks)
}

/// The first `count` tasks of the same series as [`tasks`] whose goal has a condition of this relation.
pub(crate) fn tasks_about(
    relation: Relation,
    kinds: &[TaskKind],
    count: usize,
    seed: Seed,
) -> Result<Vec<Task>, LabError> {
    let settings = DesignSettings::default();
    let series = Series::new(kinds, Catalogue::builtin().cards(), seed, &settings, false);
    let mut series = series.map_err(|error| LabError::broken("the designer gave up", error))?;
    let mut about = Vec::new();
    for _ in 0..count.saturating_mul(MAX_SHARE) {
        if about.len() == count {
            break;
        }
        let task = series.compose().map_err(|missing| LabError::broken("the designer gave up", missing.why))?;
        about.extend(goal_relations(&task).contains(&relation).then_some(task));
    }
    if about.len() < count {
        let composed = count.saturating_mul(MAX_SHARE);
        let found = format!("{} of {composed} designed tasks are about `{}`", about.len(), relation.name());
        return Err(LabError::input(found).with_hint("ask for fewer with --count, or for other kinds with --kinds"));
    }
    Ok(about)
}

/// Relations of the conditions in all alternatives of a goal, without duplicates.
pub(crate) fn goal_relations(task: &Task) -> Vec<Relation> {
    let is_asked = |relation: &Relation| {
        let mut atoms = task.goal.alternatives.iter().flatten();
        atoms.any(|atom| matches!(atom, Atom::Relation { relation: asked, .. } if asked == relation))
    };
    Relation::ALL.into_iter().filter(is_asked).collect()
}

/// First of up to [`LAYOUTS`] attempts at a task that has a layout, with its scenario; `None` if none has.
pub(crate) fn laid_out<'a>(
    task: &'a Task,
    resources: Resources,
    settings: &PipelineSettings,
    stream: Seed,
) -> Result<Option<(Attempt<'a>, Scenario)>, LabError> {
    for number in 0..LAYOUTS {
        let attempt = Attempt { task, number, seed: stream.fork_index(number) };
        match attempt.scenario(resources, &settings.world, &settings.layout) {
            Ok(scenario) => return Ok(Some((attempt, scenario))),
            Err(error) if error.is_defect() => return Err(LabError::broken("the layout broke", error)),
            Err(_) => {}
        }
    }
    Ok(None)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tasks_about_a_relation_are_those_of_the_series() {
        let (kinds, seed) = ([TaskKind::PickAndPlace, TaskKind::Spatial], Seed::new(5));
        let about = tasks_about(Relation::Between, &kinds, 2, seed).unwrap();
        assert!(about.iter().all(|task| goal_relations(task) == [Relation::Between]), "{about:?}");
        let all = tasks(&kinds, 200, seed).unwrap();
        let first = all.iter().filter(|task| goal_relations(task).contains(&Relation::Between));
        assert_eq!(
            about.iter().map(|task| &task.id).collect::<Vec<_>>(),
            first.map(|it| &it.id).take(2).collect::<Vec<_>>()
        );
        let none = tasks_about(Relation::Between, &[TaskKind::Articulated], 1, seed).unwrap_err().to_string();
        assert!(none.contains("0 of 200 designed tasks are about `between`"), "{none}");
    }
}
