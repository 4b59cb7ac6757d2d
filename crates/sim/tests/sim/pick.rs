//! A scripted top-down pick (approach, close, lift 0.2 m, hold 1 s) with measurements of the hold.

use std::sync::Arc;

use genmanip_assets::worlds::default_world;
use genmanip_core::glam::{DMat3, DVec3};
use genmanip_core::{Frame, ObjectModel, PhysicsFactors, Pose, RobotModel};
use genmanip_sim::{Model, SceneObject, Sim, SimError};

#[derive(Debug)]
pub struct PickReport {
    /// Rise of the object from before the lift to the end, m.
    pub lifted: f64,
    /// Largest drift of the object in the gripper from lift-off (0.1 s into the lift) to the end, m.
    pub slip: f64,
    /// Largest rotation of the object in the gripper over the same time, rad.
    pub turn: f64,
    /// Largest drift during the second half of the hold, m.
    pub creep: f64,
    /// Displacement of the object while closing, m.
    pub nudge: f64,
    /// Largest difference between commanded and simulated joints while approaching and lifting, rad.
    pub tracking: f64,
    pub frames: Vec<Frame>,
}

pub struct Pick {
    pub model: Arc<ObjectModel>,
    /// `world_from_object` at the start.
    pub start: Pose,
    /// TCP position at closing, in the object's frame.
    pub grasp: DVec3,
    /// Rotation of the closing direction relative to the object's y axis, rad.
    pub yaw: f64,
    /// Opening width on the way down, m.
    pub opening: f32,
}

pub fn pick(robot: &RobotModel, pick: &Pick) -> Result<PickReport, SimError> {
    let object = SceneObject {
        name: "it".into(),
        model: pick.model.clone(),
        pose: pick.start,
        joint_positions: vec![],
        physics: PhysicsFactors::default(),
    };
    let scene = Arc::new(Model::compile(&default_world(), robot, &[object])?);
    let mut sim = Sim::new(scene);

    let down = Pose::from_axes(pick.start.transform_point(pick.grasp), DVec3::X, DVec3::NEG_Y, DVec3::NEG_Z);
    let turn = Pose::from_position_yaw(DVec3::ZERO, pick.start.yaw() + pick.yaw);
    let grasp = Pose::new(down.position, turn.rotation * down.rotation);
    let above = |height: f64| Pose { position: grasp.position + DVec3::Z * height, ..grasp };

    let home = robot.home.clone();
    let pre = solve(robot, &home, &above(0.1));
    let mut frames = Vec::new();
    let mut tracking: f64 = 0.0;
    let mut run = |sim: &mut Sim, path: &[Vec<f64>], width: f32| -> Result<(), SimError> {
        for joints in path {
            let mut command: Vec<f32> = joints.iter().map(|&value| value as f32).collect();
            command.push(width);
            let frame = sim.control_step(&command)?;
            let now = sim.link_poses();
            let ideal = robot.link_poses(joints, 0.0);
            tracking = tracking.max(now[robot.hand].position.distance(ideal[robot.hand].position));
            frames.push(frame);
        }
        Ok(())
    };
    run(&mut sim, &joint_path(&home, &pre, 90), pick.opening)?;
    let (descent, at) = line(robot, &pre, &above(0.1), &grasp, 60);
    run(&mut sim, &descent, pick.opening)?;
    run(&mut sim, &vec![at.clone(); 12], pick.opening)?;
    let before = sim.object_states()[0].pose;
    run(&mut sim, &vec![at.clone(); 60], 0.0)?;
    let closed = sim.object_states()[0].pose;
    let lift_begins = frame_count(&sim);
    let (ascent, top) = line(robot, &at, &grasp, &above(0.2), 72);
    run(&mut sim, &ascent, 0.0)?;
    run(&mut sim, &vec![top; 60], 0.0)?;
    let end = sim.object_states()[0].pose;
    assert_eq!(sim.grasped(), frames[frames.len() - 1].grasped, "queried now and in the last interval");
    assert_eq!(sim.joint_positions().len(), robot.arm_dof());

    let in_hand: Vec<Pose> =
        frames[lift_begins + 6..].iter().map(|frame| frame.tcp.inverse() * frame.objects[0].pose).collect();
    let drift = |from: usize| {
        in_hand[from..].iter().map(|pose| pose.position.distance(in_hand[from].position)).fold(0.0, f64::max)
    };
    Ok(PickReport {
        lifted: end.position.z - closed.position.z,
        slip: drift(0),
        turn: in_hand.iter().map(|pose| pose.angle_to(&in_hand[0])).fold(0.0, f64::max),
        creep: drift(in_hand.len() - 30),
        nudge: before.position.distance(closed.position),
        tracking,
        frames,
    })
}

