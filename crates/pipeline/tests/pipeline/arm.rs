//! Policies on an arm behind the bridge, on a clock that the test's client advances.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use std::time::Duration;

use genmanip_core::{
    ActionChunk, ActionSpec, CameraRequest, Ending, EpisodeStart, Frame, ImageChannels, Interpolation, Observation,
    Policy, PolicyError, PolicySpec, Pose, PrivilegedState, RgbdImage, Seed, TaskKind,
};
use genmanip_motion::PlannerSettings;
use genmanip_pipeline::PolicyFactory;
use genmanip_pipeline::evaluate::Suite;
use genmanip_pipeline::policies::PolicyContext;
use genmanip_pipeline::real::alongside::Alongside;
use genmanip_pipeline::real::arm::{ArmSettings, RealArm};
use genmanip_pipeline::real::cameras::Rig;
use genmanip_pipeline::real::points::{PointJudge, moment};
use genmanip_pipeline::real::rehearsal::Rehearsal;
use genmanip_pipeline::real::simulated::SimulatedArmSettings;
use genmanip_real::bridge::client::{ArmClient, ClientSettings};
use genmanip_real::bridge::{BridgeSettings, LinkSettings};
use genmanip_remote_policies::fake::{self, Answer};
use genmanip_rollout::ahead::{ChunkReport, can_ask_ahead, run_ahead};
use genmanip_rollout::collect::{PipelineSettings, Resources};
use genmanip_rollout::environment::Step;
use genmanip_rollout::{RobotInterface, RolloutError, RolloutSettings, Stage, run_policy};
use genmanip_workspace::{scenarios, worlds};

const LINK: LinkSettings = LinkSettings { latency_s: 0.02, jitter_s: 0.01, loss: 0.01 };

fn arm(
    stage: &Stage,
    settings: ArmSettings,
    flaws: SimulatedArmSettings,
    held: &Arc<AtomicBool>,
) -> RealArm<Rehearsal> {
    let rehearsal = Rehearsal::new(stage, BridgeSettings::default(), flaws, LINK, Seed::new(7)).unwrap();
    let client = ArmClient::connect(rehearsal, ClientSettings::default(), Arc::clone(held)).unwrap();
    RealArm::new(client, stage, settings, Rig::default()).unwrap().with_truth()
}

