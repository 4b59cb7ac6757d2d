//! Bridge without connection: gripper words, workspace box, slow mode, recovery.

use super::fake::{FakeArm, robot};
use super::*;

/// Bridge and arm on a clock that the test advances.
struct Rig {
    bridge: Bridge,
    arm: FakeArm,
    now_s: f64,
    lease: u64,
    sequence: u64,
}

impl Rig {
    fn new(settings: BridgeSettings) -> Self {
        let arm = FakeArm::new();
        let mut bridge = Bridge::new(robot().0, settings, arm.reading()).unwrap();
        let Some(Reply::Lease { lease }) = bridge.handle(0.0, &Request::Acquire {}) else { panic!("no lease") };
        Self { bridge, arm, now_s: 0.0, lease, sequence: 0 }
    }

    fn start(&mut self, speed: f64, workspace_m: Option<[[f64; 3]; 2]>) -> Option<Reply> {
        let start = Request::Start { lease: self.lease, dead_man: true, speed, workspace_m };
        self.bridge.handle(self.now_s, &start)
    }

    fn command(&mut self, positions: &[f64], width_m: Option<f64>) -> Option<Reply> {
        self.sequence += 1;
        let command = Command { width_m, ..command(self.lease, self.sequence, positions.to_vec()) };
        self.bridge.handle(self.now_s, &Request::Command(command))
    }

    /// Ticks for a time, sending the command 60 times a second.
    fn run(&mut self, time_s: f64, positions: &[f64], width_m: Option<f64>) {
        for tick in 0..(time_s / TICK_S) as usize {
            if tick % 16 == 0 {
                self.command(positions, width_m);
            }
            self.tick();
        }
    }

    fn tick(&mut self) {
        self.now_s += TICK_S;
        let orders = self.bridge.tick(self.now_s, self.arm.reading());
        self.arm.follow(&orders);
    }

    fn state(&self) -> State {
        self.bridge.state(self.now_s)
    }
}

fn word(reply: Option<Reply>) -> String {
    match reply {
        Some(Reply::Refused { word, .. }) => word,
        other => format!("{other:?}"),
    }
}

#[test]
fn gripper_commands_end_in_time_with_a_word() {
    // (object, target, word at the end)
    let cases = [
        (0.0, 0.03, GripperWord::Arrived),
        (0.0, 0.0, GripperWord::Arrived),
        (0.05, 0.0, GripperWord::Holding),
        (0.05, 0.06, GripperWord::Arrived),
    ];
    for (object_m, target_m, expected) in cases {
        let mut rig = Rig::new(BridgeSettings::default());
        rig.arm.object_m = object_m;
        rig.start(1.0, None);
        rig.run(0.1, &[0.3, -0.5], Some(target_m));
        assert_eq!(rig.state().gripper.unwrap().word, GripperWord::Moving);
        rig.run(1.4, &[0.3, -0.5], Some(target_m));
        assert_eq!(rig.state().gripper.unwrap().word, expected, "object {object_m}, target {target_m}");
    }
    // Fingers that creep for ever, and fingers that do not open.
    let mut monitor = GripperMonitor::new(0.08, GripperSettings::default());
    monitor.want(0.0);
    let mut now_s = 0.0;
    while now_s < 3.1 {
        monitor.tick(now_s, 0.08 - 0.01 * now_s);
        now_s += TICK_S;
    }
    assert_eq!(monitor.state(0.05).word, GripperWord::TimedOut);
    monitor.want(0.08);
    for _ in 0..300 {
        monitor.tick(now_s, 0.05);
        now_s += TICK_S;
    }
    assert_eq!(monitor.state(0.05).word, GripperWord::Blocked);
}

#[test]
fn a_ramp_of_widths_gives_the_gripper_few_commands() {
    let mut monitor = GripperMonitor::new(0.08, GripperSettings::default());
    let given = (0..=100).filter_map(|step| {
        monitor.want(0.04 * (1.0 - f64::from(step) / 100.0));
        monitor.tick(f64::from(step) * TICK_S, 0.04)
    });
    let given: Vec<f64> = given.collect();
    assert!(given.len() <= 22 && given.last() == Some(&0.0), "{given:?}");
}

#[test]
fn the_tool_stays_in_its_box() {
    let settings = BridgeSettings { workspace_m: Some([[0.2, -0.5, -0.1], [0.98, 0.6, 0.1]]), ..Default::default() };
    let mut rig = Rig::new(settings);
    rig.start(1.0, None);
    assert_eq!(word(rig.command(&[0.0, 0.0], None)), "workspace", "stretched: 1 m from the base");
    // Both ends are inside, but the way leads out: the arm is stretched in the middle.
    rig.run(3.0, &[0.1, 0.6], None);
    let state = rig.state();
    assert_eq!((state.motion, state.reason), (Motion::Standing, Some(StopReason::Workspace)));
    let tool = (robot().0.tool)(&state.positions);
    assert!(tool[0] < 0.981 && tool[0] > 0.975, "{tool:?}");
    // The way back is open, and a client's box is respected too.
    rig.start(1.0, Some([[0.0, -1.0, -1.0], [0.9, 1.0, 1.0]]));
    assert_eq!(word(rig.command(&[0.3, -0.5], None)), "workspace");
    rig.run(2.0, &[0.1, -1.3], None);
    assert!((rig.state().positions[1] + 1.3).abs() < 1e-6, "{:?}", rig.state());
}

