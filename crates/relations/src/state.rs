//! States of articulated objects.

use genmanip_core::{JointKind, JointState, Unit};

use super::PosedScene;
use super::RelationSettings;
use super::posed_scene::Body;
use super::requirement::Requirement;

/// The state an object of a scene is in, `None` between states or without joints.
///
/// With a state from before ([`PosedScene::set_previous_states`]) that state lasts until a joint has left its interval
/// by more than the hysteresis.
pub fn joint_state(scene: &PosedScene, index: usize, settings: &RelationSettings) -> Option<String> {
    let body = scene.bodies.get(index)?;
    let holds = |name: &str| state_requirements(body, name, settings).iter().all(Requirement::met);
    let previous = body.previous_state.clone().filter(|state| holds(state));
    previous.or_else(|| {
        let states = body.object.model.joint_states.iter();
        states.map(|state| &state.name).find(|name| holds(name)).cloned()
    })
}

impl PosedScene {
    /// Tells the state each object was in before; objects beyond the end keep what they had.
    pub fn set_previous_states(&mut self, states: impl IntoIterator<Item = Option<String>>) {
        for (body, state) in self.bodies.iter_mut().zip(states) {
            body.previous_state = state;
        }
    }
}

/// Every joint of the state lies in its interval, widened if the object was in that state before.
pub(super) fn state_requirements(body: &Body, state: &str, settings: &RelationSettings) -> Vec<Requirement> {
    let model = &body.object.model;
    let Some(wanted) = model.joint_states.iter().find(|known| known.name == state) else {
        return vec![Requirement::fact("a state of the object", false)];
    };
    // States exclude each other: the one that lasts by hysteresis keeps the others out.
    let lasting = body.previous_state.as_deref().filter(|previous| *previous != state).is_some_and(|previous| {
        model.joint_states.iter().any(|known| {
            known.name == previous && joints(body, known, settings.state_hysteresis).iter().all(Requirement::met)
        })
    });
    let widening = if body.previous_state.as_deref() == Some(state) { settings.state_hysteresis } else { 0.0 };
    let mut requirements = joints(body, wanted, widening);
    if lasting {
        requirements.push(Requirement::fact("free of the state before", false));
    }
    requirements
}

fn joints(body: &Body, state: &JointState, widening: f64) -> Vec<Requirement> {
    let names = body.object.model.links.iter().filter_map(|link| link.joint.as_ref());
    let positions: Vec<(&str, f64, Unit)> = names
        .zip(body.object.joint_positions.iter().copied().chain(std::iter::repeat(0.0)))
        .map(|(joint, position)| {
            let unit = match joint.kind {
                JointKind::Revolute => Unit::Radian,
                JointKind::Prismatic => Unit::Metre,
            };
            (joint.name.as_str(), position, unit)
        })
        .collect();
    state
        .intervals
        .iter()
        .flat_map(|(name, [low, high])| {
            let slack = widening * (high - low);
            match positions.iter().find(|(joint, ..)| joint == name) {
                Some(&(_, position, unit)) => vec![
                    Requirement::at_most("joint position above its least", low - slack - position, 0.0).in_unit(unit),
                    Requirement::at_most("joint position over its most", position - high - slack, 0.0).in_unit(unit),
                ],
                None => vec![Requirement::fact("a joint of the object", false)],
            }
        })
        .collect()
}
