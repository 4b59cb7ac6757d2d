//! The studio: random edits by two authors on new layouts, verdicts compared with the audit, planted faults and
//! repairs.

mod edits;
mod judged;
mod measured;
mod repairs;

use std::sync::Arc;

use genmanip_assets::{Catalogue, GraspLibrary};
use genmanip_core::{Scenario, Seed, TaskKind, World};
use genmanip_layout::{LayoutSettings, lay_out};
use genmanip_studio::verdict::Equipment;
use genmanip_tasks::designer::{DesignSettings, Series};
use genmanip_workspace::Progress;

use crate::LabError;
use judged::{blocking, is_solved};
pub use measured::Measured;

/// Numbers of operations, faults and scenarios of the measurement.
#[derive(Clone, Copy, Debug)]
pub struct StudioArguments {
    /// Number of random operations.
    pub operations: usize,
    /// Number of faults to plant.
    pub faults: usize,
    /// Number of sound scenarios to judge.
    pub sound: usize,
}

/// Measures the studio; one thread.
///
/// # Errors
/// If a layout or a verdict cannot be made, or a file cannot be written.
pub fn measure(
    arguments: StudioArguments,
    world: &World,
    seed: Seed,
    progress: &dyn Progress,
) -> Result<Measured, LabError> {
    let equipment = Equipment::of_world(world)?;
    let mut measured = Measured { seed: seed.value(), equal_bytes: true, ..Measured::default() };
    let scenarios = fresh(arguments.sound.max(1), world, &equipment, seed, progress)?;
    progress.begin("judging sound scenarios", scenarios.len());
    for scenario in scenarios.iter().take(arguments.sound) {
        let problems = blocking(scenario, &equipment)?;
        measured.sound += 1;
        if let Some(problem) = problems.first() {
            measured.false_alarms += 1;
            measured.notes.push(format!(
                "false alarm in {}: {}: {}",
                scenario.id,
                problem.code.name(),
                problem.message
            ));
        }
        progress.advance();
    }
    progress.end();
    edits::measure(&scenarios, arguments.operations, &equipment, seed.fork("edits"), progress, &mut measured)?;
    repairs::measure(&scenarios, arguments.faults, &equipment, seed.fork("faults"), progress, &mut measured)?;
    Ok(measured)
}

/// Layouts of designed tasks of all kinds that the expert solves.
fn fresh(
    count: usize,
    world: &World,
    equipment: &Equipment,
    seed: Seed,
    progress: &dyn Progress,
) -> Result<Vec<Arc<Scenario>>, LabError> {
    let (catalogue, settings) = (Catalogue::full(), DesignSettings::default());
    let broken = |what: &str, error: &dyn std::fmt::Display| LabError::broken(what, error.to_string());
    let series = Series::new(&TaskKind::ALL, catalogue.cards(), seed.fork("tasks"), &settings, false);
    let mut series = series.map_err(|error| broken("the designer gave up", &error))?;
    let mut scenarios = Vec::new();
    progress.begin("laying out", count);
    for number in 0.. {
        if scenarios.len() == count {
            break;
        }
        let task = series.compose().map_err(|missing| broken("the designer gave up", &missing.why))?;
        let layout_seed = seed.fork("layouts").fork_index(number);
        let (planner, grasps) = (&equipment.planner, GraspLibrary::builtin());
        match lay_out(&task, catalogue, world, planner, grasps, layout_seed, &LayoutSettings::default()) {
            Ok(scenario) => {
                let scenario = Arc::new(scenario);
                if is_solved(&scenario, equipment, layout_seed.fork("expert"))? {
                    scenarios.push(scenario);
                    progress.advance();
                }
            }
            Err(error) if error.is_defect() => return Err(LabError::broken("laying out stopped", error)),
            Err(_) => {}
        }
    }
    progress.end();
    Ok(scenarios)
}

/// Text summary.
pub fn describe(measured: &Measured) -> String {
    let mut text = format!(
        "operations    {} ({} applied, {} conflicts)\nverdict       {:.1} ms median, {:.1} ms p95; all stages {:.1} ms p95\n\
         operation     {:.2} s in the first half, {:.2} s in the second, with image and comparison\n\
         lost          {}\nequal bytes   {}\nmismatches    {}\nfaults        {} planted, {} found, {} repaired; the expert solves {} of {}\n\
         false alarms  {} of {}\n",
        measured.operations,
        measured.applied,
        measured.conflicts,
        measured.verdict_ms_p50,
        measured.verdict_ms_p95,
        measured.all_checks_ms_p95,
        measured.operation_s[0],
        measured.operation_s[1],
        measured.lost,
        measured.equal_bytes,
        measured.verdict_mismatches,
        measured.planted,
        measured.found,
        measured.repaired,
        measured.repaired_solved,
        measured.repaired_tried,
        measured.false_alarms,
        measured.sound,
    );
    for (name, [planted, found, repaired]) in &measured.by_fault {
        text += &format!("  {name:20} {planted} planted, {found} found, {repaired} repaired\n");
    }
    for (stage, ms) in &measured.stage_ms {
        text += &format!("  {stage:20} {ms:.1} ms on average\n");
    }
    for note in &measured.notes {
        text += &format!("  {note}\n");
    }
    text
}
