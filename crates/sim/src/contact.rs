//! Contact reports, grasp detection and stray-contact forces.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use genmanip_core::glam::DVec3;
use mujoco_rs::wrappers::{MjData, MjModel};

use crate::Model;
use crate::body::BodyId;

/// Contact point of two bodies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactReport {
    /// First body.
    pub a: BodyId,
    /// Second body.
    pub b: BodyId,
    /// Signed distance, metres; negative for penetration.
    pub distance: f64,
    /// Normal force, N, at least 0.
    pub normal_force: f64,
    /// Contact position in the world.
    pub position: DVec3,
    /// Unit normal in the world, from `a` to `b`.
    pub normal: DVec3,
}

impl ContactReport {
    /// Normal force on the robot by a body that is not part of it, N, in the world; `None` for other contacts.
    pub(crate) fn force_on_robot(&self) -> Option<DVec3> {
        match (self.a, self.b) {
            (BodyId::Robot { .. }, BodyId::Robot { .. }) => None,
            (BodyId::Robot { .. }, _) => Some(-self.normal * self.normal_force),
            (_, BodyId::Robot { .. }) => Some(self.normal * self.normal_force),
            _ => None,
        }
    }

    /// The partner of `body` in this contact; `None` if `body` takes no part in it.
    pub fn other(&self, body: BodyId) -> Option<BodyId> {
        match body {
            _ if body == self.a => Some(self.b),
            _ if body == self.b => Some(self.a),
            _ => None,
        }
    }
}

/// Contacts of the engine's current state.
pub(crate) fn contacts<'a>(
    scene: &'a Model,
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

/// A gripper finger at one physics step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Finger {
    /// Index of the finger's link in the robot's links.
    pub link: usize,
    /// Closing direction, unit vector in the world.
    pub closing: DVec3,
}

/// Robot contacts accumulated over one control interval.
#[derive(Debug, Default)]
pub(crate) struct TouchTally {
    /// Peak force per pair of robot link and other body, N; stray unless that body is held.
    stray: BTreeMap<(BodyId, BodyId), f64>,
    /// Objects pressed by both fingers at some physics step.
    held: BTreeSet<usize>,
    /// Most firmly held object at the first physics step; `None` if none is held.
    held_at_start: Option<usize>,
    steps: usize,
}

/// Smallest normal force that counts as touching, N. Chosen by hand.
const TOUCH_N: f64 = 1e-3;
/// Smallest cosine (45°) between contact normal and closing direction for a finger to press on an object.
const CLOSING_COSINE: f64 = std::f64::consts::FRAC_1_SQRT_2;

impl TouchTally {
    /// Adds the contacts of one physics step; `hand` is the link that carries the fingers.
    pub fn add(&mut self, fingers: [Finger; 2], hand: usize, contacts: impl Iterator<Item = ContactReport>) {
        let mut stray: BTreeMap<(BodyId, BodyId), f64> = BTreeMap::new();
        let mut pressed: [BTreeMap<usize, f64>; 2] = Default::default();
        for contact in contacts {
            // Order each pair as (robot, other); of two robot links, the lower index first.
            let (robot, other, towards_other) = match (contact.a, contact.b) {
                (BodyId::Robot { link: a }, BodyId::Robot { link: b }) if a > b => {
                    (contact.b, contact.a, -contact.normal)
                }
                (BodyId::Robot { .. }, _) => (contact.a, contact.b, contact.normal),
                (_, BodyId::Robot { .. }) => (contact.b, contact.a, -contact.normal),
                _ => continue,
            };
            let finger = fingers.iter().position(|finger| robot == BodyId::Robot { link: finger.link });
            let mut grasping = false;
            if let Some(finger) = finger {
                grasping = towards_other.dot(fingers[finger].closing) > CLOSING_COSINE;
                match other {
                    BodyId::Object { object, .. } => {
                        *pressed[finger].entry(object).or_default() += contact.normal_force
                    }
                    BodyId::Robot { link } => grasping |= fingers.iter().any(|finger| finger.link == link),
                    BodyId::Table | BodyId::Surface { .. } | BodyId::Floor => grasping = false,
                }
            }
            // Drawers, doors and buttons are meant to be moved by the gripper from any side.
            let gripper = finger.is_some() || robot == BodyId::Robot { link: hand };
            grasping |= gripper && matches!(other, BodyId::Object { link: 1.., .. });
            if !grasping {
                *stray.entry((robot, other)).or_default() += contact.normal_force;
            }
        }
        let [first, second] = pressed;
        let firmness = |object: &usize| first[object].min(second.get(object).copied().unwrap_or(0.0));
        let held: Vec<usize> = first.keys().copied().filter(|object| firmness(object) > TOUCH_N).collect();
        if self.steps == 0 {
            self.held_at_start = held.iter().copied().max_by(|a, b| firmness(a).total_cmp(&firmness(b)));
        }
        self.steps += 1;
        self.held.extend(held);
        for (pair, force) in stray {
            let largest = self.stray.entry(pair).or_default();
            *largest = largest.max(force);
        }
    }

    /// Index of the object pressed by both fingers at the first step, the most firmly held one if there are several;
    /// `None` without one.
    pub fn grasped(&self) -> Option<usize> {
        self.held_at_start
    }

    /// Peak stray force, N, and its two bodies, the robot link first; `None` without stray contact.
    ///
    /// Excludes held objects, whichever robot link they touch, and the gripper on a moving link of an articulated
    /// object.
    pub fn stray(&self) -> Option<(f64, [BodyId; 2])> {
        let is_held = |body: &BodyId| matches!(body, BodyId::Object { object, .. } if self.held.contains(object));
        let pairs = self.stray.iter().filter(|((_, other), _)| !is_held(other));
        pairs.map(|(&(link, other), &force)| (force, [link, other])).max_by(|a, b| a.0.total_cmp(&b.0))
    }
}
