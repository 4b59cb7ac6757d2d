//! Failure attribution: one failure class per failed episode, from the judged answers and the recorded gripper motion.

use std::collections::BTreeMap;

use genmanip_core::{AgentFailure, AgentStage, FailedStage, FailureClass, Frame, Relation, StageCause};
use serde::Serialize;

/// Judgement of one answer, or of the proposed grasps.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AnswerJudgement {
    /// Number of the question, from 0; of proposed grasps, that of the question before them.
    pub ask: usize,
    /// Number of decompositions up to this answer.
    pub round: usize,
    /// Stage of the question; [`AgentStage::Grasp`] for proposed grasps.
    pub stage: AgentStage,
    /// Instruction of the question, or the sub-task that the grasps are for.
    pub subtask: String,
    /// Failure class that the answer causes; `None` if it is correct.
    pub wrong: Option<FailureClass>,
    /// Reason of the judgement in words.
    pub evidence: String,
}

/// Judgements and answers of one episode.
#[derive(Clone, Debug, Default)]
pub struct EpisodeJudgements {
    /// Judgements in the order of the questions.
    pub judgements: Vec<AnswerJudgement>,
    /// Text of every answer, by the number of its question.
    pub answers: BTreeMap<usize, String>,
    /// Index of the object to be placed, by the number of the question that asked for its target; entered when the
    /// answer arrives, before any motion.
    pub sent: BTreeMap<usize, usize>,
    /// Goal relation of each placement of an object that has to move, and the relation to the same reference that the
    /// chosen target achieves; `None` if no relation holds there.
    pub placed: Vec<(Relation, Option<Relation>)>,
    /// Confusion matrix of the checks. Rows: the goal does not hold, it holds. Columns: the answer is not finished,
    /// finished.
    pub checks: [[usize; 2]; 2],
}

impl EpisodeJudgements {
    /// Indices of the objects whose target was asked for since the latest decomposition.
    fn sent_last(&self) -> impl Iterator<Item = usize> + '_ {
        let split = self.judgements.iter().rev().find(|judgement| judgement.stage == AgentStage::Decompose);
        self.sent.range(split.map_or(0, |split| split.ask)..).map(|(_, &object)| object)
    }

    /// Latest judgement of each stage and sub-task. A repeated answer, or one of a later round, replaces the earlier
    /// one, since the closed loop could correct it.
    fn last(&self) -> Vec<&AnswerJudgement> {
        let mut rounds: BTreeMap<AgentStage, usize> = BTreeMap::new();
        for judgement in &self.judgements {
            rounds.insert(judgement.stage, judgement.round);
        }
        let mut last: BTreeMap<(&str, &str), &AnswerJudgement> = BTreeMap::new();
        for judgement in
            self.judgements.iter().filter(|judgement| rounds.get(&judgement.stage) == Some(&judgement.round))
        {
            last.insert((judgement.stage.name(), &judgement.subtask), judgement);
        }
        last.into_values().collect()
    }
}

