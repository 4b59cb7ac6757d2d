use std::f64::consts::TAU;

use genmanip_core::{Pose, Seed};
use glam::{DVec2, DVec3};
use serde::Deserialize;

use super::visual::surface;
use crate::finish::Finish;
use crate::link_builder::LinkBuilder;
use crate::solid::Solid;
use crate::surface::{Detail, circle, from_rings, smooth_profile, subdivided};

/// A solid body of revolution or a regular prism: can, bottle, jar, fruit, pen.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Turned {
    /// Name of the visual part.
    #[serde(default = "body")]
    pub name: String,
    /// Profile of (radius, position along the axis), base to top, m.
    pub profile: Vec<[f64; 2]>,
    /// True to smooth the profile of the visual; the collision geometry keeps the given points.
    #[serde(default)]
    pub smooth: bool,
    /// Number of sides of the cross-section; 0 for a round one.
    #[serde(default)]
    pub sides: usize,
    /// True to omit the flat ends of the rendered surface.
    #[serde(default)]
    pub open: bool,
    /// Factors on the cross-section along its x and y axes.
    #[serde(default = "unstretched")]
    pub stretch: DVec2,
    /// Axis of revolution in the object's frame.
    #[serde(default)]
    pub axis: Axis,
    /// Collision geometry, which may be simpler than the visual.
    #[serde(default)]
    pub solid: TurnedSolid,
    /// Colour and material of the surface.
    pub finish: Finish,
}

/// Axis of revolution of a turned part.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Axis {
    /// Along +z through the origin.
    #[default]
    Upright,
    /// Along +x; each cross-section touches the table with a facet to rest on.
    Lying,
    /// Along +x at this height (m), with a facet to rest on.
    Level(f64),
    /// From a point (m) along a direction, which need not be a unit vector.
    From(DVec3, DVec3),
}

/// Collision geometry of a turned part.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum TurnedSolid {
    /// Convex hull of the profile's rings; if a round body has just two rings of equal radius, an exact cylinder, here
    /// and in the other variants with rings.
    #[default]
    Hull,
    /// Convex hull of these rings instead of the profile's: (radius, position along the axis), m.
    Rings(Vec<[f64; 2]>),
    /// Several convex pieces, each the hull of its own rings.
    Stack(Vec<Vec<[f64; 2]>>),
    /// Exact cylinder with the profile's largest radius and full length.
    Cylinder,
    /// No collision geometry, for parts too small to matter.
    None,
}

/// Number of sides of the collision rings of round bodies. Chosen by hand.
const ROUND: usize = 20;

/// Upper and lower bound of the number of sides of a round visual; chosen by inspecting cans and pens.
const MAX_SIDES: usize = 40;
const MIN_SIDES: usize = 12;

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
            // Lying bodies rest on a facet, so the collision polygon is circumscribed about the circle.
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

    /// Number of sides of a round visual; a multiple of four, so that its size is exact along both axes.
    fn round_sides(&self, detail: Detail) -> usize {
        let radius = self.radius() * self.stretch.max_element();
        detail.chords(MAX_SIDES, radius, TAU).next_multiple_of(4).max(MIN_SIDES)
    }

    /// Largest radius of the profile, m.
    fn radius(&self) -> f64 {
        self.profile.iter().map(|point| point[0]).fold(0.0, f64::max)
    }

    /// True for an upright or free round body, whose collision geometry can be an exact cylinder so that it rolls
    /// smoothly.
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
        // A phase of half a step turns a flat side of prisms and lying polygons towards the axes; without it, a vertex of
        // a round body lies on each axis. Either makes sizes along the axes exact.
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

    /// Frame in which a cross-section of the given radius (m) is placed: z along the axis.
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
