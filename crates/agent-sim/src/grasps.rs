//! Where the agent's grasps come from, and a detector that is wrong once on purpose.

use std::sync::Arc;

use genmanip_agent::services::{GraspError, GraspQuestion, GraspSource};
use genmanip_core::Grasp;

use super::Truth;
use super::failure::FailureClass;

/// How far a wrong grasp stays short of the thing, m: what a detector does whose depth is off by half a mug.
const SHORT_M: f64 = 0.06;

/// A source whose first grasps of the episode all close short of the thing, as from a wrong depth.
pub(super) struct FlawedGrasps {
    pub source: Arc<dyn GraspSource>,
    pub truth: Truth,
    /// The number of the ask before, for the record.
    pub asks: genmanip_agent::ask::TranscriptRecorder,
}

impl GraspSource for FlawedGrasps {
    fn grasps(&self, question: &GraspQuestion) -> Result<Vec<Grasp>, GraspError> {
        let mut grasps = self.source.grasps(question)?;
        // What is asked for a second time for the same thing is the same mistake.
        let last = self.asks.asks().saturating_sub(1);
        let planted = self.truth.planted();
        if grasps.is_empty() || planted.first().is_some_and(|planted| planted.ask != last) {
            return Ok(grasps);
        }
        for grasp in &mut grasps {
            grasp.pose.position -= grasp.approach() * SHORT_M;
        }
        if planted.is_empty() {
            self.truth.plant(last, FailureClass::GraspProposal);
        }
        Ok(grasps)
    }
}
