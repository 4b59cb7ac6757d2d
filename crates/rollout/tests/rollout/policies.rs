//! The episode loop with policies that stand still, fail, exceed limits or never end.

use std::sync::{Arc, Mutex};

use genmanip_core::{
    ActionChunk, ActionFrame, ActionSpace, ActionSpec, CameraRequest, Ending, Episode, EpisodeResult, EpisodeStart,
    FailureCause, GripperEncoding, ImageChannels, Observation, Policy, PolicyError, PolicySpec, RotationEncoding, Seed,
};
use genmanip_rollout::policies::DoNothing;
use genmanip_rollout::{RolloutError, RolloutSettings, run_episode};

use crate::{any_stage, episodes};

type Reply = Box<dyn FnMut(&Observation) -> Result<ActionChunk, PolicyError> + Send>;

/// A policy with scripted replies.
struct Scripted {
    spec: PolicySpec,
    reply: Reply,
}

impl Scripted {
    fn new(reply: impl FnMut(&Observation) -> Result<ActionChunk, PolicyError> + Send + 'static) -> Self {
        let spec = PolicySpec::native("scripted", 60.0);
        Self { spec, reply: Box::new(reply) }
    }

    /// Always returns the same actions.
    fn always(actions: Vec<Vec<f32>>, finished: bool) -> Self {
        Self::new(move |_| Ok(ActionChunk { actions: actions.clone(), finished }))
    }
}

impl Policy for Scripted {
    fn spec(&self) -> PolicySpec {
        self.spec.clone()
    }

    fn reset(&mut self, start: &EpisodeStart) -> Result<(), PolicyError> {
        assert!(start.scenario.is_none(), "only privileged policies receive the scenario");
        assert!(!start.instruction.is_empty());
        Ok(())
    }

    fn act(&mut self, observation: &Observation) -> Result<ActionChunk, PolicyError> {
        assert!(observation.privileged.is_none(), "only privileged policies receive ground truth");
        assert_eq!(observation.state["observation.state"].len(), 8);
        (self.reply)(observation)
    }
}

fn settings(horizon_s: f64) -> RolloutSettings {
    RolloutSettings { horizon_s, settle_s: 0.1, ..RolloutSettings::default() }
}

fn run(policy: &mut dyn Policy, horizon_s: f64) -> Result<Episode, RolloutError> {
    run_episode(any_stage(), policy, "test", Seed::new(1), &settings(horizon_s))
}

/// The robot's home with the gripper open.
fn home() -> Vec<f32> {
    let robot = &any_stage().robot;
    robot.home.iter().chain([&robot.gripper.max_width]).map(|&value| value as f32).collect()
}

#[test]
fn doing_nothing_solves_nothing() {
    for (stage, _) in episodes() {
        let mut policy = DoNothing { duration_s: 1.0 };
        let episode = run_episode(stage, &mut policy, "still", Seed::new(1), &RolloutSettings::default()).unwrap();
        let result = &episode.result;
        assert!(!result.success && !result.success_once && !result.oracle);
        assert_eq!((result.failures[0].cause, result.ending), (FailureCause::GoalMissed, Some(Ending::Finished)));
        assert!(!result.failures[0].evidence.is_empty());
        assert_eq!(episode.frames.len(), 120, "one second, and one to settle");
        assert!(result.tcp_path_m < 0.01, "it moved {} m", result.tcp_path_m);
    }
}

fn rgb(camera: &str) -> CameraRequest {
    CameraRequest::new(camera, ImageChannels::RGB)
}

fn ids(camera: &str) -> CameraRequest {
    CameraRequest::new(camera, ImageChannels { ids: true, ..ImageChannels::RGBD })
}

/// Unsupported specifications are rejected before anything moves, with helpful messages.
#[test]
fn unsupported_specifications_are_rejected() {
    type Change = fn(&mut PolicySpec);
    let cases: [(Change, &str); 12] = [
        (|spec| spec.rate_hz = 7.0, "divide the control rate of 60 Hz, such as 10, 15, 20, 30 or 60; got 7"),
        (|spec| spec.rate_hz = 120.0, "got 120"),
        (|spec| spec.rate_hz = 0.0, "got 0"),
        (|spec| spec.rate_hz = f64::NAN, "got NaN"),
        (|spec| spec.rate_hz = -60.0, "got -60"),
        (
            |spec| (spec.action.space, spec.action.frame) = (ActionSpace::EePose, ActionFrame::EndEffector),
            "frame of the action: expected world for ee_pose, got end_effector",
        ),
        (|spec| spec.action.gripper.binary_threshold = Some(f64::NAN), "expected a finite number, got NaN"),
        (|spec| spec.state_keys = vec!["observation.force".into()], "unknown state key `observation.force`"),
        (
            |spec| spec.cameras = vec![rgb("ceiling")],
            "no camera `ceiling`; its cameras are overview, left, right, static",
        ),
        (|spec| spec.cameras = vec![rgb("wrist"), rgb("static"), rgb("wrist")], "camera `wrist` is requested twice"),
        (|spec| spec.cameras = vec![rgb("wrist").sized(0, 64)], "0 x 64 pixels"),
        (|spec| spec.cameras = vec![ids("wrist")], "instance ids, which are simulator ground truth"),
    ];
    for (change, wanted) in cases {
        let mut policy = Scripted::new(|_| unreachable!("a rejected policy is never queried"));
        change(&mut policy.spec);
        let error = run(&mut policy, 1.0).unwrap_err();
        assert!(matches!(error, RolloutError::Spec { .. }), "{error:?}");
        let message = error.to_string();
        assert!(message.contains("`scripted` is not supported") && message.contains(wanted), "{message}");
    }
}

