//! Recipes: of which parts an object is made and how they move, as data.

use genmanip_core::{Joint, JointKind, JointState, ObjectCard, ObjectLink, ObjectModel, Pose, Room, Seed};
use glam::DVec3;
use serde::Deserialize;

use crate::parts::{Part, assemble};

/// Name of the link that stands on the table.
const ROOT: &str = "body";

/// An object as a list of parts in its frame.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// Family, e.g. `mug`.
    pub family: String,
    /// Sliding friction coefficient against a like surface.
    pub friction: f64,
    /// The parts of what stands on the table; their union is the object or, with links, its body.
    pub parts: Vec<Part>,
    /// What moves against the body.
    #[serde(default)]
    pub links: Vec<LinkRecipe>,
    /// What the states of the card mean.
    #[serde(default)]
    pub states: Vec<StateRecipe>,
}

/// A drawer, door, lid, lever, dial or button.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LinkRecipe {
    /// Name of the link and of its joint.
    pub name: String,
    /// Its share of the card's mass, kg.
    pub mass_kg: f64,
    /// How it moves.
    pub joint: JointRecipe,
    /// Its parts, in the object's frame at joint position 0.
    ///
    /// The part by which a hand moves it is named `handle`.
    pub parts: Vec<Part>,
}

/// A joint to the body, its frame parallel to the object's.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointRecipe {
    /// Turning or sliding.
    pub kind: JointKind,
    /// A point of the axis in the object's frame, m.
    pub at: DVec3,
    /// Unit axis.
    pub axis: DVec3,
    /// Smallest and largest position, rad or m.
    pub range: [f64; 2],
    /// Viscous damping, N·s/m or N·m·s/rad.
    pub damping: f64,
    /// Dry friction, N or N·m.
    pub friction_loss: f64,
    /// Spring, N/m or N·m/rad; it carries the link's weight where the engine's dry friction, which creeps, would not.
    #[serde(default)]
    pub stiffness: f64,
    /// Rest position of the spring; far outside the range for a force that is nearly constant.
    #[serde(default)]
    pub spring_reference: f64,
}

/// A named state of an articulated object.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StateRecipe {
    /// Name as on the card.
    pub name: String,
    /// Least, nominal and largest position of each joint, in the order of the links.
    pub joints: Vec<[f64; 3]>,
}

impl Recipe {
    /// The object: the mass of the card less that of the links spread evenly over the body's parts.
    pub fn build(&self, card: &ObjectCard, seed: Seed) -> ObjectModel {
        let body = assemble(&self.parts, seed.fork("part"));
        let body_mass = card.mass_kg - self.links.iter().map(|link| link.mass_kg).sum::<f64>();
        let mut links = vec![body.into_link(ROOT, body_mass, None)];
        links.extend(self.links.iter().map(|link| link.build(seed.fork(&link.name))));
        ObjectModel {
            card: card.clone(),
            family: self.family.clone(),
            asset: card.asset.clone(),
            links,
            friction: self.friction,
            joint_states: self.states.iter().map(|state| self.joint_state(state)).collect(),
        }
    }

    fn joint_state(&self, state: &StateRecipe) -> JointState {
        let intervals = self.links.iter().zip(&state.joints);
        JointState {
            name: state.name.clone(),
            intervals: intervals.map(|(link, &[low, _, high])| (link.name.clone(), [low, high])).collect(),
            nominal: state.joints.iter().map(|joint| joint[1]).collect(),
        }
    }

    /// The room in what stands on the table, where that has one hollow.
    pub fn room(&self) -> Option<Room> {
        let mut cavities = self.parts.iter().filter_map(Part::cavity);
        cavities.next().filter(|_| cavities.next().is_none()).and_then(|cavity| Room::of_cavity(&cavity))
    }

    /// Why the links and states cannot be those of a card, if they cannot.
    pub fn flaw(&self, card: &ObjectCard) -> Option<String> {
        let moving: f64 = self.links.iter().map(|link| link.mass_kg).sum();
        let weightless = self.links.iter().any(|link| link.mass_kg <= 0.0) || moving >= card.mass_kg;
        if !self.links.is_empty() && weightless {
            return Some(format!(
                "links of {moving} kg: expected positive masses below the card's {} kg",
                card.mass_kg
            ));
        }
        let names: Vec<&String> = self.states.iter().map(|state| &state.name).collect();
        if names != card.states.iter().collect::<Vec<_>>() {
            return Some(format!("states {names:?}: expected those of the card, {:?}", card.states));
        }
        let ordered = |[low, nominal, high]: &[f64; 3]| low <= nominal && nominal <= high;
        self.states.iter().find_map(|state| {
            let sound = state.joints.len() == self.links.len() && state.joints.iter().all(ordered);
            (!sound).then(|| {
                format!("state {}: expected [least, nominal, largest] for {} joints", state.name, self.links.len())
            })
        })
    }
}

impl LinkRecipe {
    fn build(&self, seed: Seed) -> ObjectLink {
        let mut link = assemble(&self.parts, seed);
        link.shift(-self.joint.at);
        link.into_link(&self.name, self.mass_kg, Some(self.joint.joint(&self.name)))
    }
}

impl JointRecipe {
    fn joint(&self, name: &str) -> Joint {
        Joint {
            name: name.to_owned(),
            parent: 0,
            kind: self.kind,
            parent_from_joint: Pose::from_position(self.at),
            axis: self.axis.normalize_or(DVec3::Z),
            range: self.range,
            damping: self.damping,
            friction_loss: self.friction_loss,
            stiffness: self.stiffness,
            spring_reference: self.spring_reference,
        }
    }
}
