//! Judgement of each answer against the simulator's ground truth, from which failures are attributed.
//!
//! An [`Annotator`] wraps the agent's model, forwards questions and answers unchanged, and records for each answer
//! whether it was correct in the current state. It does not know which errors an oracle injects, so that its judgements
//! can be tested against them.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use genmanip_agent::Asks;
use genmanip_agent::ask::{
    Answer, Marks, ModelReply, PathCell, Question, QuestionKind, ServiceError, VisionModel, parse,
};
use genmanip_agent::perception::on_plane;
use genmanip_agent::services::{GraspError, GraspQuestion, GraspSource};
use genmanip_core::glam::DVec3;
use genmanip_core::{Aabb, AgentStage, Atom, FailureClass, Grasp, ReferenceId, Relation};
use genmanip_layout::Move;
use genmanip_motion::Planner;
use genmanip_relations::{PosedScene, judge_atom};

use super::GroundTruth;
use super::failure::{AnswerJudgement, EpisodeJudgements};
use super::words;

/// Model wrapper that forwards questions and records the correctness of the answers.
pub struct Annotator {
    model: Arc<dyn VisionModel>,
    truth: GroundTruth,
    planner: Arc<Planner>,
    judgements: Arc<Mutex<EpisodeJudgements>>,
    memory: Arc<Mutex<Memory>>,
    asks: Asks,
}

/// State that is kept from earlier questions.
#[derive(Clone, Debug, Default)]
struct Memory {
    /// Number of decompositions so far.
    rounds: usize,
    /// Number of the question that gave the latest decomposition.
    split: Option<usize>,
    /// Number of the round's sub-tasks that are not begun.
    open: usize,
    /// Number of the check question that ended a round, and the sub-tasks that it reported as remaining.
    remaining: Option<(usize, Vec<String>)>,
    /// Index of the object chosen last; `None` if no object matches the chosen mask.
    taken: Option<usize>,
    /// Sub-task for which an object was asked last.
    subtask: String,
    /// Number of the latest question of any kind.
    ask: usize,
}

impl Annotator {
    /// Wraps the model of an agent; `asks` tells which questions the agent asks. Each answer adds its judgement to
    /// `judgements`.
    pub fn new(
        model: Arc<dyn VisionModel>,
        truth: GroundTruth,
        planner: &Arc<Planner>,
        judgements: Arc<Mutex<EpisodeJudgements>>,
        asks: Asks,
    ) -> Self {
        Self { model, truth, planner: Arc::clone(planner), judgements, memory: Arc::default(), asks }
    }

    /// Wraps the agent's grasp source; the wrapper shares this annotator's judgements.
    pub fn of_grasps(&self, source: Arc<dyn GraspSource>) -> GraspAnnotator {
        let (truth, judgements, memory) = (self.truth.clone(), Arc::clone(&self.judgements), Arc::clone(&self.memory));
        GraspAnnotator { source, truth, judgements, memory }
    }

    fn testify(&self, question: &Question, answer: &Answer) -> (Option<FailureClass>, String) {
        let scene = self.truth.scene();
        match answer {
            Answer::Decompose(answer) => {
                let mut memory = lock(&self.memory);
                (memory.split, memory.open) = (Some(question.ask), answer.subtasks.len());
                memory.subtask.clear();
                self.split(&answer.subtasks, &scene)
            }
            Answer::Mark(answer) if question.stage == QuestionKind::Object => {
                self.object(question, answer.mask, &scene)
            }
            Answer::Point(answer) => self.place(question, answer.cell, &scene),
            Answer::Path(answer) => match answer.cells.split_last() {
                Some((last, way)) => match self.place(question, last.cell, &scene) {
                    (None, right) => self
                        .way(question, way)
                        .map_or((None, right), |blocked| (Some(FailureClass::PlanMotion), blocked)),
                    wrong => wrong,
                },
                None => (None, String::new()),
            },
            Answer::Check(answer) => {
                let holds = self.truth.verdict().success;
                lock(&self.judgements).checks[usize::from(holds)][usize::from(answer.finished)] += 1;
                let wrong = (holds != answer.finished).then_some(FailureClass::Checker);
                (wrong, format!("said finished: {}, the goal holds: {holds}", answer.finished))
            }
            Answer::Mark(_) | Answer::GrabPoint(_) => (None, String::new()),
        }
    }

