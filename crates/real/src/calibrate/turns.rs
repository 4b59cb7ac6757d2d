//! Check that the relative rotations of the hand determine the camera's pose.

use genmanip_core::Pose;
use genmanip_core::glam::DVec3;

use super::closed_form::USABLE_RAD;
use super::error::CalibrationError;
use super::views::{Mounting, View};
use crate::least_squares::rotation_vector;
use crate::linear::Square;

/// Minimum number of views that determine the pose in principle: three views have two independent relative motions.
const MIN_VIEWS: usize = 3;
/// Minimum angle between orientations that count as distinct, and of relative rotations whose axis is used, rad. Chosen
/// by hand.
const MIN_TURN_RAD: f64 = 10.0 * std::f64::consts::PI / 180.0;
/// Minimum spread of the rotation axes about their main direction, as the second eigenvalue of their mean outer
/// product: sin² of 10 degrees.
const MIN_SPREAD: f64 = 0.03;

/// Checks the relative rotations of the hand between views.
///
/// # Errors
/// [`CalibrationError`] that names the missing motion.
pub fn check(views: &[View], mounting: Mounting) -> Result<(), CalibrationError> {
    if views.len() < MIN_VIEWS {
        return Err(CalibrationError::FewViews { count: views.len(), needed: MIN_VIEWS });
    }
    let hands: Vec<Pose> = views.iter().map(|view| view.base_from_hand).collect();
    let mut turns: Vec<DVec3> = Vec::new();
    for (index, hand) in hands.iter().enumerate() {
        for other in &hands[..index] {
            turns.push(rotation_vector(match mounting {
                Mounting::EyeInHand => other.rotation.inverse() * hand.rotation,
                Mounting::EyeToHand => hand.rotation * other.rotation.inverse(),
            }));
        }
    }
    let largest = turns.iter().map(|turn| turn.length()).fold(0.0, f64::max);
    if largest < MIN_TURN_RAD {
        return Err(CalibrationError::LittleRotation { largest_deg: largest.to_degrees() });
    }
    let mut distinct: Vec<&Pose> = Vec::new();
    for hand in &hands {
        if distinct.iter().all(|other| other.angle_to(hand) >= MIN_TURN_RAD) {
            distinct.push(hand);
        }
    }
    if distinct.len() < MIN_VIEWS {
        return Err(CalibrationError::FewRotations { count: distinct.len() });
    }
    turns.retain(|turn| (MIN_TURN_RAD..USABLE_RAD[1]).contains(&turn.length()));
    if turns.len() < 2 {
        return Err(CalibrationError::HalfTurns);
    }
    let mut axes = Square::zero(3);
    for turn in &turns {
        axes.add_outer(&turn.normalize().to_array(), 1.0 / turns.len() as f64);
    }
    let spread = axes.eigen();
    if spread[1].0 < MIN_SPREAD {
        let main = &spread[2].1;
        let (frame, [x, y, z]) = (mounting.camera_frame(), [main[0], main[1], main[2]]);
        return Err(CalibrationError::ParallelAxes { frame, x, y, z });
    }
    Ok(())
}