/// A policy that cannot serve an episode gives a result with a cause, and the episode up to there is kept.
#[test]
fn a_failing_policy_gives_a_result() {
    let mut policy = Scripted::new(|_| Err(PolicyError::Unsuited("no such robot".into())));
    let episode = run(&mut policy, 1.0).unwrap();
    let [failure, rest @ ..] = &episode.result.failures[..] else { panic!("{:?}", episode.result) };
    assert_eq!((failure.cause, episode.result.ending), (FailureCause::Policy, Some(Ending::GaveUp)));
    assert!(rest.iter().any(|seen| seen.cause == FailureCause::GoalMissed), "all causes are reported");
    assert!(failure.evidence.contains("no such robot"), "{}", failure.evidence);
    assert_eq!(episode.frames.len(), 6, "the last command is held while settling");
}

/// A mistake of a policy's program is no failure of the policy: the episode is not run, and the mistake is named.
#[test]
fn a_mistake_leaves_the_episode_not_run() {
    let nan = || [home(), vec![f32::NAN; 8]].to_vec();
    let infinite = || vec![[&home()[..7], &[f32::INFINITY]].concat()];
    let cases: [(&str, Scripted, &str); 7] = [
        ("no action", Scripted::always(Vec::new(), false), "returned no action"),
        ("NaN", Scripted::always(nan(), false), "action for control step 1: number 0 of the action is NaN"),
        ("infinite", Scripted::always(infinite(), true), "number 7 of the action is inf"),
        (
            "too short",
            Scripted::always(vec![vec![0.0; 7]], false),
            "expected 8 numbers (joint_position, gripper width_m), got 7",
        ),
        ("too long", Scripted::always(vec![vec![0.0; 9]], false), "got 9"),
        ("empty action", Scripted::always(vec![Vec::new()], true), "got 0"),
        ("raised", Scripted::new(|_| Err(PolicyError::Mistake("act() raised KeyError".into()))), "raised KeyError"),
    ];
    for (name, mut policy, wanted) in cases {
        let error = run(&mut policy, 1.0).unwrap_err();
        let RolloutError::NotRun { reason, mistake: true, .. } = &error else { panic!("{name}: {error}") };
        assert!(reason.contains(wanted), "{name}: {reason}");
    }
}

/// A pose that the arm cannot reach is held and counted, and ends the episode only if the settings say so.
#[test]
fn an_unreachable_pose_is_held_and_counted() {
    let far = [2.0, 0.0, 0.3, 1.0, 0.0, 0.0, 0.0, 0.08].to_vec();
    let policy = || {
        let mut policy = Scripted::always(vec![far.clone(); 3], true);
        policy.spec.action = ActionSpec::new(ActionSpace::EePose, GripperEncoding::WidthM);
        policy.spec.rate_hz = 15.0;
        policy
    };
    let episode = run(&mut policy(), 1.0).unwrap();
    let EpisodeResult { ending, failures, unreachable_actions, .. } = &episode.result;
    assert_eq!((*ending, *unreachable_actions), (Some(Ending::Finished), 3));
    assert_eq!(failures[0].cause, FailureCause::NoIk);
    assert!(
        failures[0].evidence.contains("3, the first at control step 0") && failures[0].evidence.contains("x 2.000")
    );
    assert_eq!(episode.frames.len(), 3 * 4 + 6);
    assert!(episode.frames.iter().all(|frame| frame.command == home()), "the command in force is held");
    let strict = RolloutSettings { stop_on_unreachable: true, ..settings(1.0) };
    let ended = run_episode(any_stage(), &mut policy(), "test", Seed::new(1), &strict).unwrap();
    assert_eq!((ended.result.ending, ended.frames.len()), (Some(Ending::GaveUp), 6));
    assert_eq!((ended.result.failures[0].cause, ended.result.unreachable_actions), (FailureCause::NoIk, 0));
}

