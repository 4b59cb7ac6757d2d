//! Recipes: parts and joints of an object as data.

use genmanip_core::{CavitySize, Joint, JointKind, JointState, ObjectCard, ObjectLink, ObjectModel, Pose, Seed};
use glam::DVec3;
use serde::Deserialize;

use crate::parts::{Part, assemble};

/// Name of every object's root link.
const ROOT: &str = "body";

/// Object as a list of parts in the object's frame.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// Family of the object, e.g. `mug`.
    pub family: String,
    /// Sliding friction coefficient against a surface of the same kind.
    pub friction: f64,
    /// Parts of the root link, with collision and visual geometry.
    pub parts: Vec<Part>,
    /// Moving links; empty for a rigid object.
    #[serde(default)]
    pub links: Vec<LinkRecipe>,
    /// Joint intervals of the states that the card names.
    #[serde(default)]
    pub states: Vec<StateRecipe>,
}

/// Moving link: drawer, door, lid, lever, dial or button.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LinkRecipe {
    /// Name of the link and of its joint.
    pub name: String,
    /// Mass of the link, kg; part of the card's total mass.
    pub mass_kg: f64,
    /// Joint to the root link.
    pub joint: JointRecipe,
    /// Parts in the object's frame at joint position 0.
    ///
    /// The gripper moves the link by the part named `handle`.
    pub parts: Vec<Part>,
}

/// Joint between a link and the root link; its frame is parallel to the object's frame.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointRecipe {
    /// Joint type: revolute or prismatic.
    pub kind: JointKind,
    /// Point on the axis in the object's frame, m.
    pub at: DVec3,
    /// Unit vector of the axis in the object's frame.
    pub axis: DVec3,
    /// Smallest and largest position, rad or m.
    pub range: [f64; 2],
    /// Viscous damping, N·s/m or N·m·s/rad.
    pub damping: f64,
    /// Dry (Coulomb) friction, N or N·m.
    pub friction_loss: f64,
    /// Spring stiffness, N/m or N·m/rad. The spring carries the link's weight, since a joint held by the engine's dry
    /// friction alone creeps.
    #[serde(default)]
    pub stiffness: f64,
    /// Rest position of the spring, rad or m; far outside the range for a nearly constant force.
    #[serde(default)]
    pub spring_reference: f64,
}

/// Named state of an articulated object.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StateRecipe {
    /// Name of the state as on the card.
    pub name: String,
    /// Smallest, nominal and largest position of each joint, in link order, rad or m.
    pub joints: Vec<[f64; 3]>,
}

impl Recipe {
    /// Builds the object; the card's mass minus that of the links is spread uniformly over the root link's parts.
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

    /// Size of the root link's cavity; `None` unless it has exactly one.
    pub fn room(&self) -> Option<CavitySize> {
        let mut cavities = self.parts.iter().filter_map(Part::cavity);
        cavities.next().filter(|_| cavities.next().is_none()).and_then(|cavity| CavitySize::of_cavity(&cavity))
    }

    /// Reason why links and states do not match a card; `None` if they do.
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
