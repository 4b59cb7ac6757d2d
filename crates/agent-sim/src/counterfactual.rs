//! What would have become of an episode if one answer had been the oracle's: everything before it is as it was.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, PoisonError};

use genmanip_agent::Services;
use genmanip_agent::ask::{ModelReply, Question, ServiceError, VisionModel};
use genmanip_agent::services::GraspSource;

use super::choice::MadeAgent;
use super::failure::{Blamed, FailureClass};
use super::{Oracle, WithTruth};

/// An episode that is to be taken up again.
pub struct Counterfactual {
    /// The turn before which it is taken up, from 0.
    pub turn: usize,
    /// The agent as it was before that turn; the answers up to the blamed one are those that were given.
    pub policy: WithTruth,
    is_same: Arc<AtomicBool>,
}

impl Counterfactual {
    /// Whether what was answered was the oracle's answer already, so that nothing was replaced. Known once it was run.
    pub fn is_same(&self) -> bool {
        self.is_same.load(Ordering::Relaxed)
    }
}

impl MadeAgent {
    /// The rest of the episode from the turn of the blamed answer on, with that answer the oracle's, and later ones from
    /// `then`; for proposed grasps, with those of `source`. `None` where no answer is to blame, or no turn was remembered.
    pub fn corrected(
        &self,
        blamed: &Blamed,
        oracle: &Arc<Oracle>,
        then: Arc<dyn VisionModel>,
        source: Arc<dyn GraspSource>,
    ) -> Option<Counterfactual> {
        let ask = blamed.ask?;
        let truth = self.truth.clone()?;
        let turns = self.turns.as_ref()?.lock().unwrap_or_else(PoisonError::into_inner);
        let turn = turns.iter().rposition(|agent| agent.asks() <= ask)?;
        let told = self.heard.lock().unwrap_or_else(PoisonError::into_inner).answers.clone();
        let is_same = Arc::new(AtomicBool::new(false));
        let replaced = (blamed.class != FailureClass::GraspProposal).then_some(ask);
        let model =
            Corrected { told, last: ask, replaced, oracle: Arc::clone(oracle), then, is_same: Arc::clone(&is_same) };
        let before = &turns[turn];
        let services = Services { model: Arc::new(model), grasps: source, ..before.services().clone() };
        let (agent, _) = before.branch(services);
        Some(Counterfactual { turn, policy: WithTruth::new(agent, truth), is_same })
    }
}

/// Answers as before up to one ask, there as the oracle does, and from then on as a model does.
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
            Some(text) => Ok(ModelReply { text: text.clone(), usage: None }),
            None => self.then.answer(question),
        }
    }
}
