//! Failure causes of an episode: slips, knocked-over objects, and the margin of missed conditions.
//!
//! Derived from the recorded frames and the final verdict, hence the same for every policy.

use genmanip_core::glam::DVec3;
use genmanip_core::{AtomVerdict, Failure, FailureCause, Frame, GoalVerdict, Pose, Unit};

use crate::{RolloutSettings, Stage};

/// A grip that ended without an opening command.
#[derive(Clone, Debug, PartialEq)]
pub struct Slip {
    /// Index of the object that slipped.
    pub object: usize,
    /// Time at which the grip ended, s.
    pub time_s: f64,
    /// Duration of the grip, s.
    pub held_s: f64,
    /// Height of the object above the place where it was gripped, metres.
    pub height_m: f64,
    /// True if the object was never gripped again.
    pub for_good: bool,
}

/// Actions of an episode whose pose was unreachable.
#[derive(Clone, Debug, PartialEq)]
pub struct Unreachable {
    /// Number of such actions.
    pub actions: usize,
    /// Control step of the first such action.
    pub step: usize,
    /// Error of the first such action: why its pose was unreachable.
    pub reason: String,
}

/// Recording from which the failures of an episode are derived.
#[derive(Clone, Copy, Debug)]
pub struct Evidence<'a> {
    /// One frame per control step.
    pub frames: &'a [Frame],
    /// Actions that were held because their pose was unreachable. `None` if there were none.
    pub unreachable: Option<&'a Unreachable>,
}

/// Minimum length of a grip, and of a pause that ends it, in frames (one per control step: 0.1 s at 60 Hz); also the
/// number of frames within which an opening command explains the end of a grip.
const STEADY_FRAMES: usize = 6;

/// Failure causes of an unsuccessful episode, the most decisive first.
///
/// Order: the policy's own reason; the last slip of an object that is not gripped again and whose condition does not
/// hold; a disturbed object; unreachable actions; the condition that misses by most; without such a slip, the last one.
/// Evidence of the same cause is joined.
pub fn explain(
    stage: &Stage,
    Evidence { frames, unreachable }: Evidence,
    verdict: &GoalVerdict,
    gave_up: Option<Failure>,
    settings: &RolloutSettings,
) -> Vec<Failure> {
    let missing: Vec<&AtomVerdict> = verdict.best().into_iter().flatten().filter(|atom| !atom.holds).collect();
    let slips = slips(frames);
    let is_missing = |slip: &&Slip| {
        let id = stage.scenario.objects.get(slip.object).map(|object| &object.id);
        missing.iter().any(|atom| Some(atom.atom.subject()) == id)
    };
    let slipped = |slip: &Slip| {
        let Slip { object, time_s, held_s, height_m, .. } = *slip;
        let (name, height) = (stage.name(object), (height_m * 1e3).max(0.0));
        let evidence = format!("{name} slipped at {time_s:.1} s, held for {held_s:.1} s and {height:.0} mm up");
        Failure { cause: FailureCause::Slipped, evidence }
    };
    let decisive = slips.iter().filter(|slip| slip.for_good).rfind(is_missing);
    let disturbed = frames.last().and_then(|last| disturbed(stage, last, settings));
    let worst = missing.iter().min_by(|a, b| a.normalised_margin().total_cmp(&b.normalised_margin()));
    let missed = worst.map_or_else(|| "the goal does not hold".into(), |atom| missed(atom));
    let held = |Unreachable { actions, step, reason }: &Unreachable| {
        let evidence = format!(
            "actions held because they were out of reach: {actions}, the first at control step {step}: {reason}"
        );
        Failure { cause: FailureCause::NoIk, evidence }
    };
    let seen = [
        gave_up,
        decisive.map(slipped),
        disturbed.map(|evidence| Failure { cause: FailureCause::Disturbed, evidence }),
        unreachable.map(held),
        Some(Failure { cause: FailureCause::GoalMissed, evidence: missed }),
        slips.last().filter(|_| decisive.is_none()).map(slipped),
    ];
    let mut causes: Vec<Failure> = Vec::new();
    for failure in seen.into_iter().flatten() {
        match causes.iter_mut().find(|known| known.cause == failure.cause) {
            Some(known) => known.evidence = format!("{}; {}", known.evidence, failure.evidence),
            None => causes.push(failure),
        }
    }
    causes
}

/// All grips that ended without an opening command, in order.
pub fn slips(frames: &[Frame]) -> Vec<Slip> {
    let mut found = Vec::new();
    let mut grip: Option<(usize, usize)> = None;
    for (index, frame) in frames.iter().enumerate() {
        let Some((object, begin)) = grip else {
            grip = frame.grasped.map(|object| (object, index));
            continue;
        };
        let still = |frame: &Frame| frame.grasped == Some(object);
        if frames[index..].iter().take(STEADY_FRAMES).any(still) {
            continue;
        }
        grip = frame.grasped.map(|object| (object, index));
        // The gripper was opened if the commanded width grew within the last frames.
        let width = |frame: &Frame| frame.command.last().copied().unwrap_or_default();
        let before = &frames[index.saturating_sub(STEADY_FRAMES)];
        if index - begin >= STEADY_FRAMES && width(frame) <= width(before) {
            let height = |frame: &Frame| frame.objects.get(object).map_or(0.0, |object| object.pose.position.z);
            found.push(Slip {
                object,
                time_s: frame.time_s,
                held_s: frame.time_s - frames[begin].time_s,
                height_m: height(frame) - height(&frames[begin]),
                for_good: !frames[index..].iter().any(still),
            });
        }
    }
    found
}

/// Evidence of a displaced or toppled object that the goal does not ask to move. `None` if there is none.
fn disturbed(stage: &Stage, last: &Frame, settings: &RolloutSettings) -> Option<String> {
    let goal = &stage.goal;
    stage.scenario.objects.iter().zip(&last.objects).enumerate().find_map(|(index, (before, now))| {
        let moved = goal.alternatives.iter().flatten().any(|atom| *atom.subject() == before.id);
        let shift = before.pose.position.distance(now.pose.position);
        let up = |pose: &Pose| pose.transform_vector(DVec3::Z);
        let tilt = up(&before.pose).angle_between(up(&now.pose));
        let displaced = shift > settings.disturbed_m || tilt > settings.disturbed_rad;
        (!moved && displaced).then(|| {
            let (name, tilt) = (stage.name(index), tilt.to_degrees());
            // Wording alone; the cause is the same.
            let what = if tilt > 30.0 { "knocked over" } else { "pushed away" };
            format!("{name} was {what}: moved {:.0} mm, tilted {tilt:.0}°", shift * 1e3)
        })
    })
}

/// Evidence of a condition that does not hold, with its margin.
fn missed(atom: &AtomVerdict) -> String {
    let by = atom.measurements.first().and_then(|measured| match measured.unit {
        Unit::Metre => Some(format!("missed by {:.0} mm, ", -measured.margin * 1e3)),
        Unit::Radian => Some(format!("missed by {:.0}°, ", -measured.margin.to_degrees())),
        Unit::Share | Unit::Fact => None,
    });
    format!("{}: {}{}", atom.atom, by.unwrap_or_default(), atom.explanation)
}
