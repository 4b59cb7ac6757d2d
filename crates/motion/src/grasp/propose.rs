//! Grasp proposals: antipodal point pairs and approach directions.

use genmanip_core::{Pose, Seed};
use glam::{DQuat, DVec3};
use rand::{Rng, RngExt};

use super::gripper::Gripper;
use super::settings::GraspSettings;
use super::solid::{Chord, Solid};
use super::target::{GraspTarget, squareness};
use crate::collision::GeometryError;

/// Number of slices along either horizontal axis of a flat object. Chosen by hand.
const FLAT_SLICES: usize = 24;

/// A TCP pose to be checked exactly, object frame.
pub(super) struct Proposal {
    pub(super) object_from_tcp: Pose,
    /// Distance of the contacts along their line (m).
    pub(super) width: f64,
    /// Cosine of the larger angle between closing line and surface normals.
    pub(super) antipodality: f64,
    /// Heuristic score; proposals are checked in descending order.
    pub(super) priority: f64,
}

/// An antipodal pair: midpoint, unit closing direction, distance, cosine of the larger angle to the normals.
struct Pair {
    middle: DVec3,
    closing: DVec3,
    width: f64,
    antipodality: f64,
}

/// All proposals; the order depends only on target, settings and seed.
pub(super) fn proposals(
    target: &GraspTarget,
    gripper: &Gripper,
    settings: &GraspSettings,
    seed: Seed,
) -> Result<Vec<Proposal>, GeometryError> {
    let solid = Solid::new(target.pieces)?;
    let up = (target.world_from_object.rotation.inverse() * DVec3::Z).normalize();
    let surface: Vec<(DVec3, DVec3)> =
        target.surface.iter().copied().filter(|(p, n)| p.is_finite() && n.is_finite() && n.length() > 0.5).collect();
    if surface.is_empty() {
        return Ok(Vec::new());
    }
    let heights = surface.iter().map(|(point, _)| point.dot(up));
    let (low, high) = heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), h| (low.min(h), high.max(h)));
    let mut rng = seed.rng();
    let widest = gripper.max_width - settings.width_clearance;
    let mut pairs = Vec::new();
    for (point, normal) in pick(&surface, up, high, settings.surface_points, &mut rng) {
        for closing in [jitter(-normal, 0.0, &mut rng), jitter(-normal, 0.15, &mut rng), flattened(-normal, up)] {
            pairs_along(&solid, point - closing * 0.3, closing, Some(0.3), widest, settings, &mut pairs);
        }
    }
    if high - low <= settings.flat_height {
        flat_pairs(&solid, &surface, up, widest, settings, &mut pairs);
    }
    let max_tilt = settings.largest_tilt(high - low);
    let mut proposals = Vec::new();
    for pair in &pairs {
        approaches(pair, target, gripper, settings, up, max_tilt, &mut proposals);
    }
    Ok(proposals)
}

/// Random start points: half of them from the whole surface, half from its top 3 cm, where rims are.
fn pick(surface: &[(DVec3, DVec3)], up: DVec3, high: f64, count: usize, rng: &mut impl Rng) -> Vec<(DVec3, DVec3)> {
    let top: Vec<(DVec3, DVec3)> = surface.iter().copied().filter(|(point, _)| point.dot(up) > high - 0.03).collect();
    let draw = |from: &[(DVec3, DVec3)], rng: &mut dyn FnMut(usize) -> usize| from[rng(from.len())];
    let mut index = |length: usize| rng.random_range(0..length);
    let anywhere: Vec<_> = (0..count - count / 2).map(|_| draw(surface, &mut index)).collect();
    let rim: Vec<_> = (0..count / 2).map(|_| draw(if top.is_empty() { surface } else { &top }, &mut index)).collect();
    anywhere.into_iter().chain(rim).collect()
}

/// Antipodal pairs on a line through the solid: across the body entered at `entry`, and from there to the far side of
/// the last body on the line.
fn pairs_along(
    solid: &Solid,
    origin: DVec3,
    closing: DVec3,
    entry: Option<f64>,
    widest: f64,
    settings: &GraspSettings,
    pairs: &mut Vec<Pair>,
) {
    let cone = (1.0 + settings.friction * settings.friction).sqrt().recip();
    let chords = solid.chords(origin, closing, 0.0005);
    let first = entry.map_or(0, |entry| chords.iter().position(|chord| chord.leave > entry + 1e-4).unwrap_or(0));
    let mut add = |enter: &Chord, leave: &Chord| {
        let width = leave.leave - enter.enter;
        let antipodality = (-enter.enter_normal.dot(closing)).min(leave.leave_normal.dot(closing));
        if width <= widest && antipodality >= cone {
            let middle = origin + closing * (0.5 * (enter.enter + leave.leave));
            pairs.push(Pair { middle, closing, width, antipodality });
        }
    };
    if let Some(enter) = chords.get(first) {
        add(enter, enter);
        if let Some(leave) = chords.last().filter(|_| chords.len() > first + 1) {
            add(enter, leave);
        }
    }
}

