//! The expert's use of skills.

use std::sync::Arc;

use genmanip_core::{ActionChunk, Observation, Policy, PolicyError, Seed};
use genmanip_layout::Move;
use genmanip_relations::PosedScene;

use super::move_skills::MoveSkills;
use super::{Expert, Phase};

impl Expert {
    /// Lets skills carry out the moves that they serve, instead of the expert's own motions.
    #[must_use]
    pub fn with_skills(self, skills: Arc<dyn MoveSkills>) -> Self {
        Self { skills: Some(skills), ..self }
    }

    /// True if a skill carried out a move in this episode.
    pub fn has_used_skill(&self) -> bool {
        self.has_used_skill
    }

    /// Skill for a move, if one serves it.
    pub(super) fn skill_for(&self, scene: &PosedScene, step: &Move, seed: Seed) -> Option<Box<dyn Policy>> {
        self.skills.as_ref()?.policy(&self.stage, &self.planner, scene, step, seed)
    }

    /// The next commands of the skill in use; its end or failure makes the expert look for the next move.
    pub(super) fn follow_skill(
        &mut self,
        mut skill: Box<dyn Policy>,
        observation: &Observation,
        scene: &PosedScene,
        (arm, width): (&[f64], f64),
    ) -> Result<ActionChunk, PolicyError> {
        match skill.act(observation) {
            Ok(ActionChunk { actions, finished: false }) => {
                self.phase = Phase::Skill(skill);
                Ok(ActionChunk { actions, finished: false })
            }
            Ok(ActionChunk { actions, finished: true }) if !actions.is_empty() => {
                Ok(ActionChunk { actions, finished: false })
            }
            Ok(_) => self.next(observation, scene, arm, width),
            Err(PolicyError::GaveUp(failure)) => {
                self.last_failure = Some(failure);
                self.next(observation, scene, arm, width)
            }
            Err(error) => Err(error),
        }
    }
}
