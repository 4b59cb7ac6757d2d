use std::f64::consts::TAU;

use genmanip_core::Seed;
use glam::{DVec2, DVec3};
use serde::Deserialize;

use super::visual::surface;
use crate::finish::Finish;
use crate::link_builder::LinkBuilder;
use crate::solid::Solid;
use crate::surface::{Detail, from_rings, smooth_curve, tube_rings};

/// Tube swept along a path: handle, banana, stem, tine.
///
/// Collision: a capsule for each round segment, a convex hull for each other one.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tube {
    /// Name of the visual part.
    #[serde(default = "handle")]
    pub name: String,
    /// Points of the centre line (stations), m.
    pub path: Vec<DVec3>,
    /// Half widths of the cross-section (horizontal, vertical), m: one pair for all stations, or one per station.
    pub half_widths: Vec<[f64; 2]>,
    /// True for a centre line of straight segments instead of a smooth curve.
    #[serde(default)]
    pub straight: bool,
    /// True for a part that is rendered but does not collide, since it is too small to matter.
    #[serde(default)]
    pub ghost: bool,
    /// Colour and material of the surface.
    pub finish: Finish,
}

/// Number of sides of a collision cross-section, and minimum number for a visual one.
const SIDES: usize = 12;

/// Maximum number of sides of the cross-section of a part that is rendered but does not collide.
const MAX_GHOST_SIDES: usize = 28;

impl Tube {
    pub(super) fn add_to(&self, link: &mut LinkBuilder, seed: Seed) {
        let steps = if self.straight { 1 } else { 6 };
        let path = smooth_curve(&self.path, steps);
        let widths: Vec<DVec3> = (0..self.path.len()).map(|i| self.half_width(i).extend(0.0)).collect();
        let widths: Vec<DVec2> = smooth_curve(&widths, steps).into_iter().map(DVec3::truncate).collect();
        let widest = widths.iter().map(|half| half.max_element()).fold(0.0, f64::max);
        let most = if self.ghost { MAX_GHOST_SIDES } else { SIDES };
        let mesh = |detail: Detail| {
            let mut rings = tube_rings(&path, &widths, detail.chords(most, widest, TAU).max(SIDES));
            close_ends(&mut rings);
            from_rings(&rings, detail)
        };
        link.visual.push(surface(&self.name, mesh, &self.finish, seed));
        if !self.ghost {
            link.solids.extend(self.solids());
        }
    }

    fn half_width(&self, station: usize) -> DVec2 {
        self.half_widths.get(station).or(self.half_widths.last()).map_or(DVec2::ZERO, |&w| DVec2::from_array(w))
    }

    fn solids(&self) -> Vec<Solid> {
        let widths: Vec<DVec2> = (0..self.path.len()).map(|i| self.half_width(i)).collect();
        let rings = tube_rings(&self.path, &widths, SIDES);
        let last = self.path.len().saturating_sub(2);
        (0..self.path.len().saturating_sub(1))
            .map(|i| {
                let (mut from, mut to) = (self.path[i], self.path[i + 1]);
                let (a, b) = (widths[i], widths[i + 1]);
                let round = (a.max_element().max(b.max_element())) / (a.min_element().min(b.min_element())) < 1.15;
                let (radius, length) = ((a.x + a.y + b.x + b.y) / 4.0, from.distance(to));
                let inset = (to - from).normalize_or_zero() * radius;
                let ends = usize::from(i == 0) + usize::from(i == last);
                if !round || length < 0.5 * radius + ends as f64 * radius {
                    return Solid::loft(&rings[i..i + 2]);
                }
                if i == 0 {
                    from += inset;
                }
                if i == last {
                    to -= inset;
                }
                Solid::capsule(from, to, radius)
            })
            .collect()
    }
}

/// Closes both ends with a ring of equal points.
fn close_ends(rings: &mut Vec<Vec<DVec3>>) {
    let center = |ring: &[DVec3]| ring.iter().sum::<DVec3>() / ring.len().max(1) as f64;
    if let (Some(first), Some(last)) = (rings.first().cloned(), rings.last().cloned()) {
        rings.insert(0, vec![center(&first); first.len()]);
        rings.push(vec![center(&last); last.len()]);
    }
}

fn handle() -> String {
    "handle".into()
}
