//! What was wrong with an answer, from truth that the agent never sees: the failure analysis of an episode.
//!
//! A [`Witness`] stands between the agent and its model, passes everything on unchanged, and notes for each answer
//! whether it was right as things stood. It knows nothing of errors that an oracle makes on purpose, so that its labels
//! can be tested against those.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use genmanip_agent::ask::{Answer, Answered, FailedStage, Marks, Question, ServiceError, Stage, VisionModel, parse};
use genmanip_core::Atom;
use genmanip_core::glam::DVec3;
use genmanip_layout::{Move, moves};
use genmanip_rollout::{RolloutSettings, Stage as Scene};
use genmanip_scene::relations::{PosedScene, judge_atom, judge_goal};
use serde::Serialize;

use super::Truth;

/// Why an episode failed: the six classes of the paper, and those of a closed loop.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FailureClass {
    /// The task was split into the wrong sub-tasks.
    Decomposition,
    /// The wrong thing was chosen to be taken.
    GraspGrounding,
    /// The chosen part or point, or the detector, gave no grasp that fits.
    GraspProposal,
    /// The grasp could not be carried out, or did not hold.
    GraspExecution,
    /// The thing was sent to the wrong reference.
    PlanGrounding,
    /// The reference was right, the place was not.
    PlanLocation,
    /// The way could not be gone, or the thing did not end where it was sent.
    PlanMotion,
    /// The check said finished too soon, or not finished too late.
    Checker,
    /// Answers were not in the form that was asked for, or named what was not drawn.
    Format,
    /// A service did not answer.
    Service,
}

impl FailureClass {
    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Decomposition => "decomposition",
            Self::GraspGrounding => "grasp_grounding",
            Self::GraspProposal => "grasp_proposal",
            Self::GraspExecution => "grasp_execution",
            Self::PlanGrounding => "plan_grounding",
            Self::PlanLocation => "plan_location",
            Self::PlanMotion => "plan_motion",
            Self::Checker => "checker",
            Self::Format => "format",
            Self::Service => "service",
        }
    }
}

/// What an answer was worth.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Testimony {
    /// Number of the ask.
    pub ask: usize,
    /// Stage of the ask.
    pub stage: Stage,
    /// What the answer would make fail; `None` for a right one.
    pub wrong: Option<FailureClass>,
    /// What was seen.
    pub evidence: String,
}

/// Passes questions on and notes what the answers are worth.
pub struct Witness {
    model: Arc<dyn VisionModel>,
    truth: Truth,
    heard: Arc<Mutex<Heard>>,
}

/// What was noted in one episode.
#[derive(Clone, Debug, Default)]
pub struct Heard {
    /// In the order of the asks.
    pub testimonies: Vec<Testimony>,
    /// Objects to be moved when the task was split last.
    pending: Vec<Move>,
    /// The object that was chosen last.
    taken: Option<usize>,
}

impl Witness {
    /// Between an agent and a model; `heard` is filled as they talk.
    pub fn new(model: Arc<dyn VisionModel>, truth: Truth, heard: Arc<Mutex<Heard>>) -> Self {
        Self { model, truth, heard }
    }

    fn testify(&self, question: &Question, answer: &Answer) -> (Option<FailureClass>, String) {
        let scene = self.truth.scene();
        match answer {
            Answer::Decompose(_) => {
                self.heard().pending = self.undone(&scene);
                // Words cannot be judged here; what comes of them can.
                (None, String::new())
            }
            Answer::Mark(answer) if question.stage == Stage::Object => self.object(question, answer.mask, &scene),
            Answer::Point(answer) => self.place(question, answer.cell, &scene),
            Answer::Path(answer) => match answer.cells.last() {
                Some(last) => self.place(question, last.cell, &scene),
                None => (None, String::new()),
            },
            Answer::Check(answer) => {
                let stage = self.truth.stage();
                let state = self.truth.state();
                let rest = state.map(|state| Scene::rest(&state.objects, state.grasped, &RolloutSettings::default()));
                let verdict = judge_goal(&scene, &stage.goal, &rest.unwrap_or_default(), &stage.relations);
                let wrong = (verdict.success != answer.finished).then_some(FailureClass::Checker);
                (wrong, format!("said finished: {}, the goal holds: {}", answer.finished, verdict.success))
            }
            Answer::Mark(_) | Answer::GrabPoint(_) => (None, String::new()),
        }
    }

