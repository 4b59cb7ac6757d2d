//! A policy without ground truth: finds red in one RGB-D image, and acts in tcp poses through the adapter.

use genmanip_assets::Catalogue;
use genmanip_core::glam::{DMat3, DQuat, DVec2, DVec3};
use genmanip_core::{
    ActionChunk, ActionSpace, ActionSpec, Atom, CameraRequest, EpisodeStart, Failure, FailureCause, Goal, GraphNode,
    GripperEncoding, GripperSpec, ImageChannels, Observation, Policy, PolicyError, PolicySpec, Relation,
    RotationEncoding, SceneGraph, Seed, Task, TaskKind,
};
use genmanip_rollout::{RolloutSettings, run_episode};

use crate::{scenario, stage};

/// Action rate, Hz; the steps below are per action.
const RATE_HZ: f64 = 15.0;
/// Maximum step of the tool between two actions, m and rad: 0.3 m/s, 1.2 rad/s.
const STEP_M: f64 = 0.02;
const STEP_RAD: f64 = 0.08;
/// Travel height above the object and the goal, m.
const ABOVE_M: f64 = 0.12;
/// Height range of board points, m: above the table's noise, below a cube.
const BOARD_M: [f64; 2] = [0.008, 0.02];
/// Actions for opening or closing the gripper.
const FINGER_ACTIONS: usize = 15;

/// Moves the reddest object onto the board, as seen by the camera before the first step.
struct RedPixel {
    camera: &'static str,
    /// Initial tool pose; known here, reported by the first observation of a real robot.
    home: (DVec3, DQuat),
}

/// One action: tcp pose, and 1 for closed, -1 for open.
type Waypoint = (DVec3, DQuat, f32);

impl Policy for RedPixel {
    fn spec(&self) -> PolicySpec {
        let action = ActionSpec {
            rotation: RotationEncoding::SixD,
            gripper: GripperSpec { encoding: GripperEncoding::PlusOneClosed, binary_threshold: Some(0.0) },
            ..ActionSpec::new(ActionSpace::EePose, GripperEncoding::PlusOneClosed)
        };
        let channels = ImageChannels { points: true, ..ImageChannels::RGBD };
        PolicySpec {
            cameras: vec![CameraRequest::new(self.camera, channels)],
            action,
            ..PolicySpec::native("red_pixel", RATE_HZ)
        }
    }

    fn reset(&mut self, start: &EpisodeStart) -> Result<(), PolicyError> {
        assert!(start.scenario.is_none(), "it receives only the instruction");
        Ok(())
    }

    fn act(&mut self, observation: &Observation) -> Result<ActionChunk, PolicyError> {
        assert!(observation.privileged.is_none());
        let image = &observation.images[self.camera];
        let seen: Vec<([u8; 3], DVec3)> = image
            .rgb
            .chunks_exact(3)
            .zip(&image.points_m)
            .map(|(rgb, point)| ([rgb[0], rgb[1], rgb[2]], DVec3::from_array(point.map(f64::from))))
            .filter(|(_, point)| point.is_finite() && point.x > 0.25 && point.z > 0.004)
            .collect();
        let red = |rgb: &[u8; 3]| i32::from(rgb[0]) - i32::from(rgb[1].max(rgb[2]));
        let reddest = seen.iter().map(|(rgb, _)| red(rgb)).max().unwrap_or_default();
        let nothing = |evidence: &str| {
            PolicyError::GaveUp(Failure { cause: FailureCause::NoGrasp, evidence: evidence.to_owned() })
        };
        if reddest < 60 {
            return Err(nothing("nothing red is visible"));
        }
        let object: Vec<DVec3> =
            seen.iter().filter(|(rgb, _)| red(rgb) > reddest / 2).map(|(_, point)| *point).collect();
        let is_board = |point: &&DVec3| (BOARD_M[0]..BOARD_M[1]).contains(&point.z);
        let board: Vec<DVec3> = seen.iter().map(|(_, point)| point).filter(is_board).copied().collect();
        if board.len() < 50 {
            return Err(nothing("no board is visible"));
        }
        let board = board.iter().sum::<DVec3>() / board.len() as f64;

        let top_m = object.iter().map(|point| point.z).fold(0.0, f64::max);
        let (center, yaw) = top_of(&object, top_m);
        let down = pointing_down(yaw);
        let take = center.extend((top_m - 0.02).max(0.012));
        let put = DVec3::new(board.x, board.y, take.z + board.z + 0.006);
        let (above, over) = (take + DVec3::Z * ABOVE_M, put + DVec3::Z * ABOVE_M);

        let mut path = ActionPath { at: (self.home.0, self.home.1, -1.0), actions: Vec::new() };
        path.move_to(above, down);
        path.move_to(take, down);
        path.set_gripper(1.0);
        path.move_to(above, down);
        path.move_to(over, down);
        path.move_to(put, down);
        path.set_gripper(-1.0);
        path.move_to(over, down);
        Ok(ActionChunk { actions: path.actions, finished: true })
    }
}

