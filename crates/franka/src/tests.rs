//! The driver on a bridge, against arms and hands on loopback.

mod fake;

use std::sync::Arc;
use std::thread::sleep;
use std::time::Duration;

use genmanip_real::bridge::{
    Bridge, BridgeRobot, BridgeSettings, Command, Driver, JointLimits, Reading, Reply, Request, State,
};

use self::fake::Fake;
use crate::{FrankaArm, Hand, HandSettings, RealtimeConfig, Robot};

const HELD: [f64; 7] = [0.1, -0.5, 0.2, -2.0, 0.1, 1.9, 0.7];

/// More than the jerk limits allow in the first millisecond, rad; the fake measures 1 mrad beside the held position.
const FIRST_STEP_RAD: f64 = 1e-5;

/// Bridge of an arm, with one client.
struct Rig<'a> {
    arm: FrankaArm<'a>,
    bridge: Bridge,
    /// Time of the bridge, s: one control period after the other, however long they take.
    now_s: f64,
    lease: u64,
    sequence: u64,
}

impl<'a> Rig<'a> {
    fn new(robot: &'a Robot) -> Self {
        let mut arm = FrankaArm::new(robot, None);
        let facts = BridgeRobot {
            name: "fake".into(),
            joints: JointLimits::PANDA.to_vec(),
            max_width_m: 0.0,
            tool: Arc::new(|arm: &[f64]| [arm[0], 0.0, 0.0]),
        };
        let settings = BridgeSettings { recovery_after_s: 0.02, ..BridgeSettings::default() };
        let mut bridge = Bridge::new(facts, settings, arm.read().unwrap()).unwrap();
        let Some(Reply::Lease { lease }) = bridge.handle(0.0, &Request::Acquire {}) else { panic!("no lease") };
        Self { arm, bridge, now_s: 0.0, lease, sequence: 0 }
    }

    /// On its way to a point where every joint is 0.3 rad farther.
    fn in_motion(robot: &'a Robot) -> Self {
        let mut rig = Self::new(robot);
        assert!(matches!(rig.ask_to_start(), Some(Reply::Started { .. })));
        rig.command(HELD.map(|position| position + 0.3));
        rig.until(|state| state.setpoints[0] > HELD[0] + 0.1);
        rig
    }

    fn ask_to_start(&mut self) -> Option<Reply> {
        let start = Request::Start { lease: self.lease, dead_man: true, speed: 1.0, workspace_m: None };
        self.bridge.handle(self.now_s, &start)
    }

    fn command(&mut self, positions: [f64; 7]) {
        self.sequence += 1;
        let command = Command {
            lease: self.lease,
            sequence: self.sequence,
            valid_for_s: 1.0,
            dead_man: true,
            positions: positions.to_vec(),
            over_s: 0.0,
            width_m: None,
        };
        let refused = self.bridge.handle(self.now_s, &Request::Command(command));
        assert!(refused.is_none(), "{refused:?}");
    }

    /// One control period.
    fn tick(&mut self) -> Reading {
        let reading = self.arm.read().unwrap();
        self.now_s += 1e-3;
        let orders = self.bridge.tick(self.now_s, reading.clone());
        self.arm.write(&orders).unwrap();
        reading
    }

    /// Control periods until the state is as wanted.
    fn until(&mut self, wanted: impl Fn(&State) -> bool) -> State {
        for _ in 0..3000 {
            self.tick();
            let state = self.bridge.state(self.now_s);
            if wanted(&state) {
                return state;
            }
        }
        panic!("never: {:?}", self.bridge.state(self.now_s));
    }

    fn release(&mut self) {
        let release = Request::Release { lease: self.lease, keep: true };
        assert_eq!(self.bridge.handle(self.now_s, &release), Some(Reply::Released));
    }
}

fn robot(fake: &Fake) -> Robot {
    Robot::new(&fake.address, RealtimeConfig::Ignore).unwrap()
}

/// Largest change of a joint between two setpoints, rad.
fn step(before: &[f64; 7], after: &[f64; 7]) -> f64 {
    before.iter().zip(after).map(|(before, after)| (after - before).abs()).fold(0.0, f64::max)
}

/// Motions begin where the controller holds the arm, not where it is measured, and end at rest at the target.
#[test]
fn a_motion_begins_at_the_held_position_and_ends_at_rest() {
    let fake = Fake::arm(HELD);
    let robot = robot(&fake);
    let mut rig = Rig::new(&robot);
    (0..20).for_each(|_| drop(rig.tick()));
    assert!(fake.facts().setpoints.is_empty(), "a bridge that stands moves nothing");
    for target in [HELD.map(|position| position + 0.05), HELD] {
        let facts = fake.facts().clone();
        let (held, before) = (facts.held, facts.setpoints.len());
        assert!(matches!(rig.ask_to_start(), Some(Reply::Started { .. })));
        rig.command(target);
        rig.until(|state| state.setpoints.iter().zip(target).all(|(at, wanted)| (at - wanted).abs() < 1e-9));
        rig.release();
        let finished = fake.facts().finished;
        (0..1000).take_while(|_| fake.facts().finished == finished).for_each(|_| drop(rig.tick()));
        let facts = fake.facts().clone();
        assert_eq!(facts.finished, finished + 1);
        let setpoints = &facts.setpoints[before..];
        assert!(step(&held, &setpoints[0].1) < FIRST_STEP_RAD, "{:?}", setpoints[0]);
        assert!(step(&target, &setpoints.last().unwrap().1) < 1e-9);
        assert!(setpoints.windows(2).all(|pair| step(&pair[0].1, &pair[1].1) < 0.06));
    }
    assert_eq!((rig.arm.report().motions, rig.arm.report().aborts.len()), (2, 0));
}

