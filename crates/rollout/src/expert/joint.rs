//! Motion of articulated joints: grasp or push a link, follow the joint's line or arc, release.

use genmanip_core::glam::DVec3;
use genmanip_core::{Failure, FailureCause, JointKind, Pose, Seed};
use genmanip_layout::articulation::{JointSweep, Sweeper, joint_changes};
use genmanip_layout::{Move, obstacles};
use genmanip_motion::commands;
use genmanip_motion::{AllowedCollisions, Path, PlanningScene};
use genmanip_relations::PosedScene;

use super::{Expert, pick::grasp_direction};

/// Peak speed of the minimum-jerk profile relative to its mean: the largest slope of 10t³ − 15t⁴ + 6t⁵.
const PEAK_SPEED: f64 = 1.875;
/// Minimum lever arm that converts gripper speed to joint speed, metres; closer to the axis, the gripper's rotation
/// limits the speed.
const MIN_LEVER_M: f64 = 0.1;
/// Minimum control steps of a joint motion: a third of a second, below which the arm's drives do not follow.
const MIN_STEPS: f64 = 20.0;
/// Number of samples of the joint path, between which commands are interpolated; 0.01 rad apart for a joint of 2 rad.
const PATH_STATES: usize = 200;
/// Maximum number of times the motion is slowed down by a factor of 1.5, to more than seven times its duration.
const MAX_SLOWDOWNS: usize = 6;
/// Distance by which a pushing finger first backs off, metres: more than the 4 mm it may press in (`joint_lag_m`).
const EASE_M: f64 = 0.006;
/// Shares of the full retreat distance tried in each direction, where space is short. Chosen by hand.
const RETREAT_SHARES: [f64; 2] = [1.0, 0.4];

/// A joint motion in progress, from the contact with the link on.
pub(super) struct Turning {
    /// Contact with the link, and change of the joint.
    pub sweep: JointSweep,
    /// Direction in which the link initially moves at the contact, world frame.
    pub direction: DVec3,
    /// Commands along the joint path.
    commands: Vec<Vec<f32>>,
    /// Number of commands already returned.
    done: usize,
}

/// Plans the motion to the contact, and the joint motion from there on.
pub(super) fn plan(
    expert: &Expert,
    scene: &PosedScene,
    step: &Move,
    arm: &[f64],
    width: f64,
    seed: Seed,
) -> Result<(Vec<Vec<f32>>, Turning), Failure> {
    let name = expert.stage.name(step.object);
    let state = step.state().unwrap_or_default();
    let changes = joint_changes(scene, step.object, state);
    let sweeper = changes
        .first()
        .and_then(|change| Sweeper::new(scene, change, &expert.planner, &expert.settings.joint))
        .ok_or_else(|| Failure { cause: FailureCause::Policy, evidence: format!("{name} has no state {state}") })?;
    let (planner, settings) = (&expert.planner, &expert.settings);
    let occupied = obstacles::around(scene, None);
    let nothing = AllowedCollisions::none();
    // Later tries skip the candidates that earlier tries used.
    let mut skip = expert.tries.saturating_sub(1);
    sweeper.search(arm, &mut |sweep| {
        let contact = &sweep.contact;
        let around =
            PlanningScene { world: &occupied, attached: None, allowed: &nothing, gripper_width: contact.open_width };
        let start = sweep.approach.start().to_vec();
        let reach = planner.plan_joint(&around, arm, &[start], seed.fork("reach")).ok()?;
        let turning = turn(expert, &sweeper, sweep)?;
        if skip > 0 {
            skip -= 1;
            return None;
        }
        let mut commands = expert.reach(&occupied, &reach, width, contact.open_width);
        commands.extend(commands::follow(planner, &sweep.approach, contact.open_width, settings.careful_speed));
        commands.extend(commands::wait(&sweep.config, contact.open_width, settings.rest_steps));
        if contact.hold_width < contact.open_width {
            commands.extend(commands::fingers(
                &sweep.config,
                contact.open_width,
                contact.hold_width,
                settings.close_steps,
            ));
        }
        Some((commands, turning))
    })
}

