//! Who touches whom, and how hard.

use std::collections::BTreeMap;
use std::sync::Arc;

use genmanip_core::glam::DVec3;
use mujoco_rs::wrappers::{MjData, MjModel};

use crate::Scene;

/// A body of the scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum BodyId {
    /// The table's slab.
    Table,
    /// The ground beneath.
    Floor,
    /// A link of the robot.
    Robot {
        /// Index in the robot's links.
        link: usize,
    },
    /// A link of an object.
    Object {
        /// Index in the scene's objects.
        object: usize,
        /// Index in the object's links.
        link: usize,
    },
}

/// One contact point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactReport {
    /// One body.
    pub a: BodyId,
    /// The other.
    pub b: BodyId,
    /// Gap, metres; negative is penetration.
    pub distance: f64,
    /// Force along the normal, N.
    pub normal_force: f64,
    /// Where, in the world.
    pub position: DVec3,
    /// Unit normal in the world, from `a` to `b`.
    pub normal: DVec3,
}

impl ContactReport {
    /// The other body, if `body` takes part.
    pub fn other(&self, body: BodyId) -> Option<BodyId> {
        match body {
            _ if body == self.a => Some(self.b),
            _ if body == self.b => Some(self.a),
            _ => None,
        }
    }
}

/// All contacts the engine has just computed.
pub(crate) fn contacts<'a>(
    scene: &'a Scene,
    data: &'a MjData<Arc<MjModel>>,
) -> impl Iterator<Item = ContactReport> + 'a {
    let body_of_geom = scene.model.geom_bodyid();
    data.contact().iter().enumerate().map(move |(index, contact)| {
        let [a, b] = contact.geom.map(|geom| scene.bodies[body_of_geom[geom as usize] as usize]);
        let [x, y, z, ..] = contact.frame;
        ContactReport {
            a,
            b,
            distance: contact.dist,
            normal_force: data.contact_force(index)[0],
            position: DVec3::from_array(contact.pos),
            normal: DVec3::new(x, y, z),
        }
    })
}

/// What the robot touched during one control interval.
#[derive(Debug, Default)]
pub(crate) struct TouchTally {
    /// Largest summed normal force per pair of a robot link and another body, N.
    robot: BTreeMap<(BodyId, BodyId), f64>,
    /// Objects held (touched with force by both fingers) at some physics step, as a sorted list.
    held: Vec<usize>,
    /// The object held at the first physics step.
    held_at_start: Option<usize>,
    steps: usize,
}

/// Less normal force than this is no touch, N; contacts at rest under their margin report exact zeros.
const TOUCH_N: f64 = 1e-3;

impl TouchTally {
    /// Counts the contacts of one physics step.
    pub fn add(&mut self, fingers: [usize; 2], contacts: impl Iterator<Item = ContactReport>) {
        let mut pairs: BTreeMap<(BodyId, BodyId), f64> = BTreeMap::new();
        for contact in contacts {
            let (a, b) = (contact.a.min(contact.b), contact.a.max(contact.b));
            let robot = match (a, b) {
                (BodyId::Robot { .. }, _) => (a, b),
                (_, BodyId::Robot { .. }) => (b, a),
                _ => continue,
            };
            *pairs.entry(robot).or_default() += contact.normal_force;
        }
        let held = held_objects(fingers, &pairs);
        if self.steps == 0 {
            self.held_at_start = held.first().map(|(object, _)| *object);
        }
        self.steps += 1;
        for (object, _) in held {
            if let Err(place) = self.held.binary_search(&object) {
                self.held.insert(place, object);
            }
        }
        for (pair, force) in pairs {
            let largest = self.robot.entry(pair).or_default();
            *largest = largest.max(force);
        }
    }

    /// Index of the object both fingers touched at the first step.
    pub fn grasped(&self) -> Option<usize> {
        self.held_at_start
    }

    /// Largest force between a robot link and anything but a held object; fingers touching each other do not count.
    pub fn stray_force(&self, fingers: [usize; 2]) -> f64 {
        let [first, second] = fingers.map(|link| BodyId::Robot { link });
        self.robot
            .iter()
            .filter(|((robot, other), _)| match other {
                BodyId::Object { object, .. } => !self.held.contains(object),
                BodyId::Robot { .. } => (*robot, *other) != (first.min(second), first.max(second)),
                _ => true,
            })
            .map(|(_, force)| *force)
            .fold(0.0, f64::max)
    }
}

/// Objects both fingers press on, the most firmly held one first.
fn held_objects(fingers: [usize; 2], pairs: &BTreeMap<(BodyId, BodyId), f64>) -> Vec<(usize, f64)> {
    let touched = |link: usize| {
        let mut forces: BTreeMap<usize, f64> = BTreeMap::new();
        for (&(robot, other), &force) in pairs {
            if let (true, BodyId::Object { object, .. }) = (robot == BodyId::Robot { link }, other) {
                *forces.entry(object).or_default() += force;
            }
        }
        forces
    };
    let [first, second] = fingers.map(touched);
    let mut held: Vec<(usize, f64)> = first
        .into_iter()
        .filter_map(|(object, force)| Some((object, force.min(*second.get(&object)?))))
        .filter(|(_, force)| *force > TOUCH_N)
        .collect();
    held.sort_by(|a, b| b.1.total_cmp(&a.1));
    held
}
