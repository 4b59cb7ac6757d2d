//! Planted faults: how many are found, repaired, and then solved by the expert.

use std::sync::Arc;

use genmanip_core::{InstanceId, ReferenceId, Scenario, Seed};
use genmanip_studio::faults::{Fault, Planted};
use genmanip_studio::verdict::{Equipment, Inspection, Problem, RepairedScenario, repair_all};
use genmanip_workspace::Progress;

use super::judged::{blocking, is_solved};
use super::measured::Measured;
use crate::LabError;
use crate::clock::cpu_clock;
use crate::quantile::Spread;

/// Plants faults of all kinds in turn, each kind in the scenarios in turn; judges and repairs each.
pub(super) fn measure(
    scenarios: &[Arc<Scenario>],
    count: usize,
    equipment: &Equipment,
    seed: Seed,
    progress: &dyn Progress,
    measured: &mut Measured,
) -> Result<(), LabError> {
    measured.by_fault = Fault::ALL.map(|fault| (fault.name(), [0; 3])).to_vec();
    let mut repair_s = Vec::new();
    // Number of scenarios used so far, for each kind of fault.
    let mut next = Fault::ALL.map(|_| 0);
    progress.begin("planting faults", count);
    for number in 0..count {
        let kind = number % Fault::ALL.len();
        let fault = Fault::ALL[kind];
        // Scenarios are tried in turn, since not every scene has room for every fault.
        let planted = (0..scenarios.len()).find_map(|_| {
            let turn = next[kind];
            next[kind] += 1;
            let seed = seed.fork(fault.name()).fork_index(turn as u64);
            fault.plant(&scenarios[turn % scenarios.len()], equipment, seed)
        });
        let Some(planted) = planted else {
            measured.notes.push(format!("no scene for a fault `{}`", fault.name()));
            continue;
        };
        let Planted { scenario, objects, .. } = &planted;
        let broken = |error| LabError::broken(format!("cannot judge {}", scenario.id), error);
        let problems = Inspection::new(Arc::clone(scenario), equipment).verdict(0).map_err(broken)?.problems;
        let tally = &mut measured.by_fault[kind].1;
        tally[0] += 1;
        measured.planted += 1;
        if problems.iter().any(|problem| is_told_by(&planted, fault, problem)) {
            tally[1] += 1;
            measured.found += 1;
        } else {
            let messages: Vec<&str> = problems.iter().map(|problem| problem.message.as_str()).collect();
            let note = format!("missed {} of {objects:?} in {}: {messages:?}", fault.name(), scenario.id);
            measured.notes.push(note);
        }
        let mut clock = cpu_clock();
        let RepairedScenario { scenario: mended, repairs, left } =
            repair_all(Arc::clone(scenario), equipment).map_err(broken)?;
        repair_s.push(clock());
        let labels: Vec<&str> = repairs.iter().map(|repair| repair.label.as_str()).collect();
        if !left.is_empty() || !blocking(&mended, equipment)?.is_empty() {
            let left: Vec<&str> = left.iter().map(|problem| problem.message.as_str()).collect();
            let note =
                format!("not repaired: {} of {objects:?} in {} after {labels:?}: {left:?}", fault.name(), scenario.id);
            measured.notes.push(note);
        } else if !repairs.is_empty() {
            measured.by_fault[kind].1[2] += 1;
            measured.repaired += 1;
            measured.repaired_tried += 1;
            if is_solved(&mended, equipment, seed.fork("expert").fork_index(number as u64))? {
                measured.repaired_solved += 1;
            } else {
                measured.notes.push(format!("not solved: {} in {} after {labels:?}", fault.name(), scenario.id));
            }
        }
        progress.advance();
    }
    progress.end();
    measured.repair_s = Spread::of(repair_s);
    Ok(())
}

/// True if a problem reports the fault and names the right objects.
fn is_told_by(planted: &Planted, fault: Fault, problem: &Problem) -> bool {
    let is_one = |id: &Option<ReferenceId>| id.as_ref().is_some_and(|id| planted.objects.iter().any(|one| one == id));
    let names_neighbour = |neighbour: &InstanceId| problem.other.as_ref().is_some_and(|other| other == neighbour);
    fault.codes().contains(&problem.code)
        && (is_one(&problem.object) || is_one(&problem.other))
        && planted.neighbour.as_ref().is_none_or(names_neighbour)
}
