//! Skills that carry out moves in place of the expert's own motions.

use std::sync::Arc;

use genmanip_core::{Policy, Seed};
use genmanip_layout::Move;
use genmanip_motion::Planner;
use genmanip_relations::PosedScene;

use crate::Stage;

/// Skills that the expert uses for the moves that they serve.
pub trait MoveSkills: Send + Sync {
    /// Policy that carries out a move, already reset; `None` if no skill serves the move, which is then the expert's.
    fn policy(
        &self,
        stage: &Stage,
        planner: &Arc<Planner>,
        scene: &PosedScene,
        step: &Move,
        seed: Seed,
    ) -> Option<Box<dyn Policy>>;
}
