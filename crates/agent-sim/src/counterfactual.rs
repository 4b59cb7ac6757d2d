//! Counterfactual episodes: one wrong answer is replaced by the oracle's, and everything before it is unchanged.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, PoisonError};

use genmanip_agent::Services;
use genmanip_agent::ask::{ModelReply, Question, ServiceError, VisionModel};
use genmanip_agent::services::GraspSource;
use genmanip_core::{AgentFailure, FailureClass};

use super::made_agent::MadeAgent;
use super::{GroundTruthFeed, Oracle};

/// Episode to be resumed with one corrected answer.
pub struct Counterfactual {
    /// Index, from 0, of the agent's turn (call of `Policy::act`) at which the episode resumes.
    pub turn: usize,
    /// Policy with the agent as it was before that turn. It replays the recorded answers before the blamed one; for the
    /// class `GraspProposal`, the blamed one too.
    pub policy: GroundTruthFeed,
    is_same: Arc<AtomicBool>,
}

impl Counterfactual {
    /// True if the recorded answer already equals the oracle's, so that nothing was replaced. Valid after the run.
    pub fn is_same(&self) -> bool {
        self.is_same.load(Ordering::Relaxed)
    }
}

impl MadeAgent {
    /// Counterfactual episode from the turn of the blamed answer on: that answer comes from the oracle (for the
    /// class `GraspProposal` it stays as recorded), later answers from `then`, and grasps from `source`. `None` if no
    /// question is blamed, or the agent has no ground truth or no snapshots.
    pub fn corrected(
        &self,
        blamed: &AgentFailure,
        oracle: &Arc<Oracle>,
        then: Arc<dyn VisionModel>,
        source: Arc<dyn GraspSource>,
    ) -> Option<Counterfactual> {
        let ask = blamed.ask?;
        let truth = self.truth.clone()?;
        let turns = self.turns.as_ref()?.lock().unwrap_or_else(PoisonError::into_inner);
        let turn = turns.iter().rposition(|agent| agent.asks() <= ask)?;
        let told = self.judgements.lock().unwrap_or_else(PoisonError::into_inner).answers.clone();
        let is_same = Arc::new(AtomicBool::new(false));
        let replaced = (blamed.class != Some(FailureClass::GraspProposal)).then_some(ask);
        let model =
            Corrected { told, last: ask, replaced, oracle: Arc::clone(oracle), then, is_same: Arc::clone(&is_same) };
        let before = &turns[turn];
        let services = Services { model: Arc::new(model), grasps: source, ..before.services().clone() };
        let (agent, _) = before.branch(services);
        Some(Counterfactual { turn, policy: GroundTruthFeed::new(agent, truth), is_same })
    }
}

/// Model that replays the recorded answers up to number `last`, takes answer number `replaced` from the oracle, and
/// later ones from another model.
struct Corrected {
    told: BTreeMap<usize, String>,
    last: usize,
    replaced: Option<usize>,
    oracle: Arc<Oracle>,
    then: Arc<dyn VisionModel>,
    is_same: Arc<AtomicBool>,
}

impl VisionModel for Corrected {
    fn answer(&self, question: &Question) -> Result<ModelReply, ServiceError> {
        let told = self.told.get(&question.ask);
        if self.replaced == Some(question.ask) {
            let right = self.oracle.answer(question)?;
            self.is_same.store(told == Some(&right.text), Ordering::Relaxed);
            return Ok(right);
        }
        match told.filter(|_| question.ask <= self.last) {
            Some(text) => Ok(ModelReply { text: text.clone(), usage: None, cut_off: false }),
            None => self.then.answer(question),
        }
    }
}
