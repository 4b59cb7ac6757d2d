//! Measures a batch of designs: validity, variety, quotas and uniqueness of references.

use std::collections::{BTreeMap, BTreeSet};

use genmanip_core::{ObjectCard, Relation, Seed, TaskKind};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::balance::Balance;
use super::{DesignError, DesignSettings, as_answer, design_many};
use crate::answer::{TaskRequest, Verdict, check_answer};
use crate::references;

/// Statistics of a batch of designs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct DesignReport {
    /// Seed from which the batch was designed.
    pub seed: Seed,
    /// Number of tasks composed.
    pub tasks: usize,
    /// Number of tasks that the validator accepts without repairs.
    pub valid: usize,
    /// Number of distinct instructions.
    pub distinct_instructions: usize,
    /// Share of distinct instructions among all tasks, 0-1.
    pub distinct_share: f64,
    /// Number of tasks of each kind, and the number according to its quota.
    pub kinds: BTreeMap<String, Occurrence>,
    /// Number of edges and goal conditions with each relation, and the number according to its quota.
    pub relations: BTreeMap<String, Occurrence>,
    /// Largest deviation of a number from its quota, relative to the quota.
    pub worst_quota_deviation: f64,
    /// Number of goal objects to which the instructions refer.
    pub references: usize,
    /// Number of these references that the independent reader resolves uniquely and in the right role.
    pub references_unique: usize,
    /// Number of words in the longest instruction.
    pub words_max: usize,
    /// Processor time of the design, seconds.
    pub cpu_s: f64,
    /// Number of rejected designs by reason.
    pub rejections: BTreeMap<String, usize>,
    /// Defects found in finished tasks, one text each.
    pub flaws: Vec<String>,
}

/// Actual number of tasks or relations, and the number according to the quota.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Occurrence {
    /// Number in the batch.
    pub count: usize,
    /// Number according to the quota.
    pub quota: f64,
}

/// Designs a batch and checks every task again, independently of the designer's own gate.
///
/// `clock` returns processor time in seconds.
///
/// # Errors
/// [`DesignError`] if a task cannot be composed.
pub fn measure(
    cards: &[ObjectCard],
    count: usize,
    seed: Seed,
    settings: &DesignSettings,
    clock: &mut dyn FnMut() -> f64,
) -> Result<DesignReport, DesignError> {
    let start = clock();
    let batch = design_many(&TaskKind::ALL, count, cards, seed, settings)?;
    let cpu_s = clock() - start;

    let mut report = DesignReport {
        seed,
        tasks: batch.tasks.len(),
        valid: 0,
        distinct_instructions: batch.tasks.iter().map(|task| &task.instruction).collect::<BTreeSet<_>>().len(),
        distinct_share: 1.0,
        kinds: BTreeMap::new(),
        relations: BTreeMap::new(),
        worst_quota_deviation: 0.0,
        references: 0,
        references_unique: 0,
        words_max: 0,
        cpu_s,
        rejections: batch.rejections,
        flaws: Vec::new(),
    };
    let mut balance = Balance::default();
    let mut request = TaskRequest {
        id: String::new(),
        kind: TaskKind::PickAndPlace,
        offered: cards.to_vec(),
        surfaces: Vec::new(),
        min_objects: settings.objects[0],
        between: true,
        source: String::new(),
    };
    for task in &batch.tasks {
        (request.id, request.kind, request.source) = (task.id.clone(), task.kind, task.source.clone());
        let nodes = task.scene_graph.nodes.iter().zip(&task.objects);
        let copies = nodes.filter(|(node, card)| node.id != card.uid.as_str()).map(|(_, card)| (**card).clone());
        request.offered.truncate(cards.len());
        request.offered.extend(copies);
        let judged = check_answer(&as_answer(task).to_string(), &request);
        if judged.verdict == Verdict::Valid {
            report.valid += 1;
        } else {
            report.flaws.push(format!("{}: {:?}", task.id, judged.flaws.first().map(|flaw| flaw.kind.name())));
        }
        let referred = references::intended(task);
        report.references += referred.len();
        report.references_unique += references::resolved(task);
        if let Err(mismatch) = references::check(task) {
            report.flaws.push(format!("{}: {mismatch}: {}", task.id, task.instruction));
        }
        report.words_max = report.words_max.max(task.instruction.split_whitespace().count());
        balance.count(task);
    }
    if report.tasks > 0 {
        report.distinct_share = report.distinct_instructions as f64 / report.tasks as f64;
    }
    for kind in TaskKind::ALL {
        let count = batch.tasks.iter().filter(|task| task.kind == kind).count();
        let quota = report.tasks as f64 / TaskKind::ALL.len() as f64;
        report.kinds.insert(kind.name().into(), Occurrence { count, quota });
    }
    for relation in Relation::ALL {
        let quota = settings.relation_quotas.of(relation) * balance.total() as f64;
        report.relations.insert(relation.name().into(), Occurrence { count: balance.of(relation), quota });
    }
    let deviation = |occurrence: &Occurrence| (occurrence.count as f64 / occurrence.quota.max(1e-9) - 1.0).abs();
    let all = report.kinds.values().chain(report.relations.values());
    report.worst_quota_deviation = if report.tasks == 0 { 0.0 } else { all.map(deviation).fold(0.0, f64::max) };
    Ok(report)
}
