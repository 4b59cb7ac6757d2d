//! Log of an episode: what is undone, who was in command, and idle ends.

use genmanip_teleop::device::{Device, DeviceEvent};
use genmanip_teleop::mapping::OperatorFrame;
use genmanip_teleop::record::{Stretch, Undone, events_from_lines};
use genmanip_teleop::{EpisodeLog, TeleopSettings};

use super::run;

const FRAME: OperatorFrame = OperatorFrame::World;

/// Log before the first control step.
fn empty() -> EpisodeLog {
    EpisodeLog::new(&run(TeleopSettings::default(), Vec::new(), 0).policy)
}

/// Log of 150 control steps of which the operator moves the arm in steps 60 to 69.
fn log() -> EpisodeLog {
    let key = |step, down| (step, DeviceEvent::Key { code: "KeyR".into(), down });
    let mut events = vec![(0, DeviceEvent::Connected { device: Device::Keyboard })];
    events.extend((0..60).map(|step| (step, DeviceEvent::Alive)));
    events.extend([key(60, true)]);
    events.extend((61..70).map(|step| (step, DeviceEvent::Alive)));
    events.extend([key(70, false)]);
    events.extend((71..150).map(|step| (step, DeviceEvent::Alive)));
    let run = run(TeleopSettings::default(), events, 150);
    let mut log = empty();
    log.add_operator(&run.policy, FRAME, 0, 150);
    log
}

#[test]
fn undone_steps_are_cut_and_their_events_stay_with_a_mark() {
    let mut log = log();
    let all = log.events().len();
    log.undo(65);
    log.undo(65);
    let record = log.record();
    let cut = all - log.events().len();
    assert_eq!(record.undone, [Undone { from: 65, to: 150, events: cut as u64 }], "nothing is undone twice");
    assert_eq!((cut, log.undone_steps(), record.events), (85, 85, all as u64));
    assert!(record.idle.iter().all(|idle| idle.to <= 65) && record.in_command.is_empty(), "{record:?}");
    let lines = String::from_utf8(log.lines()).unwrap();
    assert_eq!(lines.lines().count(), all);
    assert_eq!(lines.matches(r#""undone":1"#).count(), cut);
    assert_eq!(events_from_lines(&lines).unwrap(), log.events());
    log.add_policy("expert", 65, 100);
    let stretches = [
        Stretch { from: 0, to: 65, policy: None, frame: Some(FRAME) },
        Stretch { from: 65, to: 100, policy: Some("expert".into()), frame: None },
    ];
    assert_eq!(log.record().in_command, stretches);
    assert_eq!(log.trim().unwrap().cut, [54, 100], "a policy's end is not idle");
}

#[test]
fn idle_ends_are_cut_except_for_a_tenth_of_a_second() {
    let log = log();
    let trim = log.trim().unwrap();
    assert_eq!(trim.cut, [54, 76]);
    assert_eq!(trim.in_command, [Stretch { from: 0, to: 22, policy: None, frame: Some(FRAME) }]);
    let connected = trim.events.iter().find(|event| matches!(event.event, DeviceEvent::Connected { .. })).unwrap();
    assert_eq!(connected.step, 0);
    let moved: Vec<usize> = trim
        .events
        .iter()
        .filter(|event| matches!(event.event, DeviceEvent::Key { .. }))
        .map(|event| event.step)
        .collect();
    assert_eq!(moved, [6, 16]);
    // The same motion from the trimmed events.
    let events = trim.events.iter().map(|event| (event.step, event.event.clone())).collect();
    let again = run(TeleopSettings::default(), events, 22);
    let rises: Vec<bool> = again.poses.windows(2).map(|pair| pair[1].position.z - pair[0].position.z > 1e-6).collect();
    assert_eq!(rises.iter().filter(|rises| **rises).count(), 10);
    let mut short = empty();
    short.add_operator(&again.policy, FRAME, 0, 22);
    assert!(short.trim().is_none(), "nothing is left to cut");
}
