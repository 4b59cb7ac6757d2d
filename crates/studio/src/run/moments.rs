//! Notable moments of an episode: what the hand held, what the robot touched, and where it failed.

use genmanip_core::glam::DVec3;
use genmanip_core::{Episode, FailureCause, Frame, InstanceId, Pose};
use genmanip_rollout::RolloutSettings;
use genmanip_rollout::evidence::slips;
use serde::Serialize;

/// Minimum force of a contact that is shown, N. Chosen by hand: weaker contacts are finger pads that graze the object
/// that they are about to grasp.
const MIN_CONTACT_N: f64 = 2.0;
/// Maximum gap between two contacts that are merged into one moment, s.
const GAP_S: f64 = 0.25;

/// Notable moments of an episode, and the time of its failure.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Moments {
    /// Moments, ordered by their start.
    pub moments: Vec<Moment>,
    /// Time of the most decisive failure, s; `None` after a success.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub failed_at_s: Option<f64>,
    /// Time at which the policy ended and the scene was left to settle, s.
    pub acted_until_s: f64,
}

/// Time span of an episode in which something notable happened.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Moment {
    /// Kind of event.
    pub kind: MomentKind,
    /// Start, s since the start of the episode.
    pub from_s: f64,
    /// End, s since the start of the episode.
    pub to_s: f64,
    /// Id of the object involved; `None` if there is none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub object: Option<InstanceId>,
    /// Peak force of a contact, N; `None` for other kinds.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub peak_n: Option<f64>,
    /// Body that the robot touched with the largest force, or evidence of the event; `None` if there is none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub text: Option<String>,
}

/// Kind of a notable moment.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum MomentKind {
    /// Both fingers press on an object.
    Held,
    /// The robot touches something other than the object that it holds.
    Contact,
    /// An object left the closed hand.
    Slip,
    /// An object that the goal does not move was displaced or toppled, and stayed so.
    Disturbed,
    /// The expert took over from the policy that it corrects.
    Takeover,
}

impl Moments {
    /// Moments of an episode, with the thresholds of the default rollout settings.
    pub fn of(episode: &Episode) -> Self {
        let settings = RolloutSettings::default();
        let frames = &episode.frames;
        let acted_until_s = (episode.result.duration_s - settings.settle_s).max(0.0);
        let mut moments = held(episode);
        moments.extend(contacts(episode));
        let id = |index: usize| episode.scenario.objects.get(index).map(|object| object.id.clone());
        let slips = slips(frames);
        moments.extend(slips.iter().map(|slip| Moment {
            object: id(slip.object),
            text: Some(format!("held for {:.1} s", slip.held_s)),
            ..Moment::at(MomentKind::Slip, slip.time_s)
        }));
        let disturbed = disturbed(episode, &settings);
        moments.extend(disturbed.clone());
        if let Some(correction) = &episode.result.correction {
            let at_s = frames.get(correction.from_step).map_or(0.0, |frame| frame.time_s);
            moments.push(Moment {
                text: Some(format!("took over from {}", correction.policy)),
                ..Moment::at(MomentKind::Takeover, at_s)
            });
        }
        moments.sort_by(|a, b| a.from_s.total_cmp(&b.from_s));
        let failed_at_s = episode.result.failures.first().map(|failure| match failure.cause {
            FailureCause::Slipped => {
                let decisive = slips.iter().rfind(|slip| slip.for_good).or(slips.last());
                decisive.map_or(acted_until_s, |slip| slip.time_s)
            }
            FailureCause::Disturbed => disturbed.map_or(acted_until_s, |moment| moment.from_s),
            FailureCause::GoalMissed => last_release(episode, &moments).unwrap_or(acted_until_s),
            _ => acted_until_s,
        });
        Self { moments, failed_at_s, acted_until_s }
    }
}

impl Moment {
    fn at(kind: MomentKind, time_s: f64) -> Self {
        Self { kind, from_s: time_s, to_s: time_s, object: None, peak_n: None, text: None }
    }
}