#[test]
fn slow_mode_bounds_the_speed() {
    let mut rig = Rig::new(BridgeSettings { top_speed: 0.5, ..Default::default() });
    assert_eq!(word(rig.start(0.6, None)), "speed");
    assert_eq!(word(rig.start(f64::NAN, None)), "speed");
    rig.start(0.1, None);
    rig.run(1.0, &[1.5, -0.5], None);
    let speed = rig.state().velocities[0];
    assert!(speed > 0.21 && speed <= 0.2175 * SLACK, "{speed}");
    assert_eq!(word(rig.start(0.5, None)), "moving");
}

#[test]
fn a_reflex_is_recovered_and_resumed_without_a_jump() {
    let mut rig = Rig::new(BridgeSettings::default());
    rig.start(1.0, None);
    rig.run(0.3, &[1.5, 0.5], Some(0.02));
    // The arm stops by itself, away from its setpoints.
    rig.arm.errors = vec!["cartesian_reflex".into()];
    rig.arm.joints = vec![JointState::at_rest(0.4), JointState::at_rest(-0.4)];
    rig.tick();
    let state = rig.state();
    assert_eq!(state.errors, ["cartesian_reflex"]);
    assert_eq!(
        (state.motion, state.reason, state.recovery),
        (Motion::Standing, Some(StopReason::Arm), Recovery::Recovering)
    );
    assert_eq!(word(rig.start(1.0, None)), "arm_errors");
    rig.run(0.6, &[1.5, 0.5], None);
    assert_eq!((rig.state().recovery, rig.state().motion), (Recovery::None, Motion::Standing));
    let before = rig.state().positions;
    rig.start(1.0, None);
    rig.command(&[1.5, 0.5], None);
    rig.tick();
    let tool = robot().0.tool;
    let (a, b) = (tool(&before), tool(&rig.arm.reading().positions));
    assert!((a[0] - b[0]).hypot(a[1] - b[1]) < 1e-5, "{a:?} {b:?}");
    // An arm that does not recover is left to a person after three attempts.
    rig.arm.errors = vec!["joint_reflex".into()];
    rig.arm.needed_recoveries = 9;
    rig.run(5.0, &[1.5, 0.5], None);
    assert_eq!((rig.state().recovery, rig.arm.needed_recoveries), (Recovery::GivenUp, 7));
}

/// An arm that holds a position of its own starts there, not where it is measured, also after an error.
#[test]
fn a_motion_starts_where_the_arm_holds_itself() {
    let mut rig = Rig::new(BridgeSettings::default());
    let held = [0.301, -0.502];
    let reading = |errors: &[&str]| Reading {
        held: held.to_vec(),
        errors: errors.iter().map(|word| (*word).to_owned()).collect(),
        ..FakeArm::new().reading()
    };
    rig.now_s += TICK_S;
    assert!(!rig.bridge.tick(rig.now_s, reading(&[])).is_active);
    assert!(matches!(rig.start(1.0, None), Some(Reply::Started { .. })));
    let orders = rig.bridge.tick(rig.now_s, reading(&[]));
    assert!(orders.is_active);
    let at = |orders: &Orders| orders.setpoints.iter().map(|joint| joint.position).collect::<Vec<_>>();
    assert_eq!(at(&orders), held);
    let orders = rig.bridge.tick(rig.now_s, reading(&["reflex"]));
    assert!(!orders.is_active);
    assert_eq!(at(&orders), held);
}

/// Control periods whose measurements were lost count: the setpoints are where they would be without the loss.
#[test]
fn setpoints_make_up_for_lost_control_periods() {
    let ends = [vec![0; 42], vec![0, 9, 0, 0, 4, 5, 0, 0, 14, 0]].map(|losses| {
        let mut rig = Rig::new(BridgeSettings::default());
        rig.tick();
        rig.start(1.0, None);
        rig.command(&[0.6, -0.2], None);
        let mut last = Vec::new();
        for missed in losses {
            rig.now_s += TICK_S * (1 + missed) as f64;
            last = rig.bridge.tick(rig.now_s, Reading { missed, ..rig.arm.reading() }).setpoints;
        }
        last
    });
    assert_eq!(ends[0], ends[1]);
    assert!(ends[0][0].velocity > 0.1, "{:?}", ends[0]);
}