/// Analysis of a failed episode: class of the first wrong answer that was not corrected, else class of the execution
/// failure.
///
/// `failure` is the agent's own report, `frames` is the recording.
pub fn classify(judgements: &EpisodeJudgements, failure: Option<&FailedStage>, frames: &[Frame]) -> AgentFailure {
    let said = failure.map(|failure| (failure.stage, failure.cause));
    let words = failure.map_or_else(String::new, ToString::to_string);
    let without_answer = |class, evidence| {
        let stage = said.map_or(AgentStage::Execute, |(stage, _)| stage);
        AgentFailure { class: Some(class), stage, ask: None, evidence, transcript: None }
    };
    if let Some((_, StageCause::Service)) = said {
        return without_answer(FailureClass::Service, words);
    }
    let ended_in = |stage: AgentStage| said.is_some_and(|(said, _)| said == stage);
    let wrong = judgements.last().into_iter().filter_map(|judgement| Some((judgement.wrong?, judgement)));
    // A wrong target is irrelevant if the object was lost before reaching it.
    let was_carried = |ask: usize| judgements.sent.get(&ask).is_none_or(|&object| lost(object, frames).is_none());
    let is_plan = |class: FailureClass| {
        matches!(class, FailureClass::PlanGrounding | FailureClass::PlanLocation | FailureClass::PlanMotion)
    };
    let has_tried = !frames.is_empty() && said.is_none_or(|(stage, _)| stage == AgentStage::Check);
    let wrong = wrong.filter(|(class, judgement)| !has_tried || !is_plan(*class) || was_carried(judgement.ask));
    // A format error counts only if it ended the episode.
    let wrong = wrong.filter(|(class, judgement)| *class != FailureClass::Format || ended_in(judgement.stage));
    if let Some((class, judgement)) = wrong.min_by_key(|(_, judgement)| judgement.ask) {
        let class = match (class, said) {
            // The answer that no mask fits is a grounding error, not a format error.
            (FailureClass::Format, Some((AgentStage::Object, StageCause::NotFound))) => FailureClass::GraspGrounding,
            (class, _) => class,
        };
        let AnswerJudgement { ask, stage, .. } = *judgement;
        let evidence = format!("ask {ask} ({}): {}", stage.name(), judgement.evidence);
        return AgentFailure { class: Some(class), stage, ask: Some(ask), evidence, transcript: None };
    }
    let (class, evidence) = match said {
        Some((AgentStage::Object, _)) => (FailureClass::GraspGrounding, words),
        Some((AgentStage::Grasp, StageCause::NoGrasp | StageCause::Unsuited)) => (FailureClass::GraspProposal, words),
        Some((AgentStage::Grasp | AgentStage::Execute, _)) => (FailureClass::GraspExecution, words),
        _ => match judgements.sent_last().find_map(|object| lost(object, frames)) {
            Some(how) => (FailureClass::GraspExecution, how),
            None => (FailureClass::PlanMotion, words),
        },
    };
    without_answer(class, evidence)
}

/// Minimum number of frames in which an object is between the fingers to count as held: half a second at 60 Hz.
const HELD_FRAMES: usize = 30;
/// Increase (m) of the commanded gripper width within [`OPENING_FRAMES`] that counts as opening.
const OPENING_M: f32 = 0.001;
/// Number of frames around the last contact within which the opening command must come; otherwise the object was lost.
const OPENING_FRAMES: usize = 12;

/// Description of how the gripper lost an object, or never held it; `None` if it was released by command.
fn lost(object: usize, frames: &[Frame]) -> Option<String> {
    let is_held = |frame: &&Frame| frame.grasped == Some(object);
    if frames.iter().filter(is_held).count() < HELD_FRAMES {
        return Some("it was never between the fingers for long".into());
    }
    let last = frames.iter().rposition(|frame| frame.grasped == Some(object))?;
    let width = |frame: &Frame| frame.command.last().copied().unwrap_or_default();
    let after = &frames[last..frames.len().min(last + OPENING_FRAMES)];
    let before = &frames[last.saturating_sub(OPENING_FRAMES)..=last];
    let narrowest = before.iter().map(width).fold(f32::INFINITY, f32::min);
    let is_let_go = after.iter().any(|frame| width(frame) > narrowest + OPENING_M);
    (!is_let_go).then(|| format!("it left the fingers at {:.1} s, which held on", frames[last].time_s))
}

#[cfg(test)]
mod tests {
    use genmanip_agent::ask::QuestionKind;

    use super::*;

    /// Test case: description, judgements, reported failure, expected class and expected question number.
    type Case<'a> = (&'a str, Vec<AnswerJudgement>, Option<&'a FailedStage>, FailureClass, Option<usize>);

    fn said(
        ask: usize,
        round: usize,
        stage: QuestionKind,
        subtask: &str,
        wrong: Option<FailureClass>,
    ) -> AnswerJudgement {
        let (stage, subtask) = (stage.into(), subtask.to_owned());
        AnswerJudgement { ask, round, stage, subtask, wrong, evidence: String::new() }
    }

