//! Initial scenes: one object, its pose and its joints drawn from ranges.

use std::sync::Arc;

use genmanip_core::glam::{DQuat, DVec3};
use genmanip_core::{JointState, Pose, Relation, Scenario, Seed};
use genmanip_rollout::Stage;
use genmanip_rollout::collect::{Attempt, PipelineSettings, Resources};
use genmanip_skills::Verb;
use genmanip_skills::tasks::{place_task, state_task};
use rand::RngExt;
use serde::Serialize;

use crate::LabError;

/// Ranges of initial scenes, called D0, D1 and D2 as in published comparisons.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ResetRange {
    /// Name.
    pub name: &'static str,
    /// Largest offsets of the object from its nominal place, to the front and to the side, m.
    pub offset_m: [f64; 2],
    /// Largest rotation of the object about the vertical, from facing the robot, rad.
    pub yaw_rad: f64,
    /// True if the joint starts anywhere in the initial state's interval, false if at its nominal position.
    pub joint_varies: bool,
}

/// All ranges.
pub const RANGES: [ResetRange; 3] = [
    ResetRange { name: "D0", offset_m: [0.02, 0.03], yaw_rad: 0.1, joint_varies: false },
    ResetRange { name: "D1", offset_m: [0.04, 0.1], yaw_rad: 0.3, joint_varies: true },
    ResetRange { name: "D2", offset_m: [0.06, 0.2], yaw_rad: 0.6, joint_varies: true },
];

/// Objects, states and place on which a skill is measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SkillCase {
    /// Kind of manipulation.
    pub verb: Verb,
    /// Prefix of the instances' uids; the first one is that of the sources.
    pub family: &'static str,
    /// Numbers of the instances in the catalogue.
    pub instances: &'static [u32],
    /// Initial state and goal state.
    pub states: [&'static str; 2],
    /// Nominal distance of the object from the robot's base, m.
    pub distance_m: f64,
    /// Object on which the manipulated one is placed, by its uid; empty for a change of state.
    pub under: &'static str,
}

/// Nominal places of the carried object and of the one beneath, to the left of the robot, m.
const SIDES_M: [f64; 2] = [0.2, -0.22];
/// Share of a range's offsets by which the object beneath moves.
const UNDER_SHARE: f64 = 0.25;

/// The families of each skill.
const CASES: [SkillCase; 6] = [
    SkillCase {
        verb: Verb::Pull,
        family: "drawer-cabinet",
        instances: &[1, 2, 3, 4, 5, 6, 7, 8, 9, 10],
        states: ["closed", "top_open"],
        distance_m: 0.6,
        under: "",
    },
    SkillCase {
        verb: Verb::Push,
        family: "drawer-cabinet",
        instances: &[1, 2, 3, 4, 5, 6, 7, 8, 9, 10],
        states: ["top_open", "closed"],
        distance_m: 0.6,
        under: "",
    },
    SkillCase {
        verb: Verb::Turn,
        family: "stove-knob",
        instances: &[1, 2, 3, 4, 5, 6, 7, 8, 9],
        states: ["off", "low"],
        distance_m: 0.5,
        under: "",
    },
    SkillCase {
        verb: Verb::Lift,
        family: "hinged-lid-box",
        instances: &[1, 2, 3, 4, 5, 6, 7, 8, 9],
        states: ["closed", "open"],
        distance_m: 0.5,
        under: "",
    },
    SkillCase {
        verb: Verb::Press,
        family: "push-button",
        instances: &[1, 2, 3, 4, 5, 6, 7, 8, 9],
        states: ["released", "pressed"],
        distance_m: 0.5,
        under: "",
    },
    SkillCase {
        verb: Verb::PickAndPlace,
        family: "mug",
        instances: &[1, 2, 3, 4, 5, 7, 8, 9, 10],
        states: ["", ""],
        distance_m: 0.5,
        under: "008",
    },
];

/// The case of a kind of manipulation.
pub fn case_of(verb: Verb) -> Result<&'static SkillCase, LabError> {
    CASES.iter().find(|case| case.verb == verb).ok_or_else(|| LabError::input(format!("no scenes to {}", verb.name())))
}

/// Layout of an instance, alone on the table or with the object that it is placed on; resets move them.
pub fn base(
    case: &SkillCase,
    instance: u32,
    resources: Resources,
    settings: &PipelineSettings,
) -> Result<Scenario, LabError> {
    let uid = format!("{}-{instance}", case.family);
    let card = |uid: &str| {
        let card = resources.catalogue.cards().iter().find(|card| card.uid == *uid);
        card.ok_or_else(|| LabError::input(format!("the catalogue has no object {uid}")))
    };
    let task = match case.under {
        "" => state_task(card(&uid)?, case.states[0], case.states[1]),
        under => place_task(card(&uid)?, Relation::On, card(under)?),
    };
    let attempt = Attempt { task: &task, number: 0, seed: Seed::new(0).fork(&uid) };
    attempt
        .scenario(resources, &settings.world, &settings.layout)
        .map_err(|error| LabError::broken(format!("{uid} cannot be laid out"), error))
}

/// Scene with the object moved within a range.
pub fn reset(
    base: &Scenario,
    case: &SkillCase,
    range: &ResetRange,
    id: String,
    seed: Seed,
    resources: Resources,
) -> Result<Stage, LabError> {
    let mut rng = seed.fork("reset").rng();
    let mut draw = |most: f64| rng.random_range(-1.0..=1.0) * most;
    let [dx, dy] = range.offset_m;
    let side_m = if case.under.is_empty() { 0.0 } else { SIDES_M[0] };
    let (x, y) = (case.distance_m + draw(dx), side_m + draw(dy));
    let yaw = y.atan2(x) + draw(range.yaw_rad);
    let (under_x, under_y) = (case.distance_m + draw(dx) * UNDER_SHARE, SIDES_M[1] + draw(dy) * UNDER_SHARE);
    let share = if range.joint_varies { 0.5 + draw(0.5) } else { f64::NAN };
    let mut scenario = Scenario { id, seed, ..base.clone() };
    if let Some(under) = scenario.objects.get_mut(1) {
        under.pose.position = DVec3::new(under_x, under_y, under.pose.position.z);
    }
    let placed = &mut scenario.objects[0];
    placed.pose = Pose::new(DVec3::new(x, y, placed.pose.position.z), DQuat::from_rotation_z(yaw));
    let model =
        resources.catalogue.instance(placed).map_err(|error| LabError::broken("an object cannot be built", error))?;
    let state = model.joint_states.iter().find(|state| state.name == case.states[0]);
    let moving = model.links.iter().filter_map(|link| Some((link, link.joint.as_ref()?)));
    for (index, (link, joint)) in moving.enumerate() {
        let interval = |state: &&JointState| state.intervals.iter().position(|(name, _)| *name == link.name);
        let Some((state, at)) = state.and_then(|state| Some((state, interval(&state)?))) else { continue };
        let [low, high] = state.intervals[at].1;
        let (low, high) = (low.max(joint.range[0]), high.min(joint.range[1]));
        // The middle half of the interval, where the state surely holds.
        let varied = low + (high - low) * (0.25 + 0.5 * share);
        placed.joint_positions[index] = if range.joint_varies { varied } else { state.nominal[at] };
    }
    Stage::open(Arc::new(scenario), resources.catalogue, resources.planner.robot())
        .map_err(|error| LabError::broken("a scene cannot be opened", error))
}
