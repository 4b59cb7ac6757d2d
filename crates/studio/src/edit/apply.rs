//! Application of an operation to a scenario, with the inverse operation.

use genmanip_assets::AssetSource;
use genmanip_core::{Document, Scenario};

use super::derived::Derived;
use super::error::EditError;
use super::operation::{Change, Operation};
use super::{objects, task_parts};

impl Operation {
    /// Applies the operation; the result depends on the arguments alone.
    ///
    /// Groups of interchangeable instances and named surfaces are derived again if they were derived before.
    ///
    /// # Errors
    /// [`EditError::Invalid`] if the operation does not fit the scenario.
    pub fn apply(&self, scenario: &Scenario, assets: &dyn AssetSource) -> Result<Change, EditError> {
        let derived = Derived::of(scenario);
        let mut after = scenario.clone();
        let (operation, inverse) = match self {
            Self::Place { objects } => (self.clone(), objects::place(&mut after, objects, assets)?),
            Self::State { object, state, joint_positions } => (
                self.clone(),
                objects::set_state(&mut after, object, state.as_deref(), joint_positions.as_deref(), assets)?,
            ),
            Self::Add { asset, id, pose, distractor } => {
                objects::add(&mut after, asset, id.as_ref(), *pose, *distractor, assets)?
            }
            Self::Remove { object } => (self.clone(), objects::remove(&mut after, object, derived.groups_follow)?),
            Self::Insert { instance } => (self.clone(), objects::insert(&mut after, instance)?),
            Self::Duplicate { object, pose, id } => objects::duplicate(&mut after, object, *pose, id.as_ref(), assets)?,
            Self::Swap { object, uid, id } => {
                objects::swap(&mut after, object, uid, id.as_ref(), derived.groups_follow, assets)?
            }
            Self::Exchange { object, instance } => {
                (self.clone(), objects::exchange(&mut after, object, instance, derived.groups_follow)?)
            }
            Self::Instruction { text } => (self.clone(), task_parts::set_instruction(&mut after, text)?),
            Self::Goal { goal } => (self.clone(), task_parts::set_goal(&mut after, goal)?),
            Self::Edges { edges, description } => {
                (self.clone(), task_parts::set_edges(&mut after, edges, description.as_deref())?)
            }
            Self::Kind { kind } => {
                let before = std::mem::replace(&mut after.task.kind, *kind);
                (self.clone(), Self::Kind { kind: before })
            }
            Self::Camera { camera, index } => (self.clone(), task_parts::set_camera(&mut after, camera, *index)?),
            Self::RemoveCamera { name } => (self.clone(), task_parts::remove_camera(&mut after, name)?),
        };
        derived.complete(&mut after)?;
        after.check().map_err(|error| EditError::invalid("args", error.to_string(), ""))?;
        Ok(Change { scenario: after, operation, inverse })
    }
}
