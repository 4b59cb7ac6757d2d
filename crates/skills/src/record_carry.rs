//! A skill of an episode that picks an object up and places it.

use genmanip_core::{Atom, Pose};
use genmanip_layout::Move;

use crate::carry::center_of;
use crate::cut::segments;
use crate::record::{Cut, SPACING_M, Take, WAY_M, smoothed};
use crate::skill::{CarryMotion, Grip, Segments};
use crate::way::{spaced, start_of};
use crate::{SkillError, Verb};

impl Take<'_> {
    /// Cuts a pick and place: the hand relative to the object where it lay and where it rests at the end.
    pub(crate) fn cut_carry(&self, step: &Move) -> Result<Cut, SkillError> {
        let support = step.atoms.iter().find_map(|atom| match atom {
            Atom::Relation { relation, reference, .. } if relation.is_support() => {
                Some((*relation, self.stage.scenario.index_of(reference)?))
            }
            _ => None,
        });
        let (relation, reference) = support.ok_or(SkillError::NotOneMove)?;
        let (frames, model) = (&self.episode.frames, &self.stage.models[self.object]);
        let count = frames.len();
        let (object_from_center, object_half_m) = center_of(model, self.joints(0));
        let center = |step: usize| frames[step].objects[self.object].pose * object_from_center;
        let contact: Vec<bool> = self.touched.iter().map(|links| *links != 0).collect();
        // The hand releases the object when the fingers no longer press; what falls or rolls on afterwards is not the hand's.
        let holds = |frame: &genmanip_core::Frame| frame.grasped == Some(self.object);
        let let_go = frames.iter().rposition(holds).ok_or(SkillError::NoContact { step: 0 })?;
        let mut way_m = vec![0.0; count];
        for step in 1..count {
            let moved_m = if step <= let_go { center(step).position.distance(center(step - 1).position) } else { 0.0 };
            way_m[step] = way_m[step - 1] + moved_m;
        }
        let whole_m = way_m[count - 1].max(f64::MIN_POSITIVE);
        let travel: Vec<f64> = way_m.iter().map(|way_m| way_m / whole_m).collect();
        let cut = segments(&travel, &contact)?;
        let [begin, _] = cut.manipulate;
        let left = cut.release[1].max(let_go + 1).min(count);
        let segments = Segments { manipulate: [begin, let_go], release: [let_go, left], retreat: [left, count], ..cut };

        let (first, last) = (center(0), center(count - 1));
        let tool = smoothed(count, |step| first.inverse() * frames[step].tcp);
        let grip = self.grip(&segments, &tool);
        if !matches!(grip, Grip::Grasp { .. }) {
            return Err(SkillError::NotHeld);
        }
        let held = smoothed(count, |step| center(step).inverse() * frames[step].tcp)[begin];
        let lifted = smoothed(count, |step| first.inverse() * center(step));
        let lowered = smoothed(count, |step| last.inverse() * center(step));
        let away = |step: &usize| lifted[*step].position.length() > WAY_M;
        let high = (begin..let_go).find(away).unwrap_or(let_go);
        let mut lift = vec![Pose::IDENTITY];
        lift.extend(spaced(&lifted[begin..=high], SPACING_M));
        let near = begin + start_of(&lowered[begin..=let_go], WAY_M);
        let carry = CarryMotion {
            relation,
            reference: self.stage.models[reference].asset.clone(),
            object_half_m,
            approach: self.approach(&tool, &segments, held),
            lift,
            lower: spaced(&lowered[near..=let_go], SPACING_M),
            retreat: self.retreat(&smoothed(count, |step| last.inverse() * frames[step].tcp), &segments),
        };
        Ok(Cut { segments, grip, verb: Verb::PickAndPlace, motion: None, carry: Some(carry) })
    }
}
