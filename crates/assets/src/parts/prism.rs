use genmanip_core::Seed;
use glam::{DVec2, DVec3};
use serde::Deserialize;

use super::visual::surface;
use crate::finish::Finish;
use crate::link_builder::LinkBuilder;
use crate::solid::Solid;
use crate::surface::from_rings;

/// An extruded convex polygon: gable of a carton, blade of a turner, jaw of a wrench.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Prism {
    /// Name of the visual part.
    #[serde(default = "body")]
    pub name: String,
    /// Extrusion direction; the polygon lies in the other two axes in cyclic order (x: yz, y: zx, z: xy).
    pub axis: PrismAxis,
    /// Vertices of the convex polygon, counter-clockwise seen against the axis, m.
    pub polygon: Vec<[f64; 2]>,
    /// Lower and upper end of the prism along the axis, m.
    pub span: [f64; 2],
    /// Factor on the polygon at the upper end, about its mean point; 1 for a straight prism.
    #[serde(default = "one")]
    pub taper: f64,
    /// True for a part that is rendered but does not collide.
    #[serde(default)]
    pub ghost: bool,
    /// Colour and material of all sides.
    pub finish: Finish,
}

/// Axis of the object's frame along which a polygon is extruded.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PrismAxis {
    /// Extrusion along x of a polygon in (y, z).
    X,
    /// Extrusion along y of a polygon in (z, x).
    Y,
    /// Extrusion along z of a polygon in (x, y).
    Z,
}

impl Prism {
    pub(super) fn add_to(&self, link: &mut LinkBuilder, seed: Seed) {
        let mean = self.polygon.iter().map(|&p| DVec2::from_array(p)).sum::<DVec2>() / self.polygon.len() as f64;
        let ring = |height: f64, scale: f64| -> Vec<DVec3> {
            let flat = self.polygon.iter().map(|&p| mean + (DVec2::from_array(p) - mean) * scale);
            flat.map(|p| match self.axis {
                PrismAxis::X => DVec3::new(height, p.x, p.y),
                PrismAxis::Y => DVec3::new(p.y, height, p.x),
                PrismAxis::Z => DVec3::new(p.x, p.y, height),
            })
            .collect()
        };
        let [low, high] = self.span;
        let (bottom, top) = (ring(low, 1.0), ring(high, self.taper));
        let rings = [ring(low, 0.0), bottom.clone(), top.clone(), ring(high, 0.0)];
        link.visual.push(surface(&self.name, |detail| from_rings(&rings, detail), &self.finish, seed));
        if !self.ghost {
            link.solids.push(Solid::loft(&[bottom, top]));
        }
    }
}

fn body() -> String {
    "body".into()
}

fn one() -> f64 {
    1.0
}
