//! Rows: compact records of every episode and task of a run, small enough to keep all in memory.
//!
//! Pages, tables and programs read these rows, [`totals`] over them, and the [`cases`] selected for images.

pub mod cases;
pub mod totals;

use genmanip_core::{AgentFailure, Atom, EpisodeResult, Failure, FailureCause, Task, TaskKind};
use serde::{Deserialize, Serialize};

/// A task, reduced to what tables and totals need.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct TaskRow {
    /// Id of the task.
    pub id: String,
    /// Kind of the task.
    pub kind: TaskKind,
    /// Names of the relations in the goal, and `state` for required joint states; sorted, without duplicates.
    pub goal: Vec<&'static str>,
    /// Names of the objects in the goal; sorted, without duplicates.
    pub objects: Vec<String>,
}

/// A finished attempt at a demonstration, or an evaluated episode.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct EpisodeRow {
    /// Id of the episode.
    pub id: String,
    /// Index of its task among the rows of tasks.
    pub task: usize,
    /// Label of the evaluation; `None` for an attempt at a demonstration.
    pub evaluation: Option<String>,
    /// Outcome of the episode.
    #[serde(flatten)]
    pub outcome: Outcome,
    /// True if the frames were stored, so that the episode can be rendered.
    pub recorded: bool,
    /// Wall-clock time, s, if known.
    pub wall_s: Option<f64>,
}

/// Condensed outcome of an episode.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Outcome {
    /// True if the goal held at the end.
    pub success: bool,
    /// The most decisive cause of failure; `None` after a success.
    pub cause: Option<FailureCause>,
    /// Evidence of all causes; empty after a success.
    pub evidence: String,
    /// Analysis of an agent's failure; `None` for other policies, after a success, and without an analysis.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub agent_failure: Option<AgentFailure>,
    /// Fraction of the goal reached, 0 to 1.
    pub score: f64,
    /// Distance of the best alternative of the goal from holding: sum of the normalised margins of its unmet
    /// conditions, ≤ 0.
    pub missed_by: f64,
    /// Simulated duration, s.
    pub duration_s: f64,
}

impl TaskRow {
    /// Row of a task.
    pub fn of(task: &Task) -> Self {
        let (mut goal, mut objects) = (Vec::new(), Vec::new());
        for atom in task.goal.alternatives.iter().flatten() {
            match atom {
                Atom::Relation { subject, relation, reference, second_reference } => {
                    goal.push(relation.name());
                    objects.extend([subject, reference].into_iter().chain(second_reference));
                }
                Atom::State { object, .. } => {
                    goal.push("state");
                    objects.push(object);
                }
            }
        }
        goal.sort_unstable();
        goal.dedup();
        let mut objects: Vec<String> = objects.into_iter().map(|id| task.name_of(id).to_string()).collect();
        objects.sort_unstable();
        objects.dedup();
        Self { id: task.id.clone(), kind: task.kind, goal, objects }
    }
}

impl Outcome {
    /// Condensed outcome of a result.
    pub fn of(result: &EpisodeResult) -> Self {
        let missed = result.verdict.best().unwrap_or_default().iter().filter(|atom| !atom.holds);
        let failure = result.failure();
        Self {
            success: result.success,
            cause: failure.as_ref().map(|failure| failure.cause),
            evidence: failure.map(|failure| failure.evidence).unwrap_or_default(),
            agent_failure: result.agent_failure.clone(),
            score: result.verdict.score,
            missed_by: missed.map(|atom| atom.normalised_margin().min(0.0)).filter(|margin| margin.is_finite()).sum(),
            duration_s: result.duration_s,
        }
    }

    /// The most decisive cause, with the evidence of all causes; `None` after a success.
    pub fn failure(&self) -> Option<Failure> {
        self.cause.map(|cause| Failure { cause, evidence: self.evidence.clone() })
    }
}

impl EpisodeRow {
    /// Row of a result.
    pub fn of(
        result: &EpisodeResult,
        task: usize,
        evaluation: Option<&str>,
        recorded: bool,
        wall_s: Option<f64>,
    ) -> Self {
        let evaluation = evaluation.map(str::to_owned);
        Self { id: result.id.clone(), task, evaluation, outcome: Outcome::of(result), recorded, wall_s }
    }

    /// Path of its page in the folder of a full report; `None` for an evaluated episode that was not kept.
    pub fn page(&self) -> Option<String> {
        match &self.evaluation {
            None => Some(format!("episodes/{}.html", self.id)),
            Some(label) => self.recorded.then(|| format!("evaluation/{label}/{}.html", self.id)),
        }
    }

    /// True for an attempt at a demonstration, false for an evaluated episode.
    pub fn is_attempt(&self) -> bool {
        self.evaluation.is_none()
    }
}
