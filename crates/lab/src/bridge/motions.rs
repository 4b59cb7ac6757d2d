//! Planned motions on the arm behind a running bridge: where they end.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use genmanip_core::Seed;
use genmanip_motion::PlannerSettings;
use genmanip_pipeline::plan::{MotionRequest, Target, plan};
use genmanip_real::bridge::State;
use genmanip_real::bridge::client::{ArmClient, BridgeError, ClientSettings, Tally, TcpConnection};
use genmanip_workspace::{WorkspaceError, scenarios, worlds};
use rand::RngExt;
use serde::Serialize;

use crate::Spread;
use crate::clock::cpu_clock;

/// Planned motions on the arm behind a bridge: where they end.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Motions {
    /// Name of the robot.
    pub robot: String,
    /// Number of motions.
    pub count: usize,
    /// Distance of the tool at the end from the planned end, mm.
    pub end_mm: Spread,
    /// Largest such distance, mm.
    pub worst_mm: f64,
    /// Largest angle of the tool at the end to the planned end, degrees.
    pub worst_deg: f64,
    /// Counts of commands, refusals and stops.
    pub tally: Tally,
}

impl Motions {
    /// The measurement in words.
    pub fn text(&self) -> String {
        format!(
            "{} motions of {}: they end {} mm from the plan (median / 95th percentile), {:.2} mm and {:.2} degrees at \
             most; {} stops of the arm, {} refused commands\n",
            self.count,
            self.robot,
            self.end_mm.text(1.0),
            self.worst_mm,
            self.worst_deg,
            self.tally.arm_stops,
            self.tally.refused.values().sum::<usize>()
        )
    }

    /// Flaws in words; empty if every motion ended within 5 mm and 2 degrees of its plan, without a stop of the arm and
    /// without a refused command; one that a newer one has overtaken on its way is none.
    pub fn flaws(&self) -> Vec<String> {
        let ends = format!("motions end up to {:.2} mm and {:.2} degrees from the plan", self.worst_mm, self.worst_deg);
        let (stops, refused) = (self.tally.arm_stops, &self.tally.refused);
        let is_sound = stops == 0 && refused.keys().all(|word| word == "sequence");
        let checks = [
            (self.worst_mm <= 5.0 && self.worst_deg <= 2.0, format!("{ends}; expected 5 mm and 2 degrees")),
            (
                is_sound,
                format!("{stops} stops of the arm, refused commands: {refused:?}; expected none but overtaken ones"),
            ),
        ];
        checks.into_iter().filter(|(is_right, _)| !is_right).map(|(_, text)| text).collect()
    }
}

/// Ranges of the joints around the home position in which goals of motions are drawn, rad.
const GOAL_RANGE_RAD: f64 = 0.5;
/// Time for the arm to come to rest after a motion, s.
const REST_S: f64 = 0.7;

/// Longest time to wait beyond that until the arm is measured at rest, s.
const LONGEST_REST_S: f64 = 5.0;
/// Measured velocity of a joint that counts as rest, rad/s.
const REST_RAD_S: f64 = 2e-3;

/// True if the setpoints have reached an end of a motion and the arm is measured at rest.
fn is_at_rest(state: &State, end: &[f64]) -> bool {
    state.setpoints.iter().zip(end).all(|(at, end)| (at - end).abs() < 1e-6)
        && state.velocities.iter().all(|velocity| velocity.abs() < REST_RAD_S)
}

/// Streams planned motions between random joint positions to the bridge at an address.
///
/// # Errors
/// If the bridge cannot be reached, or its robot is not known.
pub fn measure(url: &str, count: usize, seed: Seed) -> Result<Motions, WorkspaceError> {
    let failed = |error: BridgeError| WorkspaceError::input(error.to_string());
    let held = Arc::new(AtomicBool::new(true));
    let connection = TcpConnection::open(url).map_err(failed)?;
    let mut client = ArmClient::connect(connection, ClientSettings::default(), held).map_err(failed)?;
    let robot = client.welcome().robot.clone();
    let stage = scenarios::empty_stage(worlds::read_world_with(None, Some(&robot))?)?;
    let planner = worlds::planner(&stage.scenario.world, &PlannerSettings::default())?;
    let width_m = stage.robot.gripper.max_width;
    let rng = &mut seed.fork("motions").rng();
    let (mut found, mut ends_mm) = (Motions { robot, ..Motions::default() }, Vec::new());
    // Goals that the planner refuses, such as in the table, are drawn again.
    for attempt in 0..4 * count as u64 {
        if ends_mm.len() == count {
            break;
        }
        let near = |q: &f64| q + rng.random_range(-GOAL_RANGE_RAD..GOAL_RANGE_RAD);
        let goal: Vec<f64> = stage.robot.home.iter().map(near).collect();
        let from = Some(client.state().positions.clone());
        let request = MotionRequest { target: Target::Joints(goal), from, gripper_width_m: width_m };
        let motion = plan(&stage, &planner, &request, seed.fork_index(attempt), &mut cpu_clock())?;
        let Some(end) = motion.trajectory.last().filter(|_| motion.solved) else { continue };
        let mut next_s = client.now_s();
        let hold = std::iter::repeat_n(end, (REST_S / motion.dt_s) as usize);
        for positions in motion.trajectory.iter().chain(hold) {
            client.command(positions, width_m).map_err(failed)?;
            next_s += motion.dt_s;
            client.wait(next_s).map_err(failed)?;
        }
        // An arm whose clock is slower than ours, as a simulated one's on a busy machine, comes to rest later.
        let until_s = client.now_s() + LONGEST_REST_S;
        while !is_at_rest(client.state(), end) && client.now_s() < until_s {
            client.command(end, width_m).map_err(failed)?;
            client.wait(client.now_s() + motion.dt_s).map_err(failed)?;
        }
        let (wanted, got) = (stage.robot.tcp_pose(end), stage.robot.tcp_pose(&client.state().positions));
        ends_mm.push(1e3 * wanted.position.distance(got.position));
        found.worst_deg = found.worst_deg.max(wanted.rotation.angle_between(got.rotation).to_degrees());
    }
    client.release().map_err(failed)?;
    found.count = ends_mm.len();
    found.worst_mm = ends_mm.iter().copied().fold(0.0, f64::max);
    found.end_mm = Spread::of(ends_mm);
    found.tally = client.tally().clone();
    Ok(found)
}