/// Antipodal pairs on lines parallel to the table through flat objects: at several slices, perpendicular to the long
/// and short axes.
fn flat_pairs(
    solid: &Solid,
    surface: &[(DVec3, DVec3)],
    up: DVec3,
    widest: f64,
    settings: &GraspSettings,
    pairs: &mut Vec<Pair>,
) {
    let middle = surface.iter().map(|(point, _)| *point).sum::<DVec3>() / surface.len() as f64;
    let x = up.any_orthonormal_vector();
    let y = up.cross(x);
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for (point, _) in surface {
        let (a, b) = ((*point - middle).dot(x), (*point - middle).dot(y));
        (xx, xy, yy) = (xx + a * a, xy + a * b, yy + b * b);
    }
    let angle = 0.5 * (2.0 * xy).atan2(xx - yy);
    let long = x * angle.cos() + y * angle.sin();
    let short = up.cross(long);
    for (axis, across) in [(long, short), (short, long)] {
        let along = |point: DVec3| (point - middle).dot(axis);
        let (first, last) = surface
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), (p, _)| (low.min(along(*p)), high.max(along(*p))));
        let slice = (last - first) / FLAT_SLICES as f64;
        for place in 0..FLAT_SLICES {
            let center = first + slice * (place as f64 + 0.5);
            // Local extent of the object: handles are thinner and higher than bowls.
            let here: Vec<DVec3> = surface
                .iter()
                .map(|(point, _)| *point)
                .filter(|point| (along(*point) - center).abs() < slice)
                .collect();
            let heights = here.iter().map(|point| (*point - middle).dot(up));
            let (low, high) =
                heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), h| (low.min(h), high.max(h)));
            let across_middle = here.iter().map(|point| (*point - middle).dot(across)).sum::<f64>() / here.len() as f64;
            for level in if here.is_empty() { [].iter() } else { [0.3, 0.5, 0.7].iter() } {
                let through = middle + axis * center + across * across_middle + up * (low + (high - low) * level);
                for turn in [-0.2, 0.0, 0.2] {
                    let closing = DQuat::from_axis_angle(up, turn) * across;
                    pairs_along(solid, through - closing * 0.5, closing, None, widest, settings, pairs);
                }
            }
        }
    }
}

/// TCP poses for a pair: approach directions perpendicular to the closing line, the steepest one and others tilted by
/// [`GraspSettings::tilts`] about the line, at most `max_tilt` (rad) from vertical.
fn approaches(
    pair: &Pair,
    target: &GraspTarget,
    gripper: &Gripper,
    settings: &GraspSettings,
    up: DVec3,
    max_tilt: f64,
    proposals: &mut Vec<Proposal>,
) {
    let Some(steepest) = (-up - pair.closing * -up.dot(pair.closing)).try_normalize() else { return };
    let weights = &settings.weights;
    for &tilt in &settings.tilts {
        for side in [1.0, -1.0] {
            let approach = DQuat::from_axis_angle(pair.closing, side * tilt) * steepest;
            let downward = -approach.dot(up);
            if downward < max_tilt.cos() || (tilt == 0.0 && side < 0.0) {
                continue;
            }
            for depth in [0.0, 0.35 * gripper.pad_size.z] {
                let x = pair.closing.cross(approach);
                let position = pair.middle + approach * depth;
                let object_from_tcp = Pose::from_axes(position, x, pair.closing, approach);
                let lever = (pair.middle - target.center_of_mass).length();
                let priority = weights.antipodality * squareness(pair.antipodality, settings.friction)
                    + weights.lever * (1.0 - lever / settings.longest_lever)
                    + weights.downward * downward
                    - 0.2 * weights.contact_depth * f64::from(u8::from(depth > 0.0));
                proposals.push(Proposal {
                    object_from_tcp,
                    width: pair.width,
                    antipodality: pair.antipodality,
                    priority,
                });
            }
        }
    }
}

fn jitter(direction: DVec3, amount: f64, rng: &mut impl Rng) -> DVec3 {
    let mut draw = || rng.random_range(-1.0..=1.0) * amount;
    let offset = DVec3::new(draw(), draw(), draw());
    (direction + offset).normalize_or(direction)
}

/// Horizontal projection of a direction, normalised, or the direction itself if it is steep.
fn flattened(direction: DVec3, up: DVec3) -> DVec3 {
    let flat = direction - up * direction.dot(up);
    if flat.length() > 0.7 { flat.normalize() } else { direction.normalize() }
}