    /// Judges a decomposition: each sub-task must name an object that has to move, and only references of one of its
    /// goal relations. Sub-tasks that name no object are skipped, since the answers that follow from them are judged.
    fn split(&self, subtasks: &[String], scene: &PosedScene) -> (Option<FailureClass>, String) {
        let stage = self.truth.stage();
        let names: Vec<String> = (0..scene.objects().len()).map(|object| stage.name(object).to_owned()).collect();
        let undone = self.undone(scene);
        for subtask in subtasks {
            let named = words::named(subtask, &names);
            let Some((thing, references)) = named.split_first() else { continue };
            let steps: Vec<&Move> = undone.iter().filter(|step| names[step.object] == names[*thing]).collect();
            if steps.is_empty() {
                return (
                    Some(FailureClass::Decomposition),
                    format!("{}, which need not move, is named", names[*thing]),
                );
            }
            let fits = |step: &&Move| {
                let wanted: Vec<&String> = (step.atoms.iter().flat_map(Atom::references))
                    .filter_map(|id| Some(&names[scene.index_of(id)?]))
                    .collect();
                references.iter().all(|reference| wanted.contains(&&names[*reference]))
            };
            if !steps.iter().any(fits) {
                let said: Vec<&str> = references.iter().map(|reference| names[*reference].as_str()).collect();
                let evidence = format!("{} has no place at {}", names[*thing], said.join(" and "));
                return (Some(FailureClass::Decomposition), evidence);
            }
        }
        (None, String::new())
    }

    /// Evidence that the arm cannot reach a cell of the path from above at the answered height, for the first such
    /// cell; `None` if it reaches all.
    fn way(&self, question: &Question, way: &[PathCell]) -> Option<String> {
        let Marks::Grid { grid, .. } = &question.marks else { return None };
        let over = |step: &PathCell| {
            let table_m = 0.0; // the world's z is 0 on the table
            Some(on_plane(&question.view, grid.center(step.cell), table_m)? + DVec3::Z * step.height_m)
        };
        // The first cell is skipped: it is the object's current position.
        let beyond =
            way.iter().skip(1).find(|step| over(step).is_some_and(|point| !self.planner.reaches_from_above(point)));
        beyond.map(|step| format!("the arm is not over {} at {} m", step.cell, step.height_m))
    }

    /// Unfinished moves of all goal alternatives.
    fn undone(&self, scene: &PosedScene) -> Vec<Move> {
        self.truth.undone(scene).into_iter().flatten().collect()
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
        lock(&self.memory).taken = taken;
        let name = taken.map_or("nothing", |object| self.truth.stage().name(object));
        let wanted: Vec<usize> = self.undone(scene).iter().map(|step| step.object).collect();
        if taken.is_some_and(|object| wanted.contains(&object)) {
            return (None, format!("the mask is that of {name}"));
        }
        // The mask matches the object named in the sub-task, so the decomposition is wrong.
        let is_named = question.instruction.to_lowercase().contains(&format!("pick up the {}", name.to_lowercase()));
        match taken.is_some() && is_named {
            true => {
                self.blame_split(format!("the sub-task names {name}, which need not move"));
                (None, format!("the mask is that of {name}, as the sub-task says"))
            }
            false => (Some(FailureClass::GraspGrounding), format!("the mask is that of {name}")),
        }
    }

    /// Marks the latest decomposition as wrong, unless it already is.
    fn blame_split(&self, evidence: String) {
        let split = lock(&self.memory).split;
        let mut judgements = lock(&self.judgements);
        let is_split =
            |judgement: &&mut AnswerJudgement| Some(judgement.ask) == split && judgement.stage == AgentStage::Decompose;
        let judgement = judgements.judgements.iter_mut().find(is_split);
        if let Some(judgement) = judgement.filter(|judgement| judgement.wrong.is_none()) {
            (judgement.wrong, judgement.evidence) = (Some(FailureClass::Decomposition), evidence);
        }
    }

