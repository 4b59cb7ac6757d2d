//! Drills of an arm behind a running bridge: starts and resumes, gripper commands, a collision and its recovery.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use genmanip_core::RobotModel;
use genmanip_real::bridge::client::{ArmClient, BridgeError, ClientSettings, TcpConnection};
use genmanip_real::bridge::{GripperWord, Motion};
use genmanip_workspace::{WorkspaceError, worlds};
use serde::Serialize;

/// Time between commands, s.
const PERIOD_S: f64 = 0.02;
/// Number of starts, and of resumes out of motions.
const STARTS: usize = 5;
/// Time for which the arm holds its position after each, s.
const HOLD_S: f64 = 0.5;
/// Largest turn of the first joint, rad; the tool goes 11 cm aside.
const TURN_RAD: f64 = 0.2;
/// Time after which a gripper command must have ended, s: the limit of a bridge to a slow gripper, and a little for the
/// connection.
const GRIPPER_S: f64 = 5.0;
/// Time after which the arm must have recovered, s.
const RECOVERY_S: f64 = 5.0;

/// Results of the drills.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Drills {
    /// Number of starts and resumes.
    pub starts: usize,
    /// Largest distance of the tool from where it stood, while it was to hold its position after a start, mm.
    pub start_jump_mm: f64,
    /// The same after a resume out of a motion.
    pub resume_jump_mm: f64,
    /// Gripper commands in their order.
    pub gripper: Vec<GripperDrill>,
    /// Collision with the post; `None` without one.
    pub collision: Option<Collision>,
}

/// A gripper command and its end.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct GripperDrill {
    /// Width that was asked for, m.
    pub wanted_m: f64,
    /// Word at the end.
    pub word: GripperWord,
    /// Width at the end, m.
    pub width_m: f64,
    /// Time to the end, s.
    pub took_s: f64,
}

/// A collision and its recovery.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Collision {
    /// Error words of the arm.
    pub errors: Vec<String>,
    /// Time from the first state with errors to the first without, s.
    pub recovered_s: f64,
    /// Largest distance of the tool from where it stood, while it was to hold its position after the recovery, mm.
    pub jump_mm: f64,
}

/// Runs the drills on the bridge at an address. The tool needs 12 cm of free space to its left; with `post`, a post of 3 cm
/// stands between the open fingers instead.
///
/// # Errors
/// If the bridge cannot be reached, its robot is not known, or the arm stops for good.
pub fn measure(url: &str, post: bool) -> Result<Drills, WorkspaceError> {
    let failed = |error: BridgeError| WorkspaceError::input(error.to_string());
    let connection = TcpConnection::open(url).map_err(failed)?;
    let held = Arc::new(AtomicBool::new(true));
    let client = ArmClient::connect(connection, ClientSettings::default(), held).map_err(failed)?;
    let robot = worlds::robot(&worlds::read_world_with(None, Some(&client.welcome().robot))?)?;
    let width_m = robot.gripper.max_width;
    let mut arm = Arm { client, robot, width_m };
    let mut found = Drills::default();
    (|| {
        let ends: &[f64] = if post { &[width_m, 0.0, width_m] } else { &[width_m, 0.02, 0.0, width_m] };
        for &wanted_m in ends {
            found.gripper.push(arm.gripper(wanted_m)?);
        }
        if post {
            found.collision = Some(arm.collide()?);
        } else {
            (found.start_jump_mm, found.resume_jump_mm) = arm.start_and_resume()?;
            found.starts = STARTS;
        }
        arm.client.release()
    })()
    .map_err(failed)?;
    Ok(found)
}

/// Arm of a running bridge.
struct Arm {
    client: ArmClient<TcpConnection>,
    robot: Arc<RobotModel>,
    width_m: f64,
}

impl Arm {
    fn positions(&self) -> Vec<f64> {
        self.client.state().positions.clone()
    }

    /// Sends the same command for a time; returns the largest distance of the tool from where it stood at first, mm.
    fn hold(&mut self, positions: &[f64], time_s: f64) -> Result<f64, BridgeError> {
        self.client.wait(self.client.now_s())?;
        let stood = self.robot.tcp_pose(&self.positions()).position;
        let mut farthest_m: f64 = 0.0;
        for _ in 0..(time_s / PERIOD_S) as usize {
            let begin_s = self.client.now_s();
            self.client.command(positions, self.width_m)?;
            // Several looks at the arm between commands, so that no jump passes unseen.
            for part in 1..=5 {
                self.client.wait(begin_s + PERIOD_S * f64::from(part) / 5.0)?;
                let tool = self.robot.tcp_pose(&self.positions()).position;
                farthest_m = farthest_m.max(tool.distance(stood));
            }
        }
        Ok(1e3 * farthest_m)
    }

