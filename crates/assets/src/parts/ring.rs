use std::f64::consts::TAU;

use genmanip_core::Seed;
use glam::DVec3;
use serde::Deserialize;

use super::visual::{CLEARANCE, surface};
use crate::finish::Finish;
use crate::link_builder::LinkBuilder;
use crate::solid::Solid;
use crate::surface::{from_rings, smooth_curve};

/// Horizontal ring around +z: doughnut, tape roll.
///
/// Collision: consecutive convex sectors of the cross-section. Four of them, a quarter turn apart, support the ring;
/// the others end `CLEARANCE` above its bottom and below its top, so that they touch nothing.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ring {
    /// Name of the visual part.
    #[serde(default = "body")]
    pub name: String,
    /// Vertices (radius, height) of the convex cross-section, counter-clockwise with the radius to the right, m.
    pub section: Vec<[f64; 2]>,
    /// Convex cross-section of the collision geometry; `section` if empty.
    #[serde(default)]
    pub solid: Vec<[f64; 2]>,
    /// Number of collision sectors, a multiple of four.
    pub sectors: usize,
    /// True to smooth the visual cross-section.
    #[serde(default)]
    pub smooth: bool,
    /// True for a part that is rendered but does not collide.
    #[serde(default)]
    pub ghost: bool,
    /// Finish; u runs around the axis, v around the cross-section from its first point.
    pub finish: Finish,
}

impl Ring {
    pub(super) fn add_to(&self, link: &mut LinkBuilder, seed: Seed) {
        let mut outline: Vec<DVec3> = self.section.iter().map(|&[r, z]| DVec3::new(r, z, 0.0)).collect();
        outline.extend(outline.first().copied());
        let outline = smooth_curve(&outline, if self.smooth { 6 } else { 1 });
        let columns = 48;
        let turned = |p: &DVec3, angle: f64| DVec3::new(p.x * angle.cos(), p.x * angle.sin(), p.y);
        let rows: Vec<Vec<DVec3>> = outline
            .iter()
            .map(|point| (0..columns).map(|i| turned(point, i as f64 / columns as f64 * TAU)).collect())
            .collect();
        link.visual.push(surface(&self.name, |detail| from_rings(&rows, detail), &self.finish, seed));
        if self.ghost {
            return;
        }
        let section = if self.solid.is_empty() { &self.section } else { &self.solid };
        let heights = || section.iter().map(|point| point[1]);
        let (bottom, top) = (heights().fold(f64::INFINITY, f64::min), heights().fold(f64::NEG_INFINITY, f64::max));
        for sector in 0..self.sectors {
            let clearance = if sector % (self.sectors / 4) == 0 { 0.0 } else { CLEARANCE };
            let at = |step: usize| -> Vec<DVec3> {
                let angle = step as f64 / self.sectors as f64 * TAU;
                let height = |z: f64| z.clamp(bottom + clearance, top - clearance);
                section.iter().map(|&[r, z]| turned(&DVec3::new(r, height(z), 0.0), angle)).collect()
            };
            link.solids.push(Solid::loft(&[at(sector + 1), at(sector)]));
        }
    }
}

fn body() -> String {
    "body".into()
}
