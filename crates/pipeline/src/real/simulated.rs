//! Simulated arm behind a bridge, on any clock: delay, noise, a gripper, reflexes and rendered cameras.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use genmanip_core::glam::DVec3;
use genmanip_core::{CameraRequest, ImageChannels, ObjectState, RgbdImage, RobotModel, Seed};
use genmanip_real::bridge::server::Clock;
use genmanip_real::bridge::{
    BridgeRobot, CameraImage, Driver, DriverError, ImageHead, ImageSource, JointLimits, JointState, Orders, Reading,
};
use genmanip_rollout::Stage;
use genmanip_rollout::images::{Exposure, StageRenderer};
use genmanip_sim::{Sim, SimError};
use rand::RngExt;
use serde::{Deserialize, Serialize};

/// Flaws of the simulated arm.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SimulatedArmSettings {
    /// Time by which the drives lag behind their setpoints, s, in addition to that of the simulated drives.
    pub lag_s: f64,
    /// Standard deviation of measured joint positions, rad.
    pub noise_rad: f64,
    /// External force at which a reflex stops the arm, N: the sum of its contacts, in which the two forces of a grasp
    /// balance each other. 0 for no reflexes.
    pub reflex_n: f64,
}

impl Default for SimulatedArmSettings {
    fn default() -> Self {
        // Noise of a Franka's encoders; a reflex threshold in the range of Franka's examples (20 to 100 N).
        Self { lag_s: 0.0, noise_rad: 1e-4, reflex_n: 100.0 }
    }
}

/// Error word of a reflex.
const REFLEX: &str = "cartesian_reflex";
/// Time constant of the estimate of the external force, s. Chosen by hand: joint torque sensors do not see the shock of
/// one physics step.
const FORCE_S: f64 = 0.01;
/// Time without reflexes after a recovery, s.
const GRACE_S: f64 = 0.1;
/// Time behind schedule after which a driver gives up catching up, s.
const MOST_BEHIND_S: f64 = 0.05;

/// Facts about a robot model for a bridge.
pub fn bridge_robot(robot: &Arc<RobotModel>) -> BridgeRobot {
    let joints = robot.arm_joints().map(|joint| JointLimits {
        lower: joint.lower,
        upper: joint.upper,
        velocity: joint.max_velocity,
        acceleration: joint.max_acceleration,
        jerk: joint.max_jerk,
        end_deceleration: None,
    });
    let model = Arc::clone(robot);
    BridgeRobot {
        name: robot.name.clone(),
        joints: joints.collect(),
        max_width_m: robot.gripper.max_width,
        tool: Arc::new(move |arm: &[f64]| model.tcp_pose(arm).position.to_array()),
    }
}

/// Part of the simulation's state that cameras see.
#[derive(Clone, Debug)]
struct Seen {
    time_s: f64,
    arm: Vec<f64>,
    width_m: f64,
    objects: Vec<ObjectState>,
}

/// Simulated arm on a stage.
pub struct SimulatedArm {
    sim: Sim,
    settings: SimulatedArmSettings,
    seed: Seed,
    tick_s: f64,
    ticks: u64,
    /// Time that the simulation is behind the ticks, s.
    owed_s: f64,
    step_s: f64,
    /// Setpoints on their way through the lag.
    lagging: VecDeque<Vec<JointState>>,
    setpoints: Vec<JointState>,
    width_m: f64,
    torques: Vec<f64>,
    grasped: Option<usize>,
    /// Estimate of the external force, N, in the world.
    force: DVec3,
    has_reflex: bool,
    /// Control periods without reflexes after a recovery.
    grace_ticks: u64,
    seen: Arc<Mutex<Seen>>,
}

impl SimulatedArm {
    /// Arm and objects in the initial state of a stage.
    pub fn new(stage: &Stage, settings: SimulatedArmSettings, tick_s: f64, seed: Seed) -> Self {
        let sim = Sim::new(Arc::clone(&stage.scene));
        let setpoints: Vec<JointState> = sim.joint_positions().into_iter().map(JointState::at_rest).collect();
        let width_m = sim.gripper_width();
        let lag = (settings.lag_s / tick_s).round() as usize;
        let seen = Seen { time_s: 0.0, arm: sim.joint_positions(), width_m, objects: sim.object_states() };
        Self {
            step_s: stage.scene.physics().timestep_s(),
            lagging: vec![setpoints.clone(); lag].into(),
            seen: Arc::new(Mutex::new(seen)),
            torques: vec![0.0; setpoints.len()],
            sim,
            settings,
            seed: seed.fork("encoders"),
            tick_s,
            ticks: 0,
            owed_s: 0.0,
            setpoints,
            width_m,
            grasped: None,
            force: DVec3::ZERO,
            has_reflex: false,
            grace_ticks: 0,
        }
    }