    /// Releases the arm and waits until it is measured at rest.
    fn stop(&mut self) -> Result<(), BridgeError> {
        self.client.release()?;
        let until_s = self.client.now_s() + RECOVERY_S;
        let mut still = 0;
        while still < 10 && self.client.now_s() < until_s {
            let before = self.positions();
            self.client.wait(self.client.now_s() + PERIOD_S)?;
            let moved = before.iter().zip(&self.positions()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            still = if moved < 1e-4 && self.client.state().motion == Motion::Standing { still + 1 } else { 0 };
        }
        Ok(())
    }

    fn start_and_resume(&mut self) -> Result<(f64, f64), BridgeError> {
        let (mut start_mm, mut resume_mm): (f64, f64) = (0.0, 0.0);
        for number in 0..STARTS {
            self.stop()?;
            let at = self.positions();
            start_mm = start_mm.max(self.hold(&at, HOLD_S)?);
            let mut aside = at.clone();
            aside[0] += if number % 2 == 0 { TURN_RAD } else { -TURN_RAD };
            // Stopped on the way, at speed.
            self.hold(&aside, 0.2)?;
            self.stop()?;
            let at = self.positions();
            resume_mm = resume_mm.max(self.hold(&at, HOLD_S)?);
        }
        Ok((start_mm, resume_mm))
    }

    /// Asks for a width and waits for the word that ends the command.
    fn gripper(&mut self, wanted_m: f64) -> Result<GripperDrill, BridgeError> {
        let at = self.positions();
        let begin_s = self.client.now_s();
        self.width_m = wanted_m;
        loop {
            self.hold(&at, PERIOD_S)?;
            let took_s = self.client.now_s() - begin_s;
            let Some(state) = self.client.state().gripper else { return Err(no_gripper()) };
            let is_over = state.target_m == wanted_m && !matches!(state.word, GripperWord::Moving | GripperWord::Idle);
            if is_over && took_s > 0.1 || took_s > 2.0 * GRIPPER_S {
                return Ok(GripperDrill { wanted_m, word: state.word, width_m: state.width_m, took_s });
            }
        }
    }

    /// Turns the first joint until a finger meets the post, waits for the recovery, and goes back.
    fn collide(&mut self) -> Result<Collision, BridgeError> {
        let home = self.positions();
        let begin_s = self.client.now_s();
        while self.client.tally().arm_stops == 0 && self.client.now_s() - begin_s < RECOVERY_S {
            let mut aside = home.clone();
            aside[0] += TURN_RAD * ((self.client.now_s() - begin_s) / 2.0).min(1.0);
            self.client.command(&aside, self.width_m)?;
            let until_s = self.client.now_s() + PERIOD_S;
            self.client.wait(until_s)?;
        }
        let stopped_s = self.client.state().time_s;
        let errors = self.client.tally().errors.keys().cloned().collect();
        while !self.client.state().errors.is_empty() && self.client.state().time_s - stopped_s < RECOVERY_S {
            self.client.wait(self.client.now_s() + 0.004)?;
        }
        let recovered_s = self.client.state().time_s - stopped_s;
        self.client.wait(self.client.now_s() + HOLD_S)?;
        let jump_mm = self.hold(&self.positions(), HOLD_S)?;
        self.hold(&home, 1.0)?;
        Ok(Collision { errors, recovered_s, jump_mm })
    }
}

fn no_gripper() -> BridgeError {
    BridgeError::Refused {
        request: "command".into(),
        word: "width".into(),
        message: "the bridge has no gripper; expected one for this drill".into(),
    }
}

impl Drills {
    /// Flaws in words; empty if there are none.
    pub fn flaws(&self) -> Vec<String> {
        let mut flaws = Vec::new();
        let mut check = |is_right: bool, text: String| {
            if !is_right {
                flaws.push(text);
            }
        };
        let jumps = [self.start_jump_mm, self.resume_jump_mm, self.collision.as_ref().map_or(0.0, |it| it.jump_mm)];
        check(
            jumps.iter().all(|jump_mm| *jump_mm <= 1.0),
            format!("the tool jumped by {jumps:.2?} mm, expected 1 mm at most"),
        );
        for it in &self.gripper {
            let is_blocked = self.collision.is_some() && it.wanted_m == 0.0;
            let expected = if is_blocked { GripperWord::Holding } else { GripperWord::Arrived };
            check(
                it.word == expected && it.took_s <= GRIPPER_S,
                format!("{it:?}, expected {expected:?} within {GRIPPER_S} s"),
            );
        }
        if let Some(it) = &self.collision {
            let is_right = !it.errors.is_empty() && it.recovered_s < RECOVERY_S;
            check(is_right, format!("{it:?}, expected an error word and a recovery within {RECOVERY_S} s"));
        }
        flaws
    }

    /// Text of the drills.
    pub fn text(&self) -> String {
        let mut text = String::new();
        if self.starts > 0 {
            text += &format!(
                "{} starts and resumes: the tool moves by {:.2} mm at most after a start, {:.2} mm after a resume\n",
                self.starts, self.start_jump_mm, self.resume_jump_mm
            );
        }
        for it in &self.gripper {
            text += &format!(
                "gripper to {:.0} mm: {:?} at {:.1} mm after {:.2} s\n",
                1e3 * it.wanted_m,
                it.word,
                1e3 * it.width_m,
                it.took_s
            );
        }
        if let Some(it) = &self.collision {
            text += &format!(
                "collision: {}; recovered after {:.2} s, then the tool moves by {:.2} mm at most\n",
                it.errors.join(", "),
                it.recovered_s,
                it.jump_mm
            );
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flaws_are_named() {
        let open = GripperDrill { wanted_m: 0.08, word: GripperWord::Arrived, width_m: 0.08, took_s: 1.0 };
        let sound = Drills { starts: 5, start_jump_mm: 0.2, gripper: vec![open.clone()], ..Drills::default() };
        assert!(sound.flaws().is_empty());
        let late = GripperDrill { took_s: 6.0, ..open };
        let mute = Collision { errors: Vec::new(), recovered_s: 0.5, jump_mm: 0.0 };
        let flawed = Drills { start_jump_mm: 1.2, gripper: vec![late], collision: Some(mute), ..sound };
        assert_eq!(flawed.flaws().len(), 3, "{:?}", flawed.flaws());
    }
}