/// Setpoints keep the arm's clock when states are lost: as many periods are made up for as were missed.
#[test]
fn lost_states_do_not_hold_the_setpoints_back() {
    let fake = Fake::arm(HELD);
    let robot = robot(&fake);
    let mut rig = Rig::in_motion(&robot);
    fake.facts().lose = 6;
    rig.until(|state| (state.setpoints[0] - HELD[0] - 0.3).abs() < 1e-9);
    let report = rig.arm.report();
    assert!(report.most_missed >= 6, "{report:?}");
    // Between setpoints as many periods pass as between the states that they answer.
    let facts = fake.facts().clone();
    for pair in facts.setpoints.windows(2) {
        let [(first, before), (second, after)] = pair else { panic!("a pair") };
        let speed = step(before, after) / (1e-3 * (second - first).max(1) as f64);
        assert!(speed <= JointLimits::PANDA[4].velocity * 1.001, "{speed} rad/s at state {second}");
    }
    let gap = facts.setpoints.windows(2).map(|pair| pair[1].0 - pair[0].0).max();
    assert!(gap >= Some(7), "{gap:?}");
    let [(_, before), (_, after)] = *facts.setpoints.windows(2).max_by_key(|pair| pair[1].0 - pair[0].0).unwrap()
    else {
        panic!("a pair")
    };
    assert!(step(&before, &after) > 5.0 * 1e-3 * 0.5, "the setpoints stood still while states were lost");
}

/// A reflex stops the bridge with its word; recovery clears it, and the next start makes no step.
#[test]
fn a_reflex_is_named_and_recovered() {
    let fake = Fake::arm(HELD);
    let robot = robot(&fake);
    let mut rig = Rig::in_motion(&robot);
    fake.facts().trip = true;
    let state = rig.until(|state| !state.errors.is_empty());
    assert_eq!(state.errors, ["cartesian_reflex"]);
    assert!(matches!(rig.ask_to_start(), Some(Reply::Refused { word, .. }) if word == "arm_errors"));
    rig.until(|state| state.errors.is_empty());
    let facts = fake.facts().clone();
    assert!(matches!(rig.ask_to_start(), Some(Reply::Started { .. })));
    rig.command(HELD);
    rig.until(|state| (state.setpoints[0] - HELD[0]).abs() < 1e-9);
    let first = fake.facts().setpoints[facts.setpoints.len()].1;
    assert!(step(&facts.held, &first) < FIRST_STEP_RAD);
    let report = rig.arm.report();
    assert_eq!((report.aborts.get("cartesian_reflex"), report.recoveries), (Some(&1), 1), "{report:?}");
}

/// The end of the arm's connection ends the driver with a message instead of a wait.
#[test]
fn a_lost_arm_is_an_error() {
    let fake = Fake::arm(HELD);
    let robot = robot(&fake);
    let mut arm = FrankaArm::new(&robot, None);
    arm.read().unwrap();
    drop(fake);
    let error = (0..100).find_map(|_| arm.read().err()).unwrap();
    assert!(error.0.contains("the connection to the arm is lost"), "{error}");
}

/// Control periods until the hand is as wanted, and some more for the answer to its command.
fn wait_for(hand: &mut Hand, wanted: impl Fn(&Hand) -> bool) {
    let mut left = None;
    for _ in 0..2000 {
        hand.tick(None);
        left = left.map(|left: usize| left - 1).or_else(|| wanted(hand).then_some(20));
        if left == Some(0) {
            return;
        }
        sleep(Duration::from_millis(1));
    }
    panic!("never: {hand:?}");
}

/// A command that is kept from ending by an object is stopped before the next one is sent.
#[test]
fn the_hand_grasps_opens_and_changes_its_mind() {
    let fake = Fake::hand(0.08);
    let mut hand = Hand::connect(&fake.address, HandSettings::default()).unwrap();
    assert_eq!(hand.width_m(), 0.08);
    fake.facts().object_m = 0.03;
    hand.tick(Some(0.0));
    wait_for(&mut hand, |hand| hand.width_m() == 0.03);
    hand.tick(Some(0.08));
    wait_for(&mut hand, |hand| hand.width_m() == 0.08);
    fake.facts().object_m = 0.0;
    hand.tick(Some(0.02));
    wait_for(&mut hand, |hand| hand.width_m() == 0.02);
    // Grasp, stop, move, grasp.
    let commands: Vec<u16> = fake.facts().commands.iter().map(|(command, _)| *command).collect();
    assert_eq!(commands, [2, 4, 3, 2]);
    drop(fake);
    wait_for(&mut hand, Hand::is_lost);
    assert!(hand.reconnect().is_err());
}
