//! Sequences of poses along a way.

use genmanip_core::Pose;

/// Rotation that counts as much as a metre of translation, rad. A hand's length: its fingertips then move as far.
const RAD_PER_M: f64 = 10.0;

/// Distance between two poses, m, where a rotation counts by the way of a hand's fingertips.
pub(crate) fn distance(a: &Pose, b: &Pose) -> f64 {
    a.position.distance(b.position) + a.angle_to(b) / RAD_PER_M
}

/// Index from which a sequence stays within a distance (m) of its last pose.
pub(crate) fn start_of(poses: &[Pose], within_m: f64) -> usize {
    let Some(last) = poses.last() else { return 0 };
    let far = poses.iter().rposition(|pose| pose.position.distance(last.position) > within_m);
    far.map_or(0, |far| (far + 1).min(poses.len() - 1))
}

/// Poses of a sequence that are about a distance (m) apart, the first and the last included; a way back and forth is
/// shortened to its last passage.
pub(crate) fn spaced(poses: &[Pose], spacing_m: f64) -> Vec<Pose> {
    let mut kept: Vec<Pose> = Vec::new();
    let mut next = 0;
    while let Some(pose) = poses.get(next) {
        kept.push(*pose);
        let near = poses.iter().rposition(|other| distance(pose, other) < spacing_m).unwrap_or(next);
        next = near.max(next) + 1;
    }
    if let Some(last) = poses.last().filter(|last| kept.last() != Some(last)) {
        kept.push(*last);
    }
    kept
}

/// A sequence with poses in between, so that neighbours are at most a distance (m) apart.
pub(crate) fn dense(poses: &[Pose], at_most_m: f64) -> Vec<Pose> {
    let mut filled: Vec<Pose> = poses.first().copied().into_iter().collect();
    for pair in poses.windows(2) {
        let steps = (distance(&pair[0], &pair[1]) / at_most_m).ceil().max(1.0) as usize;
        filled.extend((1..=steps).map(|step| pair[0].interpolate(&pair[1], step as f64 / steps as f64)));
    }
    filled
}

/// Pose at a share (0-1) of a sequence of equal steps.
pub(crate) fn at_share(poses: &[Pose], share: f64) -> Pose {
    let along = share.clamp(0.0, 1.0) * (poses.len().saturating_sub(1)) as f64;
    let index = (along.floor() as usize).min(poses.len().saturating_sub(1));
    let (Some(a), Some(b)) = (poses.get(index), poses.get(index + 1).or(poses.last())) else { return Pose::IDENTITY };
    a.interpolate(b, along.fract())
}
