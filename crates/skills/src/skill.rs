//! Skill files: the motion of one take, relative to what it moved.

use genmanip_core::glam::DVec3;
use genmanip_core::limits::Limit;
use genmanip_core::{AssetRef, Document, DocumentError, EpisodeSource, JointKind, Pose, Relation, Seed, named_enum};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A skill: the motion of the hand in one episode, cut into segments and stored relative to the handle of the moving
/// link.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Skill {
    /// Name, usable as a file name.
    pub name: String,
    /// Kind of manipulation; a skill serves only goals of its own kind.
    pub verb: Verb,
    /// Episode that the skill was cut from.
    pub source: SkillSource,
    /// Segments of the episode.
    pub segments: Segments,
    /// Fingers during the manipulation.
    pub grip: Grip,
    /// Motion of the hand that moves a joint; absent for a pick and place.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub motion: Option<JointMotion>,
    /// Motion of the hand of a pick and place; absent for a joint.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub carry: Option<CarryMotion>,
}

named_enum! {
    /// Kinds of manipulation.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
    #[serde(rename_all = "snake_case")]
    pub enum Verb {
        /// Opens a drawer or a door.
        Pull = "pull",
        /// Closes a drawer, a door or a lid.
        Push = "push",
        /// Turns a knob or a lever.
        Turn = "turn",
        /// Opens a lid.
        Lift = "lift",
        /// Presses a button.
        Press = "press",
        /// Picks an object up and places it.
        PickAndPlace = "pick_and_place",
    }
}

/// Origin of a skill.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SkillSource {
    /// Id of the episode.
    pub episode: String,
    /// Hash of the episode's record, see `genmanip.episode`'s manifest.
    pub record_hash: String,
    /// Id of its scenario.
    pub scenario: String,
    /// Name of the policy that acted.
    pub policy: String,
    /// Source of the commands, where it was neither a policy nor the expert.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub operator: Option<EpisodeSource>,
    /// Seed of the episode.
    pub seed: Seed,
    /// Object that was manipulated.
    pub object: AssetRef,
    /// Family of that object, e.g. `drawer cabinet`.
    pub family: String,
    /// Control rate of the episode, Hz.
    pub control_rate_hz: f64,
    /// Version of the program that cut the skill.
    pub genmanip_version: String,
}

/// Segments of an episode, each as first control step and the one after its last.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Segments {
    /// Free motion towards the handle, without contact.
    pub approach: [usize; 2],
    /// In contact, before the joint moves.
    pub contact: [usize; 2],
    /// The joint moves.
    pub manipulate: [usize; 2],
    /// Still in contact, at rest.
    pub release: [usize; 2],
    /// Free motion away from the object.
    pub retreat: [usize; 2],
}

/// Fingers during the manipulation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum Grip {
    /// The fingers close on the object once the hand has arrived, and open before it leaves.
    Grasp {
        /// Measured opening while holding, m.
        width_m: f64,
        /// Difference between measured and commanded opening while holding, m.
        squeeze_m: f64,
    },
    /// The fingers keep their opening.
    Fixed {
        /// Opening, m.
        width_m: f64,
    },
}

/// Motion of the hand that moves a joint, in the frame of the moving link's handle: origin at the centre of the
/// handle's bounds, axes of the link.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct JointMotion {
    /// Kind of the joint.
    pub joint: JointKind,
    /// Named states of the object at the start and at the end.
    pub states: [String; 2],
    /// Position of the joint at the start, and when the hand released it, rad or m.
    pub from_to: [f64; 2],
    /// Nominal position of the joint in the state at the end, rad or m.
    pub nominal: f64,
    /// Half of the handle's size along the axes of its frame, m.
    #[schemars(with = "[f64; 3]")]
    pub handle_half_m: DVec3,
    /// `handle_from_tcp` before the contact, evenly spaced along the way, the last one at the contact.
    pub approach: Vec<Pose>,
    /// `handle_from_tcp` at equal shares of the joint's travel, from 0 to 1.
    pub along: Vec<Pose>,
    /// `handle_from_tcp` after the contact, evenly spaced along the way, with the joint at the end of its travel.
    pub retreat: Vec<Pose>,
}

impl JointMotion {
    /// Travel of the joint under the hand as a share of that to the nominal position.
    pub fn travelled(&self) -> f64 {
        let [from, to] = self.from_to;
        (to - from) / (self.nominal - from)
    }
}

