//! Dense reward: the potential of a state, from the progress of the goal's conditions.
//!
//! The difference of potentials between two states shapes the reward (Ng, Harada and Russell, 1999). An episode that
//! ends keeps the potential of its last state, so a policy with a discount below 1 also learns to be quick. The
//! potential of a goal is that of its best alternative: the mean progress of its conditions. A condition that holds
//! counts 1, the first unmet one counts as below, and those after it 0.
//!
//! | condition | progress |
//! |---|---|
//! | relation | reach 0.2, grasp 0.2, lift 0.15, carry 0.35; 0.9 when it is placed and released, 1 when it is at rest |
//! | state of a joint | reach 0.3, motion of the joint 0.6, 1 when it holds |

use genmanip_core::glam::DVec3;
use genmanip_core::{Aabb, Atom, AtomVerdict, ObjectState, Unit};
use genmanip_layout::articulation::joint_changes;
use genmanip_relations::{PosedScene, judge_goal};
use serde::{Deserialize, Serialize};

use crate::{Environment, RolloutError, Stage};

/// Distance scale of reaching and carrying, 1/m: their progress is 1 − tanh(scale · distance). Chosen by hand: half the
/// progress at 11 cm.
const PROXIMITY_PER_M: f64 = 5.0;
/// Height of a full lift, m. Chosen by hand: clear of surrounding objects.
const LIFTED_M: f64 = 0.1;
/// Maximum distance between a reached object's centre and the tool, m. Chosen by hand.
const REACHED_M: f64 = 0.03;
/// Distance (m) that counts as much as one radian of missing joint motion. Chosen by hand.
const PER_RADIAN_M: f64 = 0.1;

/// Part of the task at which an episode succeeds: an easy curriculum.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Milestone {
    /// The tool is within 3 cm of the centre of the goal's first object.
    Reach,
    /// The object is held, 10 cm above its start.
    Lift,
    /// The goal holds.
    #[default]
    Goal,
}

/// Potential of the states of an episode.
#[derive(Clone, Debug)]
pub struct Shaping {
    milestone: Milestone,
    /// Height of each object's centre at the start, m.
    start_height_m: Vec<f64>,
    /// Distance of each condition's joint from its goal at the start, rad or m; by alternative and condition.
    start_joint: Vec<Vec<f64>>,
}

/// Progress of a state towards the goal.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Progress {
    /// Potential of the state, from 0 (no progress) to 1 (goal).
    pub potential: f64,
    /// True if a milestone before the goal is reached.
    pub is_reached: bool,
}

/// Values of a state from which the progress of conditions is computed.
struct Now {
    tool: DVec3,
    scene: PosedScene,
    grasped: Option<usize>,
}

impl Shaping {
    /// Shaping of an episode that starts in the stage's initial state, with success at `milestone`.
    pub fn new(stage: &Stage, milestone: Milestone) -> Self {
        let scene = stage.start();
        let height = |index| scene.center(index).map_or(0.0, |center| center.z);
        let joint = |atom: &Atom| missing_motion(scene, atom).map_or(0.0, |(motion, _)| motion);
        Self {
            milestone,
            start_height_m: (0..scene.objects().len()).map(height).collect(),
            start_joint: stage.goal.alternatives.iter().map(|atoms| atoms.iter().map(joint).collect()).collect(),
        }
    }

    /// Progress of the environment's current state.
    ///
    /// # Errors
    /// If the environment was not reset.
    pub fn progress(&self, environment: &Environment, stage: &Stage) -> Result<Progress, RolloutError> {
        let states: Vec<ObjectState> = environment.objects()?;
        let grasped = environment.frames().last().and_then(|frame| frame.grasped);
        let tool = stage.robot.tcp_pose(&environment.joint_positions()?).position;
        let now = Now { tool, scene: stage.posed(&states), grasped };
        let first = stage.goal.alternatives.first().and_then(|atoms| atoms.first());
        let subject = first.and_then(|atom| now.scene.index_of(atom.subject()));
        let Some(subject) = subject.filter(|_| self.milestone != Milestone::Goal) else {
            let rest = Stage::rest(&states, grasped, environment.settings());
            let verdict = judge_goal(&now.scene, &stage.goal, &rest, &stage.relations);
            let alternatives = verdict.alternatives.iter().enumerate();
            let potentials = alternatives.map(|(number, atoms)| self.alternative(number, atoms, &now));
            return Ok(Progress { potential: potentials.fold(0.0, f64::max), is_reached: false });
        };
        let distance_m = now.distance_m(subject);
        let (is_held, height_m) = (grasped == Some(subject), self.height_m(subject, &now));
        Ok(match self.milestone {
            Milestone::Reach => Progress { potential: proximity(distance_m), is_reached: distance_m <= REACHED_M },
            Milestone::Lift | Milestone::Goal => Progress {
                potential: if is_held { 0.5 + 0.5 * lift(height_m) } else { 0.4 * proximity(distance_m) },
                is_reached: is_held && height_m >= LIFTED_M,
            },
        })
    }

