//! The studio: random edits of two authors on fresh layouts, verdicts against the audit, planted faults and repairs.

mod edits;
mod faults;
mod measured;

use std::sync::Arc;

use genmanip_assets::{Catalogue, GraspLibrary};
use genmanip_core::{Scenario, Seed, TaskKind, World};
use genmanip_layout::{LayoutSettings, lay_out};
use genmanip_studio::verdict::{Equipment, Inspection, Problem};
use genmanip_tasks::designer::{DesignSettings, Series};
use genmanip_workspace::Progress;

use crate::LabError;
use faults::{Fault, Planted};
pub use measured::Measured;

/// Amounts of a measurement.
#[derive(Clone, Copy, Debug)]
pub struct StudioArguments {
    /// Random operations.
    pub operations: usize,
    /// Planted faults.
    pub faults: usize,
    /// Sound scenarios.
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
    planted(&scenarios, arguments.faults, &equipment, seed.fork("faults"), progress, &mut measured)?;
    Ok(measured)
}

/// Laid out tasks of all kinds.
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
                scenarios.push(Arc::new(scenario));
                progress.advance();
            }
            Err(error) if error.is_defect() => return Err(LabError::broken("laying out stopped", error)),
            Err(_) => {}
        }
    }
    progress.end();
    Ok(scenarios)
}

/// The blocking problems of a scenario.
fn blocking(scenario: &Arc<Scenario>, equipment: &Equipment) -> Result<Vec<Problem>, LabError> {
    let verdict = Inspection::new(Arc::clone(scenario), equipment).verdict(0);
    let verdict = verdict.map_err(|error| LabError::broken(format!("cannot judge {}", scenario.id), error))?;
    Ok(verdict.blocking().cloned().collect())
}

/// Plants faults of all kinds in turn, looks for each, and repairs it.
fn planted(
    scenarios: &[Arc<Scenario>],
    count: usize,
    equipment: &Equipment,
    seed: Seed,
    progress: &dyn Progress,
    measured: &mut Measured,
) -> Result<(), LabError> {
    measured.by_fault = Fault::ALL.map(|fault| (fault.name(), [0; 3])).to_vec();
    progress.begin("planting faults", count);
    let mut tries = (0..).map(|number: u64| seed.fork_index(number));
    for number in 0..count {
        let kind = number % Fault::ALL.len();
        let fault = Fault::ALL[kind];
        // Not every scene has room for every fault.
        let room = tries.by_ref().take(4 * scenarios.len()).enumerate();
        let plant = |(skip, seed): (usize, Seed)| {
            fault.plant(&scenarios[(number / Fault::ALL.len() + skip) % scenarios.len()], equipment, seed)
        };
        let Some(Planted { scenario, objects }) = room.into_iter().find_map(plant) else {
            measured.notes.push(format!("no scene for a fault `{}`", fault.name()));
            continue;
        };
        let mut inspection = Inspection::new(Arc::clone(&scenario), equipment);
        let broken = |error| LabError::broken(format!("cannot judge {}", scenario.id), error);
        let problems = inspection.verdict(0).map_err(broken)?.problems;
        let names_it = |id: &Option<String>| id.as_ref().is_some_and(|id| objects.contains(id));
        let right = |problem: &&Problem| {
            fault.codes().contains(&problem.code) && (names_it(&problem.object) || names_it(&problem.other))
        };
        let tally = &mut measured.by_fault[kind].1;
        tally[0] += 1;
        measured.planted += 1;
        let hits: Vec<&Problem> = problems.iter().filter(right).collect();
        if hits.is_empty() {
            let found: Vec<&str> = problems.iter().map(|problem| problem.code.name()).collect();
            measured.notes.push(format!("missed {} of {objects:?} in {}: {found:?}", fault.name(), scenario.id));
        } else {
            tally[1] += 1;
            measured.found += 1;
        }
        let mut is_repaired = false;
        for problem in hits {
            for repair in inspection.repairs(problem).map_err(broken)? {
                let Ok(change) = repair.operation.apply(&scenario, equipment.assets) else { continue };
                is_repaired |= blocking(&Arc::new(change.scenario), equipment)?.is_empty();
            }
            if is_repaired {
                break;
            }
        }
        if is_repaired {
            measured.by_fault[kind].1[2] += 1;
            measured.repaired += 1;
        } else {
            measured.notes.push(format!("not repaired: {} in {}", fault.name(), scenario.id));
        }
        progress.advance();
    }
    progress.end();
    Ok(())
}

/// Text summary.
pub fn describe(measured: &Measured) -> String {
    let mut text = format!(
        "operations    {} ({} applied, {} conflicts)\nverdict       {:.1} ms median, {:.1} ms p95; all stages {:.1} ms p95\n\
         lost          {}\nequal bytes   {}\nmismatches    {}\nfaults        {} planted, {} found, {} repaired\n\
         false alarms  {} of {}\n",
        measured.operations,
        measured.applied,
        measured.conflicts,
        measured.verdict_ms_p50,
        measured.verdict_ms_p95,
        measured.all_checks_ms_p95,
        measured.lost,
        measured.equal_bytes,
        measured.verdict_mismatches,
        measured.planted,
        measured.found,
        measured.repaired,
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