    /// Judges a placement: the goal conditions on the chosen object must hold when the object stands on the target
    /// point.
    fn place(
        &self,
        question: &Question,
        cell: genmanip_agent::grid::Cell,
        scene: &PosedScene,
    ) -> (Option<FailureClass>, String) {
        let Marks::Grid { targets, .. } = &question.marks else { return (None, String::new()) };
        let taken = lock(&self.memory).taken;
        lock(&self.judgements).sent.extend(taken.map(|object| (question.ask, object)));
        let (Some(point), Some(object)) = (targets.get(&cell), taken) else { return (None, String::new()) };
        let steps: Vec<Move> = self.undone(scene).into_iter().filter(|step| step.object == object).collect();
        if steps.is_empty() {
            return (None, "the wrong thing is placed".into());
        }
        let would_hold = |atoms: &[Atom]| {
            let after = put(scene, object, *point);
            atoms.iter().all(|atom| is_met(&after, atom, *point, &self.truth))
        };
        let is_right = steps.iter().any(|step| would_hold(&step.atoms));
        if let Some((meant, came)) = came_to(&steps, is_right, &would_hold) {
            lock(&self.judgements).placed.push((meant, came));
        }
        if is_right {
            return (None, format!("{} would serve in {cell}", self.truth.stage().name(object)));
        }
        // The reference is wrong if the same relation would hold to another object, which is nearer to the point than
        // the correct reference.
        let apart = |other: usize| scene.bounds(other).map_or(f64::INFINITY, |bounds| distance(&bounds, *point));
        let right = steps.iter().flat_map(|step| &step.atoms).flat_map(Atom::references);
        let right = right.filter_map(|id| scene.index_of(id)).map(apart).fold(f64::INFINITY, f64::min);
        let others = scene.objects().enumerate();
        for (other, posed) in others.filter(|(other, _)| *other != object && apart(*other) < right) {
            let to_other =
                |step: &Move| -> Vec<Atom> { step.atoms.iter().map(|atom| aimed_at(atom, &posed.id)).collect() };
            if steps.iter().any(|step| to_other(step) != step.atoms && would_hold(&to_other(step))) {
                let name = self.truth.stage().name(other);
                return (Some(FailureClass::PlanGrounding), format!("in {cell} it would stand so to {name}"));
            }
        }
        (Some(FailureClass::PlanLocation), format!("in {cell} no condition on it would hold"))
    }
}

/// True if the question shows a finer grid, which covers only a part of the image.
fn is_fine(question: &Question) -> bool {
    matches!(&question.marks, Marks::Grid { grid, .. } if grid.width < question.view.width())
}

/// Goal relation of the first move, and the relation to the same reference that the placement achieves: the goal
/// relation if `is_right`, else the first other relation that would hold, if any.
fn came_to(steps: &[Move], is_right: bool, holds: &dyn Fn(&[Atom]) -> bool) -> Option<(Relation, Option<Relation>)> {
    let Some(Atom::Relation { subject, relation, reference, .. }) = steps.first()?.atoms.first() else { return None };
    if is_right {
        return Some((*relation, Some(*relation)));
    }
    let other = |other: &Relation| {
        let (subject, reference) = (subject.clone(), reference.clone());
        holds(&[Atom::Relation { subject, relation: *other, reference, second_reference: None }])
    };
    let others = Relation::OF_PAIRS.into_iter().filter(|other| other != relation);
    Some((*relation, others.into_iter().find(|relation| other(relation))))
}

/// Horizontal distance (m) between a point and a bounding box; 0 inside.
pub(super) fn distance(bounds: &Aabb, point: DVec3) -> f64 {
    (point.clamp(bounds.min, bounds.max) - point).truncate().length()
}

/// Scene with an object moved so that the centre of its underside is at a point.
fn put(scene: &PosedScene, object: usize, point: DVec3) -> PosedScene {
    let mut after = scene.clone();
    if let Some(bounds) = scene.bounds(object) {
        after.shift(object, point - bounds.center().with_z(bounds.min.z));
    }
    after
}