/// Commands along the whole joint path, at a speed within the limits of gripper and arm. `None` if the arm cannot
/// follow the path, even when slowed down.
fn turn(expert: &Expert, sweeper: &Sweeper, sweep: &JointSweep) -> Option<Turning> {
    let settings = &expert.settings;
    let (direction, lever) = sweeper.velocity(sweep);
    let to = sweeper.end(sweep);
    let length = (to - sweep.change.from).abs();
    let rate = expert.stage.control_rate_hz();
    let duration_s = PEAK_SPEED * length * lever.max(MIN_LEVER_M) / settings.joint_speed;
    let mut count = (duration_s * rate).ceil().max(MIN_STEPS) as usize;
    let fine = sweeper.follow(sweep, to, PATH_STATES)?;
    for _ in 0..MAX_SLOWDOWNS {
        let limits: Vec<f64> =
            expert.stage.robot.arm_joints().map(|joint| joint.max_velocity * settings.careful_speed).collect();
        let peak = PEAK_SPEED * PATH_STATES as f64 / count as f64 * rate;
        let slow_enough = std::iter::once(&sweep.config)
            .chain(&fine)
            .zip(&fine)
            .all(|(a, b)| a.iter().zip(b).zip(&limits).all(|((a, b), limit)| (a - b).abs() * peak <= *limit));
        if slow_enough {
            let commands = (1..=count)
                .map(|step| {
                    let t = step as f64 / count as f64;
                    let along = t * t * t * (10.0 - 15.0 * t + 6.0 * t * t) * PATH_STATES as f64;
                    let (index, share) = (along.floor() as usize, along.fract());
                    let at =
                        |index: usize| if index == 0 { &sweep.config } else { &fine[(index - 1).min(PATH_STATES - 1)] };
                    let arm: Vec<f64> = at(index).iter().zip(at(index + 1)).map(|(a, b)| a + (b - a) * share).collect();
                    commands::command(&arm, sweep.contact.hold_width)
                })
                .collect();
            return Some(Turning { sweep: sweep.clone(), direction, commands, done: 0 });
        }
        count = count * 3 / 2;
    }
    None
}

/// Next commands of a joint motion; `None` at its end, or if the gripper is blocked.
pub(super) fn next(expert: &Expert, turning: &mut Turning, arm: &[f64]) -> Option<Vec<Vec<f32>>> {
    let settings = &expert.settings;
    if let Some(last) = turning.done.checked_sub(1).and_then(|last| turning.commands.get(last)) {
        let wanted: Vec<f64> = last.iter().take(arm.len()).map(|&q| f64::from(q)).collect();
        let lag = expert.planner.tcp_pose(&wanted).position.distance(expert.planner.tcp_pose(arm).position);
        if lag > settings.joint_lag_m {
            return None;
        }
    }
    let end = (turning.done + settings.joint_steps).min(turning.commands.len());
    let next = turning.commands.get(turning.done..end).filter(|next| !next.is_empty())?.to_vec();
    turning.done = end;
    Some(next)
}

/// Opens the gripper, backs off and retreats.
pub(super) fn release(expert: &Expert, scene: &PosedScene, turning: &Turning, arm: &[f64]) -> Vec<Vec<f32>> {
    let (planner, settings) = (&expert.planner, &expert.settings);
    let contact = &turning.sweep.contact;
    let mut commands = commands::wait(arm, contact.hold_width, settings.rest_steps);
    if contact.hold_width < contact.open_width {
        commands.extend(commands::fingers(arm, contact.hold_width, contact.open_width, settings.open_steps));
    }
    let world = obstacles::around(scene, None);
    let nothing = AllowedCollisions::none();
    let around = PlanningScene { world: &world, attached: None, allowed: &nothing, gripper_width: contact.open_width };
    let tcp = planner.tcp_pose(arm);
    let back = backward(scene, turning, &tcp);
    let out =
        [-grasp_direction(&tcp), (back - grasp_direction(&tcp)).normalize_or_zero(), back, DVec3::Z, DVec3::NEG_X];
    // A pushing finger leans on the link: back off before retreating.
    let ease = if contact.gap_m > 0.0 { back * EASE_M } else { DVec3::ZERO };
    let eased = Pose { position: tcp.position + ease, ..tcp };
    let start = planner.ik_near(&eased, arm, settings.joint.max_arm_step_rad).unwrap_or_else(|| arm.to_vec());
    let offsets =
        out.iter().flat_map(|&direction| RETREAT_SHARES.map(|share| direction * settings.joint.approach_m * share));
    let retreat = offsets
        .into_iter()
        .find_map(|offset| planner.straight(&around, &start, &Pose { position: eased.position + offset, ..tcp }).ok());
    if start != arm {
        let ease = Path::polyline(vec![arm.to_vec(), start]);
        commands.extend(commands::follow(planner, &ease, contact.open_width, settings.careful_speed));
    }
    if let Some(path) = retreat {
        commands.extend(commands::follow(planner, &path, contact.open_width, settings.careful_speed));
    }
    commands
}

/// Unit direction away from the link at the tool, against the joint's motion, world frame.
fn backward(scene: &PosedScene, turning: &Turning, tcp: &Pose) -> DVec3 {
    let change = &turning.sweep.change;
    let Some(object) = scene.objects().nth(change.object) else { return DVec3::Z };
    let Some(joint) = object.model.links.get(change.link).and_then(|link| link.joint.as_ref()) else { return DVec3::Z };
    match joint.kind {
        JointKind::Prismatic => -turning.direction,
        JointKind::Revolute => {
            let world_from_joint = object.pose * joint.parent_from_joint;
            let axis = world_from_joint.transform_vector(joint.axis);
            let sign = (turning.sweep.target - change.from).signum();
            -(axis.cross(tcp.position - world_from_joint.position) * sign).normalize_or_zero()
        }
    }
}