    #[test]
    fn the_first_wrong_answer_that_stood_is_blamed() {
        let object = |ask, round, subtask, is_wrong: bool| {
            said(ask, round, QuestionKind::Object, subtask, is_wrong.then_some(FailureClass::GraspGrounding))
        };
        let format = |ask| said(ask, 0, QuestionKind::Check, "", Some(FailureClass::Format));
        let rounds = FailedStage::new(AgentStage::Check, StageCause::Rounds, String::new());
        let cases: [Case; 7] = [
            ("a wrong one", vec![object(1, 0, "a", true)], None, FailureClass::GraspGrounding, Some(1)),
            (
                "another sub-task's right one takes nothing back",
                vec![object(1, 0, "a", true), object(5, 0, "b", false)],
                None,
                FailureClass::GraspGrounding,
                Some(1),
            ),
            (
                "the same sub-task's does",
                vec![object(1, 0, "a", true), object(5, 0, "a", false)],
                None,
                FailureClass::PlanMotion,
                None,
            ),
            (
                "so does a later round's",
                vec![object(1, 0, "a", true), object(9, 1, "c", false)],
                None,
                FailureClass::PlanMotion,
                None,
            ),
            (
                "of two the first",
                vec![
                    object(1, 0, "a", true),
                    said(3, 0, QuestionKind::PointToPoint, "a", Some(FailureClass::PlanLocation)),
                ],
                None,
                FailureClass::GraspGrounding,
                Some(1),
            ),
            ("form counts where it ended the episode", vec![format(4)], Some(&rounds), FailureClass::Format, Some(4)),
            ("and nowhere else", vec![format(4)], None, FailureClass::PlanMotion, None),
        ];
        for (what, judgements, failure, class, ask) in cases {
            let judgements = EpisodeJudgements { judgements, ..EpisodeJudgements::default() };
            let blamed = classify(&judgements, failure, &[]);
            assert_eq!((blamed.class, blamed.ask), (Some(class), ask), "{what}");
        }
    }

    #[test]
    fn a_thing_that_leaves_fingers_that_hold_on_was_lost() {
        let frame = |grasped: bool, width: f32| Frame {
            time_s: 0.0,
            command: vec![0.0, width],
            joint_position: Vec::new(),
            joint_velocity: Vec::new(),
            joint_torque: Vec::new(),
            gripper_width: 0.0,
            grip_force: 0.0,
            tcp: genmanip_core::Pose::IDENTITY,
            objects: Vec::new(),
            grasped: grasped.then_some(2),
            stray_contact_n: 0.0,
        };
        let run = |held: usize, after: f32| -> Vec<Frame> {
            let held = (0..held).map(|_| frame(true, 0.02));
            held.chain((0..60).map(|_| frame(false, after))).collect()
        };
        let sent = EpisodeJudgements { sent: [(3, 2)].into(), ..EpisodeJudgements::default() };
        let cases = [
            (run(100, 0.08), FailureClass::PlanMotion),
            (run(100, 0.02), FailureClass::GraspExecution),
            (run(3, 0.08), FailureClass::GraspExecution),
        ];
        for (frames, class) in cases {
            assert_eq!(classify(&sent, None, &frames).class, Some(class), "{}", frames.len());
        }
        // Placements before a new decomposition do not count.
        let anew =
            EpisodeJudgements { judgements: vec![said(9, 1, QuestionKind::Decompose, "", None)], ..sent.clone() };
        assert_eq!(classify(&anew, None, &run(3, 0.08)).class, Some(FailureClass::PlanMotion));
        // A wrong target counts only if the object was carried there.
        let wrong = said(3, 0, QuestionKind::PointToPoint, "a", Some(FailureClass::PlanLocation));
        let misplaced = EpisodeJudgements { judgements: vec![wrong], ..sent };
        assert_eq!(classify(&misplaced, None, &run(100, 0.08)).class, Some(FailureClass::PlanLocation));
        assert_eq!(classify(&misplaced, None, &run(3, 0.08)).class, Some(FailureClass::GraspExecution));
    }
}