/// Centre of the top face in the plane, and its narrowest direction.
fn top_of(points: &[DVec3], top_m: f64) -> (DVec2, f64) {
    let face: Vec<DVec2> =
        points.iter().filter(|point| point.z > top_m - 0.004).map(|point| point.truncate()).collect();
    let range = |yaw: f64| {
        let along = |axis: DVec2| {
            let place = face.iter().map(|point| point.dot(axis));
            (place.clone().fold(f64::INFINITY, f64::min), place.fold(f64::NEG_INFINITY, f64::max))
        };
        (along(DVec2::from_angle(yaw)), along(DVec2::from_angle(yaw).perp()))
    };
    let area = |yaw: f64| {
        let ((a, b), (c, d)) = range(yaw);
        (b - a) * (d - c)
    };
    // The fingers close along the tool's y axis; an eighth of a turn either way is enough for a square.
    let yaws = (-22..=22).map(|step| f64::from(step) * 2_f64.to_radians());
    let yaw = yaws.min_by(|a, b| area(*a).total_cmp(&area(*b))).unwrap_or_default();
    let ((a, b), (c, d)) = range(yaw);
    (DVec2::from_angle(yaw) * ((a + b) / 2.0) + DVec2::from_angle(yaw).perp() * ((c + d) / 2.0), yaw)
}

/// Tool orientation pointing down, rotated about the vertical.
fn pointing_down(yaw: f64) -> DQuat {
    let x = DVec2::from_angle(yaw).extend(0.0);
    DQuat::from_mat3(&DMat3::from_cols(x, DVec3::NEG_Z.cross(x), DVec3::NEG_Z))
}

/// Actions under construction: straight lines in small steps.
struct ActionPath {
    at: Waypoint,
    actions: Vec<Vec<f32>>,
}

impl ActionPath {
    fn move_to(&mut self, position: DVec3, rotation: DQuat) {
        let (from, turned, grip) = self.at;
        let steps =
            ((position - from).length() / STEP_M).max(turned.angle_between(rotation) / STEP_RAD).ceil().max(1.0);
        for step in 1..=steps as usize {
            let t = step as f64 / steps;
            self.push((from.lerp(position, t), turned.slerp(rotation, t), grip));
        }
        // Wait until the arm is at rest.
        (0..3).for_each(|_| self.push(self.at));
    }

    fn set_gripper(&mut self, grip: f32) {
        (0..FINGER_ACTIONS).for_each(|_| self.push((self.at.0, self.at.1, grip)));
    }

    fn push(&mut self, waypoint: Waypoint) {
        let (position, rotation, grip) = waypoint;
        let columns = DMat3::from_quat(rotation);
        let numbers = [position.to_array(), columns.x_axis.to_array(), columns.y_axis.to_array()].concat();
        self.actions.push(numbers.iter().map(|&number| number as f32).chain([grip]).collect());
        self.at = waypoint;
    }
}

/// A red cube and a cutting board.
fn task() -> Task {
    let objects = ["046", "014"].map(|uid| Catalogue::builtin().card(uid).unwrap().clone());
    let on = Atom::Relation {
        subject: "046".parse().unwrap(),
        relation: Relation::On,
        reference: "014".into(),
        second_reference: None,
    };
    Task {
        id: "red_cube_on_board".into(),
        kind: TaskKind::PickAndPlace,
        instruction: "Put the red cube on the cutting board.".into(),
        goal: Goal { alternatives: vec![vec![on]] },
        scene_graph: SceneGraph {
            description: String::new(),
            nodes: objects.iter().map(GraphNode::of).collect(),
            edges: Vec::new(),
        },
        objects: objects.iter().cloned().map(std::sync::Arc::new).collect(),
        surfaces: Vec::new(),
        interchangeable: Vec::new(),
        source: "test".into(),
    }
}

#[test]
fn it_reaches_for_the_red_pixel_and_succeeds() {
    let stage = stage(scenario(&task()));
    let home = stage.robot.tcp_pose(&stage.robot.home);
    for camera in ["overview", "static"] {
        let mut policy = RedPixel { camera, home: (home.position, home.rotation) };
        let settings = RolloutSettings::default();
        let result = run_episode(&stage, &mut policy, "red", Seed::new(1), &settings).unwrap().result;
        assert!(result.success && !result.oracle, "{camera}: {:?}", result.failures);
        assert!(result.max_stray_contact_n < 20.0, "{camera}: {:?}", result.stray_contact);
    }
}