fn frame_count(sim: &Sim) -> usize {
    (sim.time_s() * 60.0).round() as usize
}

/// Minimum-jerk blend from 0 to 1.
fn blend(t: f64) -> f64 {
    t * t * t * (10.0 - 15.0 * t + 6.0 * t * t)
}

pub fn joint_path(from: &[f64], to: &[f64], steps: usize) -> Vec<Vec<f64>> {
    (1..=steps)
        .map(|step| {
            let t = blend(step as f64 / steps as f64);
            from.iter().zip(to).map(|(a, b)| a + (b - a) * t).collect()
        })
        .collect()
}

fn line(robot: &RobotModel, start: &[f64], from: &Pose, to: &Pose, steps: usize) -> (Vec<Vec<f64>>, Vec<f64>) {
    let mut joints = start.to_vec();
    let path: Vec<Vec<f64>> = (1..=steps)
        .map(|step| {
            joints = solve(robot, &joints, &from.interpolate(to, blend(step as f64 / steps as f64)));
            joints.clone()
        })
        .collect();
    (path, joints)
}

/// Damped least squares with a numeric Jacobian.
pub fn solve(robot: &RobotModel, start: &[f64], world_from_tcp: &Pose) -> Vec<f64> {
    let mut joints = start.to_vec();
    for _ in 0..100 {
        let here = robot.tcp_pose(&joints);
        let error = difference(&here, world_from_tcp);
        if error.iter().all(|value| value.abs() < 1e-6) {
            return joints;
        }
        let columns: Vec<[f64; 6]> = (0..joints.len())
            .map(|joint| {
                let mut moved = joints.clone();
                moved[joint] += 1e-6;
                difference(&here, &robot.tcp_pose(&moved)).map(|value| value / 1e-6)
            })
            .collect();
        let mut normal = [[0.0; 6]; 6];
        for (row, entries) in normal.iter_mut().enumerate() {
            for (column, entry) in entries.iter_mut().enumerate() {
                *entry = columns.iter().map(|c| c[row] * c[column]).sum::<f64>();
            }
            entries[row] += 1e-6;
        }
        let y = solve_linear(normal, error);
        for ((joint, column), limits) in joints.iter_mut().zip(&columns).zip(robot.arm_joints()) {
            let step: f64 = column.iter().zip(&y).map(|(c, y)| c * y).sum();
            *joint = (*joint + step.clamp(-0.2, 0.2)).clamp(limits.lower, limits.upper);
        }
    }
    panic!("no arm configuration for {world_from_tcp:?}");
}

fn difference(from: &Pose, to: &Pose) -> [f64; 6] {
    let p = to.position - from.position;
    let r = DMat3::from_quat(to.rotation * from.rotation.inverse());
    let w = DVec3::new(r.y_axis.z - r.z_axis.y, r.z_axis.x - r.x_axis.z, r.x_axis.y - r.y_axis.x) * 0.5;
    [p.x, p.y, p.z, w.x, w.y, w.z]
}

/// Gaussian elimination with row pivoting.
fn solve_linear(mut a: [[f64; 6]; 6], mut b: [f64; 6]) -> [f64; 6] {
    for pivot in 0..6 {
        let best = (pivot..6).max_by(|&i, &j| a[i][pivot].abs().total_cmp(&a[j][pivot].abs())).unwrap_or(pivot);
        a.swap(pivot, best);
        b.swap(pivot, best);
        let top = a[pivot];
        for row in pivot + 1..6 {
            let factor = a[row][pivot] / top[pivot];
            a[row].iter_mut().zip(&top).for_each(|(entry, above)| *entry -= factor * above);
            b[row] -= factor * b[pivot];
        }
    }
    let mut x = [0.0; 6];
    for row in (0..6).rev() {
        let rest: f64 = (row + 1..6).map(|column| a[row][column] * x[column]).sum();
        x[row] = (b[row] - rest) / a[row][row];
    }
    x
}
