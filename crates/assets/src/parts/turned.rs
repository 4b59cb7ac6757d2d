use std::f64::consts::TAU;

use genmanip_core::{Pose, Seed};
use glam::{DVec2, DVec3};
use serde::Deserialize;

use super::surface;
use crate::finish::Finish;
use crate::link_builder::LinkBuilder;
use crate::solid::Solid;
use crate::surface::{Detail, circle, from_rings, smooth_profile, subdivided};

/// A full body of revolution or a regular prism: can, bottle, jar, fruit, pen.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Turned {
    /// Name of the surface.
    #[serde(default = "body")]
    pub name: String,
    /// Profile of (radius, position along the axis), base to top.
    pub profile: Vec<[f64; 2]>,
    /// Draw the profile as a smooth curve.
    #[serde(default)]
    pub smooth: bool,
    /// Corners of the cross-section; 0 for round.
    #[serde(default)]
    pub sides: usize,
    /// Draw only the mantle, without the flat ends.
    #[serde(default)]
    pub open: bool,
    /// Stretch of the cross-section.
    #[serde(default = "unstretched")]
    pub stretch: DVec2,
    /// Where the axis starts and how it runs.
    #[serde(default)]
    pub axis: Axis,
    /// What it collides with.
    #[serde(default)]
    pub solid: TurnedSolid,
    /// Its look.
    pub finish: Finish,
}

/// How the axis of a turned body runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Axis {
    /// Along +z through the origin.
    #[default]
    Upright,
    /// Along +x, each cross-section touching the table, with a flat facet to rest on.
    Lying,
    /// Along +x at a height, with a flat facet to rest on.
    Level(f64),
    /// Along a direction from a point.
    From(DVec3, DVec3),
}

/// What a turned body collides with.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum TurnedSolid {
    /// The convex hull of the profile's rings; two equal rings of a round body give an exact cylinder, here and below.
    #[default]
    Hull,
    /// The hull of other rings than those that are drawn.
    Rings(Vec<[f64; 2]>),
    /// Several convex bodies, each from the rings of one list.
    Stack(Vec<Vec<[f64; 2]>>),
    /// One cylinder: largest radius, whole length.
    Cylinder,
    /// Nothing: too small to matter.
    None,
}

/// Corners of the rings that round bodies collide with.
const ROUND: usize = 20;

/// Most and fewest corners of a round surface; chosen by looking at cans and pens.
const MOST_SIDES: usize = 40;
const FEWEST_SIDES: usize = 12;

impl Turned {
    pub(super) fn add_to(&self, link: &mut LinkBuilder, seed: Seed) {
        let mut outline = smooth_profile(&self.profile, if self.smooth { 7 } else { 1 });
        if !self.open {
            let (first, last) = (outline[0], outline[outline.len() - 1]);
            outline.insert(0, DVec2::new(0.0, first.y));
            outline.push(DVec2::new(0.0, last.y));
        }
        let outline = if self.finish.is_painted() { subdivided(&outline) } else { outline };
        let mesh = |detail: Detail| {
            let sides = if self.sides > 0 { self.sides } else { self.round_sides(detail) };
            from_rings(&self.rings(&outline, sides, self.phase(sides)), detail)
        };
        link.visual.push(surface(&self.name, mesh, &self.finish, seed));
        link.solids.extend(self.solids());
    }

    fn solids(&self) -> Vec<Solid> {
        let sides = if self.sides > 0 { self.sides } else { ROUND };
        let hull = |points: &[[f64; 2]]| {
            if let [[radius, low], [top_radius, high]] = *points
                && radius == top_radius
                && self.is_exact_cylinder()
            {
                return self.cylinder(radius, low, high);
            }
            let profile: Vec<DVec2> = points.iter().map(|&point| DVec2::from_array(point)).collect();
            // Lying bodies rest on a facet, so the polygon is drawn around the circle and not into it.
            let grow = if self.rests_on_side() { 1.0 / (std::f64::consts::PI / sides as f64).cos() } else { 1.0 };
            let rings = self.rings_scaled(&profile, sides, self.phase(sides), grow);
            Solid::loft(&rings)
        };
        let radius = self.radius();
        let (low, high) = (self.profile[0][1], self.profile[self.profile.len() - 1][1]);
        match &self.solid {
            TurnedSolid::Hull => vec![hull(&self.profile)],
            TurnedSolid::Rings(rings) => vec![hull(rings)],
            TurnedSolid::Stack(stack) => stack.iter().map(|rings| hull(rings)).collect(),
            TurnedSolid::Cylinder => vec![self.cylinder(radius, low, high)],
            TurnedSolid::None => Vec::new(),
        }
    }

    /// Corners of a round surface, a multiple of four so that its size is exact along both axes.
    fn round_sides(&self, detail: Detail) -> usize {
        let radius = self.radius() * self.stretch.max_element();
        detail.chords(MOST_SIDES, radius, TAU).next_multiple_of(4).max(FEWEST_SIDES)
    }

    /// Largest radius.
    fn radius(&self) -> f64 {
        self.profile.iter().map(|point| point[0]).fold(0.0, f64::max)
    }

    /// Round, and free to roll: an exact cylinder serves it best.
    fn is_exact_cylinder(&self) -> bool {
        self.sides == 0 && !self.rests_on_side() && self.stretch == DVec2::ONE
    }

    fn cylinder(&self, radius: f64, low: f64, high: f64) -> Solid {
        let frame = self.frame(radius);
        Solid::cylinder(frame.transform_point(DVec3::Z * low), frame.transform_point(DVec3::Z * high), radius)
    }

    fn rests_on_side(&self) -> bool {
        matches!(self.axis, Axis::Lying | Axis::Level(_))
    }

    fn phase(&self, sides: usize) -> f64 {
        // Prisms and lying polygons show a flat side to the axes, round bodies a corner, so that sizes are exact.
        if (self.sides > 0 && sides.is_multiple_of(2)) || self.rests_on_side() { 0.5 } else { 0.0 }
    }

    fn rings(&self, profile: &[DVec2], sides: usize, phase: f64) -> Vec<Vec<DVec3>> {
        self.rings_scaled(profile, sides, phase, 1.0)
    }

    fn rings_scaled(&self, profile: &[DVec2], sides: usize, phase: f64, grow: f64) -> Vec<Vec<DVec3>> {
        profile
            .iter()
            .map(|point| {
                let frame = self.frame(point.x);
                circle(DVec2::new(point.x * grow, point.y), sides, phase)
                    .into_iter()
                    .map(|p| p * self.stretch.extend(1.0))
                    .map(|p| frame.transform_point(p))
                    .collect()
            })
            .collect()
    }

    /// Frame of a cross-section of the given radius: z along the axis.
    fn frame(&self, radius: f64) -> Pose {
        match self.axis {
            Axis::Upright => Pose::IDENTITY,
            Axis::Lying => Pose::from_axes(DVec3::Z * radius, DVec3::Y, DVec3::Z, DVec3::X),
            Axis::Level(height) => Pose::from_axes(DVec3::Z * height, DVec3::Y, DVec3::Z, DVec3::X),
            Axis::From(origin, direction) => {
                let z = direction.normalize_or(DVec3::Z);
                let y = if z.z.abs() > 0.9 { DVec3::Y } else { DVec3::Z };
                let x = y.cross(z).normalize_or(DVec3::X);
                Pose::from_axes(origin, x, z.cross(x), z)
            }
        }
    }
}

fn body() -> String {
    "body".into()
}

fn unstretched() -> DVec2 {
    DVec2::ONE
}
