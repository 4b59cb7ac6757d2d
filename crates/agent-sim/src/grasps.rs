//! Grasp source with injected detection errors.

use std::sync::Arc;

use genmanip_agent::services::{GraspError, GraspQuestion, GraspSource};
use genmanip_core::{FailureClass, Grasp};

use super::GroundTruth;

/// Offset (m) of a wrong grasp against its approach direction, as by a depth error: half the height of a mug.
const SHORT_M: f64 = 0.06;

/// Grasp source whose first proposals of an episode all close short of the object, as with a depth error.
pub(super) struct FlawedGrasps {
    pub source: Arc<dyn GraspSource>,
    pub truth: GroundTruth,
    /// Transcript of the agent's questions; an error is attributed to the last question.
    pub asks: genmanip_agent::ask::TranscriptRecorder,
}

impl GraspSource for FlawedGrasps {
    fn grasps(&self, question: &GraspQuestion) -> Result<Vec<Grasp>, GraspError> {
        let mut grasps = self.source.grasps(question)?;
        // Repeated requests for grasps after the same question get the same error.
        let last = self.asks.asks().saturating_sub(1);
        let injected = self.truth.injected();
        if grasps.is_empty() || injected.first().is_some_and(|injected| injected.ask != last) {
            return Ok(grasps);
        }
        for grasp in &mut grasps {
            grasp.pose.position -= grasp.approach() * SHORT_M;
        }
        if injected.is_empty() {
            self.truth.record_injected(last, FailureClass::GraspProposal);
        }
        Ok(grasps)
    }
}
