//! Mismatches between sentence and goal, planted in designed tasks, and how many of them the answer check finds.

use genmanip_core::{Atom, InstanceId, ObjectCard, ReferenceId, Relation, Seed, Task, TaskKind};
use genmanip_tasks::answer::{AnswerReport, FlawKind, TaskRequest, Verdict, check_answer};
use genmanip_tasks::designer::{DesignSettings, as_answer, design_many};
use rand::seq::SliceRandom;
use serde::Serialize;

use crate::LabError;

/// Detected mismatches, and false rejections.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct WordingReport {
    /// Number of answers with a changed goal, which the sentence does not ask for.
    pub planted: usize,
    /// Number of these for which the answer check reported a mismatch of sentence and goal.
    pub named: usize,
    /// Number of unchanged answers.
    pub sound: usize,
    /// Number of unchanged answers that were rejected.
    pub refused: usize,
    /// Instruction and changed goal of each mismatch that was not found.
    pub missed: Vec<String>,
}

/// Designs `count` tasks, and changes one condition of each task's goal: its object, its reference, its relation or its
/// state.
///
/// # Errors
/// If the designer finds no further task within its limit of draws.
pub fn measure(cards: &[ObjectCard], count: usize, seed: Seed) -> Result<WordingReport, LabError> {
    let tasks = design_many(&TaskKind::ALL, count, cards, seed, &DesignSettings::default())
        .map_err(|error| LabError::broken("the designer gave up", error))?
        .tasks;
    let mut report = WordingReport::default();
    for (index, task) in tasks.iter().enumerate() {
        report.sound += 1;
        report.refused += usize::from(checked(task).verdict == Verdict::Rejected);
        let rng = &mut seed.fork("wording").fork_index(index as u64).rng();
        let mut changed = changes(task);
        changed.shuffle(rng);
        // A change that also breaks another rule of the format does not test the check of the sentence.
        let planted = changed
            .into_iter()
            .map(|task| (checked(&task), task))
            .find(|(report, _)| report.flaws.iter().all(|flaw| flaw.kind == FlawKind::SentenceMismatch));
        let Some((found, planted)) = planted else { continue };
        report.planted += 1;
        match found.flaws.is_empty() {
            false => report.named += 1,
            true => {
                let goal: Vec<String> = planted.goal.alternatives.iter().flatten().map(Atom::to_string).collect();
                report.missed.push(format!("{} {}", planted.instruction, goal.join(", ")));
            }
        }
    }
    Ok(report)
}

fn checked(task: &Task) -> AnswerReport {
    let offered: Vec<ObjectCard> = task.objects.iter().map(|card| (**card).clone()).collect();
    let request = TaskRequest {
        id: task.id.clone(),
        kind: task.kind,
        surfaces: task.surfaces.clone(),
        min_objects: offered.len().min(3),
        offered,
        between: true,
        source: task.source.clone(),
    };
    check_answer(&as_answer(task).to_string(), &request)
}

/// All tasks that differ from this one in one condition of the goal.
fn changes(task: &Task) -> Vec<Task> {
    let ids: Vec<&InstanceId> = task.scene_graph.nodes.iter().map(|node| &node.id).collect();
    let mut changed = Vec::new();
    for (alternative, atoms) in task.goal.alternatives.iter().enumerate() {
        for (index, atom) in atoms.iter().enumerate() {
            for other in others(atom, &ids, task) {
                let mut task = task.clone();
                task.goal.alternatives[alternative][index] = other;
                changed.push(task);
            }
        }
    }
    changed
}

fn others(atom: &Atom, ids: &[&InstanceId], task: &Task) -> Vec<Atom> {
    let mut others = Vec::new();
    match atom {
        Atom::Relation { subject, relation, reference, second_reference } => {
            let with = |subject: &InstanceId, relation: Relation, reference: &ReferenceId| Atom::Relation {
                subject: subject.clone(),
                relation,
                reference: reference.clone(),
                second_reference: second_reference.clone(),
            };
            for id in ids.iter().filter(|id| !atom.ids().any(|own| *own == ***id)) {
                others.extend([with(id, *relation, reference), with(subject, *relation, id)]);
            }
            others.extend(
                relation
                    .inverse()
                    .filter(|inverse| inverse != relation)
                    .map(|inverse| with(subject, inverse, reference)),
            );
        }
        Atom::State { object, state } => {
            let states = task.card(object).into_iter().flat_map(|card| &card.states);
            let states = states.filter(|other| *other != state);
            others.extend(states.map(|state| Atom::State { object: object.clone(), state: state.clone() }));
        }
    }
    others
}

/// Text summary.
pub fn describe(report: &WordingReport) -> String {
    let share = |count: usize, of: usize| 100.0 * count as f64 / of.max(1) as f64;
    let mut text = format!(
        "planted mismatches   {}, {} named ({:.1} %)\nsound answers        {}, {} refused ({:.1} %)\n",
        report.planted,
        report.named,
        share(report.named, report.planted),
        report.sound,
        report.refused,
        share(report.refused, report.sound),
    );
    for missed in &report.missed {
        text += &format!("  not named: {missed}\n");
    }
    text
}