/// True if a goal condition would hold after the placement. For support relations only the horizontal position is
/// checked, since the object may still fall or tip.
fn is_met(after: &PosedScene, atom: &Atom, point: DVec3, truth: &GroundTruth) -> bool {
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

/// Goal condition with its first reference replaced by the object `id`.
fn aimed_at(atom: &Atom, id: &ReferenceId) -> Atom {
    match atom {
        Atom::Relation { subject, relation, second_reference, .. } => Atom::Relation {
            subject: subject.clone(),
            relation: *relation,
            reference: id.clone(),
            second_reference: second_reference.clone(),
        },
        other @ Atom::State { .. } => other.clone(),
    }
}

impl VisionModel for Annotator {
    fn answer(&self, question: &Question) -> Result<ModelReply, ServiceError> {
        self.answer_each(&[question]).remove(0)
    }

    fn answer_each(&self, questions: &[&Question]) -> Vec<Result<ModelReply, ServiceError>> {
        let answers = self.model.answer_each(questions);
        for (question, answered) in questions.iter().zip(&answers) {
            if let Ok(answered) = answered {
                self.hear(question, answered);
            }
        }
        answers
    }
}

impl Annotator {
    fn hear(&self, question: &Question, answered: &ModelReply) {
        self.hear_of_split(question);
        let round = {
            let mut memory = lock(&self.memory);
            if question.stage == QuestionKind::Decompose && question.refused.is_empty() {
                memory.rounds += 1;
            }
            if question.stage == QuestionKind::Object && memory.subtask != question.instruction {
                memory.subtask.clone_from(&question.instruction);
                memory.open = memory.open.saturating_sub(1);
            }
            memory.ask = question.ask;
            memory.rounds
        };
        let answer = parse(question, &answered.text);
        let (wrong, evidence) = match &answer {
            Ok(answer) => self.testify(question, answer),
            Err(complaint) => (Some(FailureClass::Format), complaint.to_string()),
        };
        let (stage, subtask) = (question.stage.into(), question.instruction.clone());
        let mut judgements = lock(&self.judgements);
        judgements.answers.insert(question.ask, answered.text.clone());
        // A finer grid around a wrong cell contains no correct cell, so only the coarse answer is judged as wrong.
        let same = |judgement: &&AnswerJudgement| judgement.stage == stage && judgement.subtask == subtask;
        let was_wrong = judgements.judgements.iter().rev().find(same).is_some_and(|before| before.wrong.is_some());
        if !(is_fine(question) && wrong.is_some() && was_wrong) {
            judgements.judgements.push(AnswerJudgement { ask: question.ask, round, stage, subtask, wrong, evidence });
        }
        drop(judgements);
        if let Ok(Answer::Check(answer)) = answer {
            let mut memory = lock(&self.memory);
            let splits =
                (memory.open == 0 || self.asks == Asks::Needed) && !answer.finished && !answer.remaining.is_empty();
            memory.remaining = splits.then_some((question.ask, answer.remaining));
        }
    }

    /// Records a new decomposition if a question for an object follows a check that reported remaining sub-tasks.
    fn hear_of_split(&self, question: &Question) {
        let (round, ask, subtasks) = {
            let mut memory = lock(&self.memory);
            let Some((ask, subtasks)) = memory.remaining.take() else { return };
            if question.stage != QuestionKind::Object {
                return;
            }
            memory.rounds += 1;
            (memory.split, memory.open) = (Some(ask), subtasks.len());
            memory.subtask.clear();
            (memory.rounds, ask, subtasks)
        };
        let (wrong, evidence) = self.split(&subtasks, &self.truth.scene());
        let (stage, subtask) = (AgentStage::Decompose, String::new());
        lock(&self.judgements).judgements.push(AnswerJudgement { ask, round, stage, subtask, wrong, evidence });
    }
}

/// Grasp-source wrapper that records the correctness of proposed grasps.
pub struct GraspAnnotator {
    source: Arc<dyn GraspSource>,
    truth: GroundTruth,
    judgements: Arc<Mutex<EpisodeJudgements>>,
    memory: Arc<Mutex<Memory>>,
}

/// Half extents (m) of the volume between the finger pads, across and along the fingers; the pads of the built-in
/// gripper are 2 cm wide and 2 cm long.
const CLOSING_HALF_M: [f64; 2] = [0.011, 0.011];

impl GraspSource for GraspAnnotator {
    fn grasps(&self, question: &GraspQuestion) -> Result<Vec<Grasp>, GraspError> {
        let grasps = self.source.grasps(question)?;
        let Memory { rounds, taken, subtask, ask, .. } = lock(&self.memory).clone();
        let Some(object) = taken.filter(|_| !grasps.is_empty()) else { return Ok(grasps) };
        let surface = self.truth.scene().surface_points(object);
        let holds = |grasp: &Grasp| {
            let tcp_from_world = grasp.pose.inverse();
            surface.iter().any(|point| {
                let inside = tcp_from_world.transform_point(*point).abs();
                let [across, along] = CLOSING_HALF_M;
                inside.x <= across && inside.y <= 0.5 * grasp.width.max(0.01) && inside.z <= along
            })
        };
        let sound = grasps.iter().filter(|grasp| holds(grasp)).count();
        let judgement = AnswerJudgement {
            ask,
            round: rounds,
            stage: AgentStage::Grasp,
            subtask,
            wrong: (sound == 0).then_some(FailureClass::GraspProposal),
            evidence: format!("{sound} of {} proposed grasps have the thing between the fingers", grasps.len()),
        };
        lock(&self.judgements).judgements.push(judgement);
        Ok(grasps)
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
