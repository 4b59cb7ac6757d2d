//! Fresh tasks and layouts for measurements of policies.

use genmanip_assets::Catalogue;
use genmanip_core::{Scenario, Seed, Task, TaskKind};
use genmanip_rollout::collect::{Attempt, PipelineSettings, Resources};
use genmanip_tasks::designer::{DesignSettings, design_many};

use crate::LabError;

/// Layouts tried per task; a task without a layout gives no episode.
const LAYOUTS: u64 = 5;

/// Fresh tasks of these kinds in turn, with objects of the built-in catalogue.
pub(crate) fn tasks(kinds: &[TaskKind], count: usize, seed: Seed) -> Result<Vec<Task>, LabError> {
    let batch = design_many(kinds, count, Catalogue::builtin().cards(), seed, &DesignSettings::default());
    Ok(batch.map_err(|error| LabError::broken("the designer gave up", error))?.tasks)
}

/// The first attempt at a task with a layout, with its scenario; `None` if there is none.
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