    /// Simulation behind the arm, for tests that know the truth.
    pub fn sim(&self) -> &Sim {
        &self.sim
    }

    /// Index of the object that both fingers press; `None` without one.
    pub fn grasped(&self) -> Option<usize> {
        self.grasped
    }

    /// Cameras that see the simulation.
    ///
    /// # Errors
    /// If a mesh of the stage is invalid.
    pub fn cameras(&self, stage: &Stage) -> Result<SimulatedCameras, genmanip_rollout::RolloutError> {
        let renderer = Mutex::new(StageRenderer::new(stage)?);
        Ok(SimulatedCameras { stage: stage.clone(), seen: Arc::clone(&self.seen), renderer })
    }

    /// Measurements now.
    pub fn reading(&self) -> Reading {
        let noisy = |(joint, position): (usize, f64)| {
            if self.settings.noise_rad == 0.0 {
                return position;
            }
            let rng = &mut self.seed.fork_index(self.ticks).fork_index(joint as u64).rng();
            // The sum of twelve uniform numbers is nearly normal, with standard deviation 1.
            let normal = (0..12).map(|_| rng.random_range(-0.5..0.5)).sum::<f64>();
            position + self.settings.noise_rad * normal
        };
        Reading {
            positions: self.sim.joint_positions().into_iter().enumerate().map(noisy).collect(),
            velocities: self.sim.joint_velocities(),
            torques: self.torques.clone(),
            width_m: Some(self.sim.gripper_width()),
            errors: if self.has_reflex { vec![REFLEX.into()] } else { Vec::new() },
            ..Reading::default()
        }
    }

    /// Executes the orders of a control period.
    ///
    /// # Errors
    /// If the simulation diverges.
    pub fn advance(&mut self, orders: &Orders) -> Result<(), SimError> {
        self.ticks += 1;
        if self.has_reflex && orders.recover {
            // As a real arm, which takes its position as its own setpoint then: the force of the contact fades.
            self.has_reflex = false;
            self.grace_ticks = (GRACE_S / self.tick_s) as u64;
            self.freeze();
        }
        self.grace_ticks = self.grace_ticks.saturating_sub(1);
        if !self.has_reflex && !orders.recover {
            self.lagging.push_back(orders.setpoints.clone());
            self.setpoints = self.lagging.pop_front().unwrap_or_default();
        }
        self.width_m = orders.width_m.unwrap_or(self.width_m);
        self.owed_s += self.tick_s;
        while self.owed_s >= self.step_s {
            self.owed_s -= self.step_s;
            self.step()?;
        }
        Ok(())
    }

    /// Makes the present position the setpoint.
    fn freeze(&mut self) {
        self.setpoints = self.sim.joint_positions().into_iter().map(JointState::at_rest).collect();
        self.lagging.iter_mut().for_each(|later| later.clone_from(&self.setpoints));
    }

    fn step(&mut self) -> Result<(), SimError> {
        let positions: Vec<f64> = self.setpoints.iter().map(|joint| joint.position).collect();
        let velocities: Vec<f64> = self.setpoints.iter().map(|joint| joint.velocity).collect();
        let step = self.sim.robot_step(&positions, &velocities, self.width_m)?;
        self.torques = step.torques;
        self.grasped = step.grasped;
        self.force += (step.contact_force - self.force) * (self.step_s / FORCE_S).min(1.0);
        let is_hit = self.settings.reflex_n > 0.0 && self.force.length() > self.settings.reflex_n;
        if is_hit && !self.has_reflex && self.grace_ticks == 0 {
            // The arm holds where it is; the brakes of a real one are as abrupt.
            self.has_reflex = true;
            self.freeze();
        }
        let mut seen = self.seen.lock().unwrap_or_else(PoisonError::into_inner);
        *seen = Seen {
            time_s: self.ticks as f64 * self.tick_s,
            arm: self.sim.joint_positions(),
            width_m: self.sim.gripper_width(),
            objects: self.sim.object_states(),
        };
        Ok(())
    }
}

