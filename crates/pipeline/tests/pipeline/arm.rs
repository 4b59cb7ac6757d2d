//! Policies on an arm behind the bridge, on a clock that the test's client advances.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use genmanip_core::{
    ActionChunk, Ending, EpisodeStart, ImageChannels, Observation, Policy, PolicyError, PolicySpec, Seed, TaskKind,
};
use genmanip_motion::PlannerSettings;
use genmanip_pipeline::PolicyFactory;
use genmanip_pipeline::evaluate::Suite;
use genmanip_pipeline::policies::PolicyContext;
use genmanip_pipeline::real::arm::{ArmSettings, RealArm};
use genmanip_pipeline::real::cameras::Rig;
use genmanip_pipeline::real::rehearsal::Rehearsal;
use genmanip_pipeline::real::simulated::SimulatedArmSettings;
use genmanip_real::bridge::client::{ArmClient, ClientSettings};
use genmanip_real::bridge::{BridgeSettings, LinkSettings};
use genmanip_rollout::collect::Resources;
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