/// Time spans in which the hand held an object.
fn held(episode: &Episode) -> Vec<Moment> {
    let runs = stretches(&episode.frames, |frame| frame.grasped);
    let id = |index: usize| episode.scenario.objects.get(index).map(|object| object.id.clone());
    let moment = |(object, from_s, to_s)| Moment { to_s, object: id(object), ..Moment::at(MomentKind::Held, from_s) };
    runs.into_iter().map(moment).collect()
}

/// Time spans in which `value` is `Some` and constant; gaps shorter than [`GAP_S`] are closed.
fn stretches<T: PartialEq>(frames: &[Frame], value: impl Fn(&Frame) -> Option<T>) -> Vec<(T, f64, f64)> {
    let mut found: Vec<(T, f64, f64)> = Vec::new();
    for frame in frames {
        let Some(now) = value(frame) else { continue };
        match found.last_mut() {
            Some((known, _, to_s)) if *known == now && frame.time_s - *to_s < GAP_S => *to_s = frame.time_s,
            _ => found.push((now, frame.time_s, frame.time_s)),
        }
    }
    found
}

/// Time spans in which the robot touched something other than the object that it held.
fn contacts(episode: &Episode) -> Vec<Moment> {
    let runs = stretches(&episode.frames, |frame| (frame.stray_contact_n >= MIN_CONTACT_N).then_some(()));
    let moment = |((), from_s, to_s): ((), f64, f64)| {
        let within = episode.frames.iter().filter(|frame| (from_s..=to_s).contains(&frame.time_s));
        let peak_n = within.map(|frame| frame.stray_contact_n).fold(0.0, f64::max);
        let strongest = episode.result.stray_contact.as_ref();
        let strongest = strongest.filter(|contact| (from_s - GAP_S..=to_s + GAP_S).contains(&contact.time_s));
        let object = strongest.and_then(|contact| {
            let id: InstanceId = contact.other.split('/').next()?.parse().ok()?;
            episode.scenario.index_of(&id).map(|_| id)
        });
        Moment {
            to_s,
            object,
            peak_n: Some(peak_n),
            text: strongest.map(|contact| format!("{} on {}", contact.link, contact.other)),
            ..Moment::at(MomentKind::Contact, from_s)
        }
    };
    runs.into_iter().map(moment).collect()
}

/// First time at which an object that the goal does not move was displaced or toppled, if it still is at the end.
fn disturbed(episode: &Episode, settings: &RolloutSettings) -> Option<Moment> {
    let goal = &episode.scenario.task.goal;
    let up = |pose: &Pose| pose.transform_vector(DVec3::Z);
    let last = episode.frames.last()?;
    episode.scenario.objects.iter().enumerate().find_map(|(index, before)| {
        let is_moved = goal.alternatives.iter().flatten().any(|atom| *atom.subject() == before.id);
        let is_off = |frame: &Frame| {
            frame.objects.get(index).is_some_and(|now| {
                before.pose.position.distance(now.pose.position) > settings.disturbed_m
                    || up(&before.pose).angle_between(up(&now.pose)) > settings.disturbed_rad
            })
        };
        if is_moved || !is_off(last) {
            return None;
        }
        let first = episode.frames.iter().find(|frame| is_off(frame))?;
        Some(Moment { object: Some(before.id.clone()), ..Moment::at(MomentKind::Disturbed, first.time_s) })
    })
}

/// Time of the last release of an object that the goal moves, s; `None` if it was never held.
fn last_release(episode: &Episode, moments: &[Moment]) -> Option<f64> {
    let goal = &episode.scenario.task.goal;
    let is_subject = |id: &InstanceId| goal.alternatives.iter().flatten().any(|atom| atom.subject() == id);
    let held = moments.iter().filter(|moment| moment.kind == MomentKind::Held);
    let own = held.filter(|moment| moment.object.as_ref().is_some_and(is_subject));
    own.map(|moment| moment.to_s).max_by(f64::total_cmp)
}
