//! Consistency of an episode's states, actions and tool poses.

use genmanip_core::glam::DVec3;
use genmanip_core::{ActionSpace, ActionSpec, Pose, RobotModel, RotationEncoding};

use super::findings::Findings;
use super::metadata::{EpisodeEntry, Metadata};
use genmanip_data::columns::{Column, Rows};

/// Tolerance of the tool pose, m and rad: single-precision errors accumulate along the arm.
const NEAR_M: f64 = 1e-4;
const NEAR_RAD: f64 = 1e-3;
/// Tolerance of the gripper opening, m: both columns hold the same number in single precision.
const NEAR_OPENING_M: f64 = 1e-6;
/// Tolerance of joint limits, rad: the simulated limits are compliant.
const BEYOND_RAD: f64 = 0.05;

pub(super) fn check(
    metadata: &Metadata,
    robot: &RobotModel,
    episode: &EpisodeEntry,
    rows: &Rows,
    findings: &mut Findings,
) {
    let columns = EpisodeColumns { episode, rows };
    let spec = metadata.contract.as_ref().map_or_else(ActionSpec::native, |contract| contract.action);
    let state = columns.state(robot, &spec).filter(|_| has_joints(metadata, robot));
    if let Some((row, key, expected, found)) = state.or_else(|| columns.tool()) {
        findings.add("state", &episode.data, format!("{}, row {row}, {key}", episode.place()), expected, found);
    }
    if let Some((row, key, expected, found)) = columns.action(metadata, robot) {
        findings.add("action", &episode.data, format!("{}, row {row}, {key}", episode.place()), expected, found);
    }
}

/// False if the names of `observation.state` are others than those of the robot's joints.
fn has_joints(metadata: &Metadata, robot: &RobotModel) -> bool {
    let state = metadata.info.features.iter().find(|feature| feature.key == "observation.state");
    let names = state.map_or(&[][..], |feature| &feature.names);
    let is_joint = |name: &String| {
        let name = name.strip_suffix(".pos").unwrap_or(name);
        robot.arm_joints().any(|joint| joint.name == *name)
    };
    names.is_empty() || names.iter().any(is_joint) || names.iter().all(|name| name.starts_with("observation.state"))
}

/// Row, column, expected value and actual value of the first difference.
type Deviation = (usize, &'static str, String, String);

struct EpisodeColumns<'a> {
    episode: &'a EpisodeEntry,
    rows: &'a Rows,
}