/// The expert, unchanged, solves a scene behind 20 ± 10 ms of delay and 1 % of loss.
#[test]
fn the_expert_solves_a_scene_behind_the_bridge() {
    let suite = Suite::frozen(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../suites/genmanip-200-rc")).unwrap();
    let case = suite.cases.iter().find(|case| case.scenario.task.kind == TaskKind::Spatial).unwrap();
    let planner = worlds::planner(&suite.settings.world, &PlannerSettings::default()).unwrap();
    let stage = Stage::open(Arc::clone(&case.scenario), suite.source(), planner.robot()).unwrap();
    let expert = PolicyFactory::resolve("expert").unwrap();
    let grasps = Resources::builtin(&planner).grasps;
    let settings = &suite.settings;
    let context = PolicyContext { stage: &stage, recorded: None, planner: &planner, grasps, settings, cores: None };
    let mut expert = expert.make(&context).unwrap();
    let held = Arc::new(AtomicBool::new(true));
    let limits = ArmSettings { horizon_s: 60.0, dry_run: false };
    let mut arm = arm(&stage, limits, SimulatedArmSettings::default(), &held);
    let first = moment(&mut arm, &stage).unwrap();
    let judge = PointJudge::begin(&stage, first.clone()).unwrap();
    let (ending, gave_up) =
        run_policy(&mut arm, &stage, expert.as_mut(), case.seed, &RolloutSettings::default()).unwrap();
    assert_eq!((ending, gave_up), (Ending::Finished, None));
    arm.hold(1.0).unwrap();
    let truth = arm.truth().unwrap();
    let rest = Stage::rest(&truth.objects, truth.grasped, &RolloutSettings::default());
    let verdict = genmanip_relations::judge_goal(&stage.posed(&truth.objects), &stage.goal, &rest, &stage.relations);
    assert!(verdict.success, "{verdict:?}");
    let tally = arm.client().tally();
    assert!(tally.commands > 100 && tally.arm_stops == 0, "{tally:?}");
    // The images alone, without truth.
    let seen = judge.judge(moment(&mut arm, &stage).unwrap());
    assert!(seen.verdict.success && seen.moved.len() == 1 && seen.not_laid_out.is_empty(), "{}: {seen:?}", seen.text());
    let unmoved = judge.judge(first);
    assert!(!unmoved.verdict.success && unmoved.moved.is_empty(), "{unmoved:?}");
}

/// Arm on the wall clock whose measurements lag behind its commands.
struct PacedArm {
    stage: Stage,
    commands: Vec<Vec<f32>>,
    frames: Vec<Frame>,
    left: usize,
}

/// Control steps by which it lags.
const LAG: usize = 3;

impl RobotInterface for PacedArm {
    fn steps_left(&self) -> usize {
        self.left
    }

    fn frames(&self) -> &[Frame] {
        &self.frames
    }

    fn observe(&mut self, _cameras: &[CameraRequest]) -> Result<Observation, RolloutError> {
        let state = self.joint_positions()?.into_iter().chain([0.08]).collect();
        Ok(Observation { state: [(Observation::STATE.to_owned(), state)].into(), ..Observation::default() })
    }

    fn truth(&mut self) -> Result<PrivilegedState, RolloutError> {
        Err(RolloutError::Robot("it has no truth".into()))
    }

    fn command(&self) -> Result<Vec<f32>, RolloutError> {
        Ok(self.commands.last().unwrap().clone())
    }

    fn joint_positions(&self) -> Result<Vec<f64>, RolloutError> {
        let measured = &self.commands[self.commands.len().saturating_sub(1 + LAG)];
        Ok(measured[..7].iter().copied().map(f64::from).collect())
    }

    fn step(&mut self, command: &[f32]) -> Result<Step, RolloutError> {
        std::thread::sleep(Duration::from_secs_f64(1.0 / self.stage.control_rate_hz()));
        self.commands.push(command.to_vec());
        self.left -= 1;
        self.frames.push(Frame {
            time_s: 0.0,
            command: command.to_vec(),
            joint_position: Vec::new(),
            joint_velocity: Vec::new(),
            joint_torque: Vec::new(),
            gripper_width: 0.0,
            grip_force: 0.0,
            tcp: Pose::IDENTITY,
            objects: Vec::new(),
            grasped: None,
            stray_contact_n: 0.0,
        });
        let observation = Observation::default();
        let truncated = self.left == 0;
        Ok(Step { observation, verdict: None, terminated: false, truncated, events: Vec::new() })
    }

    fn count_unreachable(&mut self, _reason: &str) -> Result<(), RolloutError> {
        Ok(())
    }
}

/// A policy server that takes 80 ms per answer: its chunks, each from where the arm was measured, join without a jump,
/// and the arm never waits.
#[test]
fn chunks_of_a_slow_server_join_without_a_jump() {
    let address = fake::start(|question| {
        std::thread::sleep(Duration::from_millis(80));
        let from: Vec<f32> =
            question.array("observation/joint_position").unwrap().reals().iter().map(|q| *q as f32).collect();
        // The first joint turns at 0.2 rad/s, which is 8 mm of the tool per action.
        let row = |action: u8| {
            let turned = from[0] + 0.2 * f32::from(action + 1) / 15.0;
            [&[turned], &from[1..7], &[0.0]].concat()
        };
        Answer::Actions((0..10).map(row).collect())
    })
    .unwrap();
    let stage = scenarios::empty_stage(worlds::read_world(None).unwrap()).unwrap();
    let planner = worlds::planner(&stage.scenario.world, &PlannerSettings::default()).unwrap();
    let settings = PipelineSettings::in_world(stage.scenario.world.clone());
    let grasps = Resources::builtin(&planner).grasps;
    let settings = &settings;
    let context = PolicyContext { stage: &stage, recorded: None, planner: &planner, grasps, settings, cores: None };
    let openpi = PolicyFactory::resolve(&format!("openpi:url=ws://{address},preset=droid_jointpos")).unwrap();
    let policy = openpi.make(&context).unwrap();
    let spec = policy.spec();
    assert!(can_ask_ahead(&spec));
    // Held targets would step with every action, not only where chunks join.
    let action = ActionSpec { between: Interpolation::Linear, ..spec.action };
    let spec = PolicySpec { action, ..spec };
    let cameras: Vec<_> = spec.cameras.iter().map(|request| stage.camera(request).unwrap()).collect();
    let black = move || {
        let image = |camera: &genmanip_core::Camera| {
            let pixels = camera.intrinsics.width as usize * camera.intrinsics.height as usize;
            let image = RgbdImage::of_depth(camera.intrinsics, Pose::IDENTITY, Vec::new());
            (camera.name.clone(), Arc::new(RgbdImage { rgb: vec![0; 3 * pixels], ..image }))
        };
        Ok(cameras.iter().map(image).collect())
    };
    let home: Vec<f32> = stage.robot.home.iter().map(|q| *q as f32).chain([0.08]).collect();
    let mut arm = PacedArm { stage: stage.clone(), commands: vec![home], frames: Vec::new(), left: 110 };
    let (mut policy, mut report) = (Alongside::new(policy, Box::new(black)), ChunkReport::default());
    run_ahead(&mut arm, &stage, &spec, &mut policy, Seed::new(1), &RolloutSettings::default(), &mut report).unwrap();
    assert!(report.joined >= 3 && report.holds == 0, "{report:?}");
    assert!(report.largest_seam_m > 2e-3, "the chunks agree, so that nothing is tested: {report:?}");
    let tool = |command: &Vec<f32>| {
        let arm: Vec<f64> = command[..7].iter().copied().map(f64::from).collect();
        stage.robot.tcp_pose(&arm).position
    };
    let path: Vec<_> = arm.commands.iter().map(tool).collect();
    let jump_m = |at: &[genmanip_core::glam::DVec3]| (at[2] - 2.0 * at[1] + at[0]).length();
    // The first command sets out from rest.
    let worst_m = path[2..].windows(3).map(jump_m).fold(0.0, f64::max);
    assert!(worst_m < 1e-3, "{worst_m} m, {report:?}");
}

/// Policy that moves the first joint, and thinks for long after the tenth action.
struct Thinker {
    acted: usize,
}

impl Policy for Thinker {
    fn spec(&self) -> PolicySpec {
        PolicySpec::native("thinker", 60.0)
    }

    fn reset(&mut self, _start: &EpisodeStart) -> Result<(), PolicyError> {
        Ok(())
    }

    fn act(&mut self, observation: &Observation) -> Result<ActionChunk, PolicyError> {
        self.acted += 1;
        let mut action: Vec<f32> = observation.state[Observation::COMMAND].iter().map(|&value| value as f32).collect();
        action[0] += 0.01;
        Ok(ActionChunk { actions: vec![action], finished: self.acted == 40 })
    }
}

#[test]
fn an_arm_stops_for_a_person_and_by_itself_and_stays_still_in_a_dry_run() {
    let stage = scenarios::empty_stage(worlds::read_world(None).unwrap()).unwrap();
    let settings = RolloutSettings::default();
    let limits = ArmSettings { horizon_s: 30.0, dry_run: false };
    let held = Arc::new(AtomicBool::new(true));
    let mut moved = arm(&stage, limits.clone(), SimulatedArmSettings::default(), &held);
    let start = moved.joint_positions().unwrap()[0];
    run_policy(&mut moved, &stage, &mut Thinker { acted: 0 }, Seed::new(1), &settings).unwrap();
    moved.hold(0.5).unwrap();
    let way = moved.joint_positions().unwrap()[0] - start;
    assert!((way - 0.4).abs() < 0.01, "{way}");
    let camera = stage.scenario.world.cameras[0].name.clone();
    let request = genmanip_core::CameraRequest::new(&camera, ImageChannels::RGBD).sized(64, 48);
    let image = Arc::clone(&moved.observe(&[request]).unwrap().images[&camera]);
    assert_eq!((image.rgb.len(), image.depth_m.len()), (64 * 48 * 3, 64 * 48));
    assert!(image.depth_m.iter().filter(|depth_m| **depth_m > 0.1).count() > 1000);

    held.store(false, Ordering::Relaxed);
    let stopped = run_policy(&mut moved, &stage, &mut Thinker { acted: 0 }, Seed::new(1), &settings).unwrap_err();
    assert!(matches!(&stopped, RolloutError::Robot(why) if why.to_string().contains("a person")), "{stopped}");

    held.store(true, Ordering::Relaxed);
    let dry = ArmSettings { dry_run: true, ..limits };
    let mut still = arm(&stage, dry, SimulatedArmSettings::default(), &held);
    run_policy(&mut still, &stage, &mut Thinker { acted: 0 }, Seed::new(1), &settings).unwrap();
    let report = still.dry_report();
    assert_eq!((report.commands, report.beyond_limits), (40, 0));
    assert!((still.joint_positions().unwrap()[0] - start).abs() < 1e-3 && still.client().tally().commands == 0);
    assert!((report.largest_step_rad - 0.01).abs() < 1e-3, "{report:?}");
}

/// A table in the way: the reflex stops the arm, the bridge recovers it, and the run goes on until it is given up.
#[test]
fn an_arm_that_hits_the_table_recovers_and_gives_up_in_the_end() {
    let stage = scenarios::empty_stage(worlds::read_world(None).unwrap()).unwrap();
    let held = Arc::new(AtomicBool::new(true));
    let limits = ArmSettings { horizon_s: 60.0, dry_run: false };
    let flaws = SimulatedArmSettings { reflex_n: 30.0, ..SimulatedArmSettings::default() };
    let mut arm = arm(&stage, limits, flaws, &held);
    let mut command: Vec<f32> = arm.command().unwrap();
    let mut ended = None;
    for _ in 0..1200 {
        command[1] = (command[1] + 0.01).min(1.7);
        if let Err(error) = arm.step(&command) {
            ended = Some(error.to_string());
            break;
        }
    }
    let (tally, said) = (arm.client().tally().clone(), ended.unwrap_or_default());
    assert!(tally.errors.contains_key("cartesian_reflex") && tally.starts > 1, "{tally:?} {said}");
    assert!(said.contains("cartesian_reflex"), "{said} {tally:?}");
}

#[test]
fn policies_that_read_the_simulators_truth_are_refused() {
    let stage = scenarios::empty_stage(worlds::read_world(None).unwrap()).unwrap();
    let rehearsal = Rehearsal::new(
        &stage,
        BridgeSettings::default(),
        SimulatedArmSettings::default(),
        LinkSettings::default(),
        Seed::new(1),
    );
    let client =
        ArmClient::connect(rehearsal.unwrap(), ClientSettings::default(), Arc::new(AtomicBool::new(true))).unwrap();
    let mut arm = RealArm::new(client, &stage, ArmSettings { horizon_s: 5.0, dry_run: false }, Rig::default()).unwrap();
    assert!(arm.truth().unwrap_err().to_string().contains("no simulator truth"));
}