    /// Moves of every alternative that are not done.
    fn undone(&self, scene: &PosedScene) -> Vec<Move> {
        let stage = self.truth.stage();
        let holds = |atom: &Atom| judge_atom(scene, atom, &stage.relations).holds;
        let all = moves(&stage.goal, scene).into_iter().flatten();
        all.filter(|step| !step.atoms.iter().all(holds)).collect()
    }

    fn object(&self, question: &Question, mask: usize, scene: &PosedScene) -> (Option<FailureClass>, String) {
        let Marks::Masks(drawn) = &question.marks else { return (None, String::new()) };
        let known = self.truth.masks(&question.view).unwrap_or_default();
        let chosen = drawn.get(mask);
        let covered = chosen.and_then(|chosen| {
            let overlaps = known.iter().map(|(object, mask)| (mask.iou(chosen), *object));
            overlaps.max_by(|a, b| a.0.total_cmp(&b.0))
        });
        let taken = covered.map(|(_, object)| object);
        self.heard().taken = taken;
        let name = taken.map_or("nothing", |object| self.truth.stage().name(object));
        let wanted: Vec<usize> = self.undone(scene).iter().map(|step| step.object).collect();
        if taken.is_some_and(|object| wanted.contains(&object)) {
            return (None, format!("the mask is that of {name}"));
        }
        // What the sub-task names was chosen; then the sub-task is wrong.
        let is_named = question.instruction.to_lowercase().contains(&format!("pick up the {}", name.to_lowercase()));
        match taken.is_some() && is_named {
            true => (Some(FailureClass::Decomposition), format!("the sub-task names {name}, which need not move")),
            false => (Some(FailureClass::GraspGrounding), format!("the mask is that of {name}")),
        }
    }

    /// Whether the goal's conditions on the taken thing would hold if it came to rest where it is sent.
    fn place(
        &self,
        question: &Question,
        cell: genmanip_agent::grid::Cell,
        scene: &PosedScene,
    ) -> (Option<FailureClass>, String) {
        let Marks::Grid { targets, .. } = &question.marks else { return (None, String::new()) };
        let taken = self.heard().taken;
        let (Some(point), Some(object)) = (targets.get(&cell), taken) else { return (None, String::new()) };
        let steps: Vec<Move> = self.undone(scene).into_iter().filter(|step| step.object == object).collect();
        if steps.is_empty() {
            return (None, "the wrong thing is placed".into());
        }
        let would_hold = |atoms: &[Atom]| {
            let after = put(scene, object, *point);
            atoms.iter().all(|atom| is_met(&after, atom, *point, &self.truth))
        };
        if steps.iter().any(|step| would_hold(&step.atoms)) {
            return (None, format!("{} would serve in {cell}", self.truth.stage().name(object)));
        }
        // The same relation to another thing: the wrong reference.
        let others = (0..scene.objects().len()).filter(|other| *other != object);
        for other in others {
            let id = scene.objects().nth(other).map(|posed| posed.id.clone()).unwrap_or_default();
            let to_other = |step: &Move| -> Vec<Atom> { step.atoms.iter().map(|atom| aimed_at(atom, &id)).collect() };
            if steps.iter().any(|step| to_other(step) != step.atoms && would_hold(&to_other(step))) {
                let name = self.truth.stage().name(other);
                return (Some(FailureClass::PlanGrounding), format!("in {cell} it would stand so to {name}"));
            }
        }
        (Some(FailureClass::PlanLocation), format!("in {cell} no condition on it would hold"))
    }