    /// Mean progress of the conditions of an alternative.
    fn alternative(&self, number: usize, atoms: &[AtomVerdict], now: &Now) -> f64 {
        let next = atoms.iter().position(|atom| !atom.holds);
        let done = atoms.iter().filter(|atom| atom.holds).count() as f64;
        let begun = next.map_or(0.0, |next| match &atoms[next].atom {
            Atom::Relation { .. } => self.relation(&atoms[next], now),
            atom @ Atom::State { .. } => {
                let start = self.start_joint.get(number).and_then(|starts| starts.get(next)).copied();
                state(atom, start.unwrap_or_default(), now)
            }
        });
        (done + begun) / atoms.len().max(1) as f64
    }

    fn relation(&self, atom: &AtomVerdict, now: &Now) -> f64 {
        let Some(subject) = now.scene.index_of(atom.atom.subject()) else { return 0.0 };
        let missed: f64 = atom
            .measurements
            .iter()
            .filter(|measured| !measured.met)
            .map(|measured| match measured.unit {
                Unit::Metre => -measured.margin,
                Unit::Radian | Unit::Share => -measured.margin * PER_RADIAN_M,
                // No progress while the object is held or moving.
                Unit::Fact => 0.0,
            })
            .sum();
        let carried = proximity(missed);
        match now.grasped == Some(subject) {
            true => 0.4 + 0.15 * lift(self.height_m(subject, now)).max(carried) + 0.35 * carried,
            false if missed == 0.0 => 0.9,
            false => 0.2 * proximity(now.distance_m(subject)),
        }
    }

    fn height_m(&self, object: usize, now: &Now) -> f64 {
        let start = self.start_height_m.get(object).copied().unwrap_or_default();
        now.scene.center(object).map_or(0.0, |center| center.z - start)
    }
}

impl Now {
    /// Distance of the tool from an object's centre, m.
    fn distance_m(&self, object: usize) -> f64 {
        self.scene.center(object).map_or(f64::INFINITY, |center| center.distance(self.tool))
    }
}

/// Progress of a state condition that does not hold.
fn state(atom: &Atom, start: f64, now: &Now) -> f64 {
    let Some((motion, handle)) = missing_motion(&now.scene, atom) else { return 0.9 };
    let moved = if start > 0.0 { (1.0 - motion / start).clamp(0.0, 1.0) } else { 0.0 };
    0.3 * proximity(handle.distance(now.tool)) + 0.6 * moved
}

/// Sum of the missing joint motions of a state condition, rad or m, and the centre of the first link that must move.
/// `None` if the object has no such state.
fn missing_motion(scene: &PosedScene, atom: &Atom) -> Option<(f64, DVec3)> {
    let Atom::State { object, state } = atom else { return None };
    let object = scene.index_of(object)?;
    let changes = joint_changes(scene, object, state);
    let link = changes.first()?.link;
    let motion = changes.iter().map(|change| (change.targets[0] - change.from).abs()).sum();
    let posed = scene.objects().nth(object)?;
    let object_from_link = *posed.model.link_poses(&posed.joint_positions).get(link)?;
    let bounds = Aabb::from_pieces(&object_from_link, &posed.model.links.get(link)?.pieces);
    Some((motion, posed.pose.transform_point(bounds.center())))
}

fn proximity(distance_m: f64) -> f64 {
    1.0 - (PROXIMITY_PER_M * distance_m).tanh()
}

fn lift(height_m: f64) -> f64 {
    (height_m / LIFTED_M).clamp(0.0, 1.0)
}