impl std::fmt::Debug for SimulatedArm {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SimulatedArm").field("sim", &self.sim).field("ticks", &self.ticks).finish_non_exhaustive()
    }
}

/// Simulated arm on the wall clock.
#[derive(Debug)]
pub struct PacedArm {
    /// The arm.
    pub arm: SimulatedArm,
    clock: Clock,
    /// Time of the next control period, s.
    next_s: f64,
}

impl PacedArm {
    /// The arm with its control periods on a clock.
    pub fn new(arm: SimulatedArm, clock: Clock) -> Self {
        Self { arm, clock, next_s: clock.now_s() }
    }
}

impl Driver for PacedArm {
    fn read(&mut self) -> Result<Reading, DriverError> {
        let now_s = self.clock.now_s();
        match self.next_s - now_s {
            early_s if early_s > 0.0 => std::thread::sleep(Duration::from_secs_f64(early_s)),
            // A machine that is too slow runs in slow motion rather than in bursts.
            late_s if -late_s > MOST_BEHIND_S => self.next_s = now_s,
            _ => {}
        }
        self.next_s += self.arm.tick_s;
        Ok(self.arm.reading())
    }

    fn write(&mut self, orders: &Orders) -> Result<(), DriverError> {
        self.arm.advance(orders).map_err(|error| DriverError(format!("the simulation failed: {error}")))
    }
}

/// Rendered cameras of a simulated arm.
pub struct SimulatedCameras {
    stage: Stage,
    seen: Arc<Mutex<Seen>>,
    renderer: Mutex<StageRenderer>,
}

impl ImageSource for SimulatedCameras {
    fn cameras(&self) -> Vec<String> {
        self.stage.scenario.world.cameras.iter().map(|camera| camera.name.clone()).collect()
    }

    fn image(&self, camera: &str, size: Option<[u32; 2]>) -> Result<CameraImage, String> {
        let request = CameraRequest { size, ..CameraRequest::new(camera, ImageChannels::RGBD) };
        let (image, exposed_s) = self.rendered(&request)?;
        let head = ImageHead {
            camera: camera.into(),
            width: image.width(),
            height: image.height(),
            has_depth: !image.depth_m.is_empty(),
            exposed_s,
        };
        let depth_m = image.depth_m.into_iter().map(|depth_m| if depth_m.is_finite() { depth_m.max(0.0) } else { 0.0 });
        Ok(CameraImage { head, rgb: image.rgb, depth_m: depth_m.collect() })
    }
}

impl SimulatedCameras {
    /// Instance ids of the pixels of an image: truth that no real camera measures.
    ///
    /// # Errors
    /// If the camera is not known or cannot be rendered.
    pub fn ids(&self, request: &CameraRequest) -> Result<Vec<u16>, String> {
        let channels = ImageChannels { ids: true, rgb: false, depth: false, normals: false, points: false };
        self.rendered(&CameraRequest { channels, ..request.clone() }).map(|(image, _)| image.ids)
    }

    /// Image of the present state, and its time, s.
    fn rendered(&self, request: &CameraRequest) -> Result<(RgbdImage, f64), String> {
        let view = self.stage.camera(request).map_err(|error| error.to_string())?;
        let seen = self.seen.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let objects = seen.objects.iter().map(|object| (object.pose, object.joint_positions.as_slice()));
        let noise = self.stage.scenario.seed.fork("cameras").fork_index((seen.time_s * 1e3) as u64);
        let mut renderer = self.renderer.lock().unwrap_or_else(PoisonError::into_inner);
        let views = [(&view, request.channels)];
        let images = renderer.render_state(&seen.arm, seen.width_m, objects, &views, Exposure::still(noise));
        let image = images.map_err(|error| error.to_string())?.remove(0);
        Ok((image, seen.time_s))
    }
}

impl std::fmt::Debug for SimulatedCameras {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SimulatedCameras").finish_non_exhaustive()
    }
}