/// Eight steps of 5 cm into the table, then up: the tool rises within two steps. The observation has the requested pose.
#[test]
fn deltas_into_the_table_do_not_wind_up() {
    let heights = Arc::new(Mutex::new(Vec::new()));
    let seen = Arc::clone(&heights);
    let mut policy = Scripted::new(move |observation| {
        let mut seen = seen.lock().unwrap();
        let (tool, target) = (&observation.state[Observation::TOOL], &observation.state[Observation::TOOL_TARGET]);
        assert_eq!(observation.state[Observation::COMMAND].len(), 8);
        assert!((tool[2] - target[2]).abs() < 0.08, "the target leads by {} m", tool[2] - target[2]);
        let turn = seen.len();
        seen.push(tool[2]);
        // From 0.40 m, eight steps to the table and eight into it.
        let step = if turn < 16 { -0.05 } else { 0.05 };
        Ok(ActionChunk { actions: vec![vec![0.0, 0.0, step, 0.0, 0.0, 0.0, 0.08]], finished: turn == 18 })
    });
    policy.spec.action = ActionSpec {
        rotation: RotationEncoding::AxisAngle,
        ..ActionSpec::new(ActionSpace::EeDelta, GripperEncoding::WidthM)
    };
    policy.spec.rate_hz = 15.0;
    run(&mut policy, 5.0).unwrap();
    let heights = heights.lock().unwrap();
    let (pressed, raised) = (heights[16], heights[18]);
    assert!(pressed < 0.03 && raised > pressed + 0.02, "{heights:?}");
}

/// Far outside all limits, the drives do what they can, and the recording stays within the limits.
#[test]
fn extreme_finite_actions_keep_the_limits() {
    for value in [1e30_f32, -1e30, 100.0] {
        let episode = run(&mut Scripted::always(vec![vec![value; 8]; 30], true), 1.0).unwrap();
        assert!(!episode.result.success);
        let joints: Vec<_> = any_stage().robot.arm_joints().cloned().collect();
        for frame in &episode.frames {
            for (joint, torque) in joints.iter().zip(&frame.joint_torque) {
                assert!(*torque <= joint.max_effort + 1e-9, "{}: {torque} N·m", joint.name);
            }
            assert!(frame.joint_position.iter().all(|position| position.is_finite()));
        }
    }
}

#[test]
fn the_time_limit_ends_a_policy_that_does_not() {
    let long = vec![home(); 1000];
    let slow = |rate_hz| {
        let mut policy = Scripted::always(vec![home()], false);
        policy.spec.rate_hz = rate_hz;
        policy
    };
    let cases = [
        ("one action at a time", Scripted::always(vec![home()], false)),
        ("one chunk longer than the horizon", Scripted::always(long.clone(), false)),
        ("a chunk that would have finished later", Scripted::always(long, true)),
        ("an action that lasts longer than what is left", slow(7.5)),
    ];
    for (name, mut policy) in cases {
        let episode = run(&mut policy, 0.5).unwrap();
        let failure = &episode.result.failures[0];
        assert_eq!(episode.result.ending, Some(Ending::Horizon), "{name}");
        assert_eq!(
            (failure.cause, failure.evidence.as_str()),
            (FailureCause::Timeout, "not finished after 0.5 s"),
            "{name}"
        );
        assert_eq!(episode.frames.len(), 30 + 6, "{name}: time limit and settling");
    }
}

/// `rate_hz` repeats actions, `execute_steps` cuts chunks, `finished` counts only for a completely executed chunk.
#[test]
fn rate_and_chunks_follow_the_specification() {
    let mut policy =
        Scripted::new(|observation| Ok(ActionChunk { actions: vec![home(); 5], finished: observation.time_s > 0.2 }));
    (policy.spec.rate_hz, policy.spec.execute_steps) = (20.0, 2);
    let episode = run(&mut policy, 1.0).unwrap();
    assert_eq!(episode.result.failures[0].cause, FailureCause::Timeout, "two of five actions never finish a chunk");

    policy.spec.execute_steps = 5;
    let episode = run(&mut policy, 1.0).unwrap();
    assert_eq!(episode.result.failures[0].cause, FailureCause::GoalMissed);
    assert_eq!(episode.frames.len(), 2 * 5 * 3 + 6, "queried at 0 s and 0.25 s; five actions of three steps; settling");
}

/// An unreachable policy leaves no result, neither at the start nor in the middle.
#[test]
fn an_unreachable_policy_gives_no_result() {
    let mut policy = Scripted::new(|observation| match observation.time_s {
        begin if begin < 0.2 => Ok(ActionChunk { actions: vec![home()], finished: false }),
        _ => Err(PolicyError::Unreachable("connection refused".into())),
    });
    let error = run(&mut policy, 1.0).unwrap_err();
    let RolloutError::NotRun { policy, reason, mistake: false } = error else { panic!("{error}") };
    assert_eq!((policy.as_str(), reason.as_str()), ("scripted", "connection refused"));
}