    fn heard(&self) -> std::sync::MutexGuard<'_, Heard> {
        self.heard.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The scene with a thing moved over a point.
fn put(scene: &PosedScene, object: usize, point: DVec3) -> PosedScene {
    let mut after = scene.clone();
    if let Some(bounds) = scene.bounds(object) {
        after.shift(object, point - bounds.center().with_z(bounds.min.z));
    }
    after
}

/// Whether a condition would be met; in what carries it a thing may still fall or tip, so there only the plane counts.
fn is_met(after: &PosedScene, atom: &Atom, point: DVec3, truth: &Truth) -> bool {
    match atom {
        Atom::Relation { relation, reference, .. } if relation.is_support() => {
            let bounds = after.index_of(reference).and_then(|carrier| after.bounds(carrier));
            bounds.is_some_and(|bounds| {
                let inner = (bounds.max - bounds.min) * 0.1;
                point.x > bounds.min.x + inner.x
                    && point.x < bounds.max.x - inner.x
                    && point.y > bounds.min.y + inner.y
                    && point.y < bounds.max.y - inner.y
            })
        }
        _ => judge_atom(after, atom, &truth.stage().relations).holds,
    }
}

/// The same condition with another first reference.
fn aimed_at(atom: &Atom, id: &str) -> Atom {
    match atom {
        Atom::Relation { subject, relation, second_reference, .. } => Atom::Relation {
            subject: subject.clone(),
            relation: *relation,
            reference: id.to_owned(),
            second_reference: second_reference.clone(),
        },
        other @ Atom::State { .. } => other.clone(),
    }
}

impl VisionModel for Witness {
    fn answer(&self, question: &Question) -> Result<Answered, ServiceError> {
        let answered = self.model.answer(question)?;
        let (wrong, evidence) = match parse(question, &answered.text) {
            Ok(answer) => self.testify(question, &answer),
            Err(complaint) => (Some(FailureClass::Format), complaint.to_string()),
        };
        let testimony = Testimony { ask: question.ask, stage: question.stage, wrong, evidence };
        self.heard().testimonies.push(testimony);
        Ok(answered)
    }
}

/// The class of a failed episode: the answer that was wrong and stayed so, or else what the hand did not manage.
///
/// `failure` is what the agent says of its own failure. A later right answer of a stage takes back an earlier wrong
/// one, since the loop then had its chance; of several that are left the first is blamed.
pub fn classify(heard: &Heard, failure: Option<&FailedStage>) -> (FailureClass, String) {
    let said = failure.map(|failure| (failure.stage.as_str(), failure.cause.as_str()));
    if let Some((_, "service")) = said {
        return (FailureClass::Service, String::new());
    }
    let mut last: BTreeMap<Stage, &Testimony> = BTreeMap::new();
    for testimony in &heard.testimonies {
        last.insert(testimony.stage, testimony);
    }
    let ended_in = |stage: Stage| said.is_some_and(|(said, _)| said == stage.name());
    let wrong = last.values().filter(|testimony| testimony.wrong.is_some()).filter(|testimony| {
        // An answer that did not fit counts only where the episode ended with it.
        testimony.wrong != Some(FailureClass::Format) || ended_in(testimony.stage)
    });
    if let Some(testimony) = wrong.min_by_key(|testimony| testimony.ask)
        && let Some(class) = testimony.wrong
    {
        let class = match (class, said) {
            // That no mask fits is no lack of form.
            (FailureClass::Format, Some(("object", "not_found"))) => FailureClass::GraspGrounding,
            (class, _) => class,
        };
        return (class, format!("ask {} ({}): {}", testimony.ask, testimony.stage.name(), testimony.evidence));
    }
    let class = match said {
        Some(("object", _)) => FailureClass::GraspGrounding,
        Some(("grasp", "none" | "unsuited")) => FailureClass::GraspProposal,
        Some(("grasp" | "execute", _)) => FailureClass::GraspExecution,
        Some(("segmentation" | "look", _)) => FailureClass::Service,
        _ => FailureClass::PlanMotion,
    };
    (class, failure.map_or_else(String::new, ToString::to_string))
}
