//! States of articulated objects.

use genmanip_core::{JointKind, JointState, Unit};

use super::PosedScene;
use super::RelationSettings;
use super::posed_scene::Body;
use super::requirement::Requirement;

/// The state of an object of the scene; `None` between states or without joints.
///
/// A previous state ([`PosedScene::set_previous_states`]) persists until a joint is outside of its interval by more
/// than the hysteresis.
pub fn joint_state(scene: &PosedScene, index: usize, settings: &RelationSettings) -> Option<String> {
    let body = scene.bodies.get(index)?;
    let holds = |name: &str| state_requirements(body, name, settings).iter().all(Requirement::met);
    let previous = body.previous_state.clone().filter(|state| holds(state));
    previous.or_else(|| {
        let states = body.shape.model.joint_states().iter();
        states.map(|state| &state.name).find(|name| holds(name)).cloned()
    })
}

impl PosedScene {
    /// Sets the previous state of each object; objects beyond the end of the list keep theirs.
    pub fn set_previous_states(&mut self, states: impl IntoIterator<Item = Option<String>>) {
        for (body, state) in self.bodies.iter_mut().zip(states) {
            body.previous_state = state;
        }
    }
}

/// Requires every joint to lie in its interval of the state, widened by the hysteresis for the previous state.
pub(super) fn state_requirements(body: &Body, state: &str, settings: &RelationSettings) -> Vec<Requirement> {
    let known_states = body.shape.model.joint_states();
    let Some(wanted) = known_states.iter().find(|known| known.name == state) else {
        return vec![Requirement::fact("a state of the object", false)];
    };
    // States exclude each other: a state that persists by hysteresis excludes the others.
    let lasting = body.previous_state.as_deref().filter(|previous| *previous != state).is_some_and(|previous| {
        known_states.iter().any(|known| {
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
    let names = body.shape.model.links().iter().filter_map(|link| link.joint.as_ref());
    let positions: Vec<(&str, f64, Unit)> = names
        .zip(body.joint_positions.iter().copied().chain(std::iter::repeat(0.0)))
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