impl EpisodeColumns<'_> {
    fn column(&self, key: &str, width: usize) -> Option<&Column> {
        let values = usize::try_from(self.episode.length).ok()?.checked_mul(width)?;
        self.rows.get(key).filter(|column| column.width == width && column.values.len() == values)
    }

    /// Checks joint positions against joint limits and the tool pose. `None` if they agree.
    fn state(&self, robot: &RobotModel, spec: &ActionSpec) -> Option<Deviation> {
        let dof = robot.arm_dof();
        let state = self.column("observation.state", dof + 1)?;
        let ee = self.column("ee.state", 7);
        for row in 0..state.values.len() / state.width {
            let (arm, width_m) = spec.decode_state(state.row(row), robot);
            for (joint, q) in robot.arm_joints().zip(&arm) {
                if !(joint.lower - BEYOND_RAD..=joint.upper + BEYOND_RAD).contains(q) {
                    let expected = format!("{} between {} and {} rad", joint.name, joint.lower, joint.upper);
                    return Some((row, "observation.state", expected, q.to_string()));
                }
            }
            let seen = ee.map(|ee| held(ee.row(row), spec, robot));
            if let Some(seen) = seen
                && let Some((expected, found)) = differ(&robot.tcp_pose(&arm), width_m, &seen)
            {
                return Some((
                    row,
                    "ee.state",
                    format!("{expected}, from observation.state by forward kinematics"),
                    found,
                ));
            }
        }
        None
    }

    /// Checks the three encodings of the tool orientation against each other. `None` if they agree.
    fn tool(&self) -> Option<Deviation> {
        let ee = self.column("ee.state", 7)?;
        for (key, encoding) in
            [("ee.quaternion", RotationEncoding::QuatWxyz), ("ee.rotation_6d", RotationEncoding::SixD)]
        {
            let Some(column) = self.column(key, encoding.length()) else { continue };
            for row in 0..column.values.len() / column.width {
                let pose = pose_of(ee.row(row));
                let turn =
                    encoding.decode(column.row(row)).map(|rotation| Pose::new(pose.position, rotation).angle_to(&pose));
                if turn.is_none_or(|turn| turn.is_nan() || turn > NEAR_RAD) {
                    let expected = format!("the rotation {:?} of ee.state", &ee.row(row)[3..6]);
                    return Some((row, key, expected, format!("{:?}", column.row(row))));
                }
            }
        }
        None
    }

    /// Checks the actions, decoded by the contract, against the commanded tool pose. `None` if they agree.
    fn action(&self, metadata: &Metadata, robot: &RobotModel) -> Option<Deviation> {
        let (contract, ee) = (metadata.contract.as_ref()?, self.column("ee.action", 7)?);
        let (spec, dof) = (contract.action, robot.arm_dof());
        let action = self.column("action", spec.length(dof))?;
        let home = self.episode.home.as_ref().filter(|home| home.len() == dof);
        if home.is_none() && !spec.space.is_absolute() {
            // Relative actions cannot be decoded without the home position.
            return None;
        }
        let home = home.unwrap_or(&robot.home);
        let mut joints: Vec<f64> = home.iter().map(|q| f64::from(*q as f32)).collect();
        let mut before = robot.tcp_pose(&joints);
        for row in 0..action.values.len() / action.width {
            let (motion, grip) = action.row(row).split_at(action.width - 1);
            let changed = |by: f64| joints.iter().zip(motion).map(|(q, v)| q + v * by).collect::<Vec<f64>>();
            match spec.space {
                ActionSpace::JointPosition => joints = motion.to_vec(),
                ActionSpace::JointDegrees => joints = motion.iter().map(|degrees| degrees.to_radians()).collect(),
                ActionSpace::JointDelta => joints = changed(1.0),
                ActionSpace::JointVelocity => joints = changed(1.0 / contract.rate_hz),
                ActionSpace::EePose | ActionSpace::EeDelta => {}
            }
            let decoded = || {
                let (position, rotation) = motion.split_at(3);
                Some(Pose::new(DVec3::from_slice(position), spec.rotation.decode(rotation)?))
            };
            let pose = match spec.space {
                ActionSpace::EePose => decoded(),
                ActionSpace::EeDelta => decoded().map(|change| spec.frame.apply(&change, &before)),
                _ => Some(robot.tcp_pose(&joints)),
            };
            let Some(pose) = pose else {
                let expected = format!("a rotation encoded as {}", spec.rotation.description());
                return Some((row, "action", expected, format!("{motion:?}")));
            };
            let width = f64::from(spec.gripper.width_m(grip[0] as f32, &robot.gripper));
            let commanded = held(ee.row(row), &spec, robot);
            if let Some((expected, found)) = differ(&pose_of(&commanded), commanded[6], &row_of(&pose, width)) {
                let expected = format!("{expected}, according to ee.action");
                return Some((row, "action", expected, format!("{found}, decoded as {spec}")));
            }
            before = pose_of(ee.row(row));
        }
        None
    }
}

/// Row of `ee.state` or `ee.action` with the opening that a gripper value of the contract can hold: values in percent end
/// where the gripper is closed or open.
fn held(row: &[f64], spec: &ActionSpec, robot: &RobotModel) -> [f64; 7] {
    let mut held: [f64; 7] = std::array::from_fn(|index| row[index]);
    let number = spec.gripper.number(held[6] as f32, &robot.gripper);
    held[6] = f64::from(spec.gripper.width_m(number, &robot.gripper));
    held
}

/// Pose of a row of `ee.state` or `ee.action`.
fn pose_of(row: &[f64]) -> Pose {
    let rotation = RotationEncoding::FixedXyzEuler.decode(&row[3..6]).unwrap_or_default();
    Pose::new(DVec3::from_slice(row), rotation)
}

fn row_of(pose: &Pose, width: f64) -> Vec<f64> {
    pose.position.to_array().into_iter().chain(pose.to_fixed_xyz_euler()).chain([width]).collect()
}

/// Expected and actual values as texts; `None` if they agree within the tolerances.
fn differ(expected: &Pose, width: f64, found: &[f64]) -> Option<(String, String)> {
    let pose = pose_of(found);
    let far = pose.position.distance(expected.position);
    let turn = pose.angle_to(expected);
    let opening = (found[6] - width).abs();
    let is_near = far <= NEAR_M && turn <= NEAR_RAD && opening <= NEAR_OPENING_M;
    let words = |row: &[f64]| row.iter().map(|value| format!("{value:.4}")).collect::<Vec<_>>().join(" ");
    (!is_near).then(|| (words(&row_of(expected, width)), words(found)))
}