/// Motion of the hand that picks an object up and places it. Frame *centre*: origin at the centre of the object's bounds,
/// axes of the object.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CarryMotion {
    /// Relation of the object to the one that it was placed on or in.
    pub relation: Relation,
    /// Object that it was placed on or in.
    pub reference: AssetRef,
    /// Half of the object's size along its own axes, m.
    #[schemars(with = "[f64; 3]")]
    pub object_half_m: DVec3,
    /// `centre_from_tcp` before the contact, relative to the object where it lay, evenly spaced; the last one is the
    /// grasp.
    pub approach: Vec<Pose>,
    /// Object in the frame where its centre lay, from there on, evenly spaced.
    pub lift: Vec<Pose>,
    /// Object in the frame where its centre rests at the end, evenly spaced, up to the release.
    pub lower: Vec<Pose>,
    /// `centre_from_tcp` after the release, relative to the object where it rests at the end, evenly spaced.
    pub retreat: Vec<Pose>,
}

/// Smallest and largest share of the travel to the nominal position that the hand moves a joint.
const MIN_TRAVELLED: f64 = 0.3;
const MAX_TRAVELLED: f64 = 2.0;
/// Most poses of a part of a motion.
const MAX_POSES: usize = 200;
/// Largest distance of the hand from the handle, m.
const MAX_DISTANCE_M: f64 = 5.0;

impl Skill {
    /// True if the skill is of a kind of manipulation and moves a joint of a kind.
    pub fn serves_joint(&self, verb: Verb, joint: Option<JointKind>) -> bool {
        self.verb == verb && self.motion.as_ref().is_some_and(|motion| Some(motion.joint) == joint)
    }

    /// Largest size of a file.
    pub const LIMIT: Limit = Limit { what: "a skill", bytes: 1 << 20 };
}

impl Document for Skill {
    const SCHEMA: &'static str = "genmanip.skill/1";

    fn check(&self) -> Result<(), DocumentError> {
        let refuse = |path: &str, message: String| Err(DocumentError::Invalid { path: path.into(), message });
        if !genmanip_core::names::is_file_name(&self.name) {
            let got: String = self.name.chars().take(80).collect();
            return refuse("$.name", format!("expected a file name (letters, digits, any of -_.+=@), got {got:?}"));
        }
        let parts = match (&self.motion, &self.carry) {
            (Some(motion), None) => vec![
                ("motion.approach", &motion.approach, 1),
                ("motion.along", &motion.along, 2),
                ("motion.retreat", &motion.retreat, 0),
            ],
            (None, Some(carry)) => vec![
                ("carry.approach", &carry.approach, 1),
                ("carry.lift", &carry.lift, 2),
                ("carry.lower", &carry.lower, 1),
                ("carry.retreat", &carry.retreat, 0),
            ],
            _ => return refuse("$", "expected either `motion` or `carry`".into()),
        };
        if self.carry.is_some() != (self.verb == Verb::PickAndPlace) {
            return refuse("$.verb", format!("expected {} with `carry` alone", Verb::PickAndPlace.name()));
        }
        for (part, poses, least) in parts {
            let path = format!("$.{part}");
            if !(least..=MAX_POSES).contains(&poses.len()) {
                return refuse(&path, format!("expected {least} to {MAX_POSES} poses, got {}", poses.len()));
            }
            if let Some(wrong) = poses.iter().position(|pose| pose.position.length() > MAX_DISTANCE_M) {
                return refuse(&format!("{path}[{wrong}]"), format!("expected at most {MAX_DISTANCE_M} m"));
            }
        }
        if let Some(motion) = &self.motion {
            let [from, to] = motion.from_to;
            if !(from.is_finite() && to.is_finite() && from != to) {
                return refuse("$.motion.from_to", format!("expected two different numbers, got {from} and {to}"));
            }
            if !(MIN_TRAVELLED..=MAX_TRAVELLED).contains(&motion.travelled()) {
                let message = format!("expected a position that `from_to` nearly reaches, got {}", motion.nominal);
                return refuse("$.motion.nominal", message);
            }
        }
        let widths = match self.grip {
            Grip::Grasp { width_m, squeeze_m } => [width_m, squeeze_m],
            Grip::Fixed { width_m } => [width_m, 0.0],
        };
        match widths.iter().find(|width| !(0.0..=1.0).contains(*width)) {
            Some(width) => refuse("$.grip", format!("expected 0 to 1 m, got {width}")),
            None => Ok(()),
        }
    }
}
