use std::f64::consts::TAU;

use genmanip_core::{Piece, Seed};
use glam::{DVec2, DVec3};
use serde::Deserialize;

use super::visual::{CLEARANCE, surface};
use crate::finish::Finish;
use crate::link_builder::LinkBuilder;
use crate::solid::Solid;
use crate::surface::{Detail, circle, from_rings, smooth_profile, subdivided};

/// Hollow body of revolution about +z, open at the top: mug, bowl, plate, pot, bin.
///
/// The wall lies between two profiles of (radius, height), from base to rim, with the same number of points.
/// Collision: one convex wedge per sector and profile segment, and a solid base up to the first inner point, which is
/// the only piece that touches the table.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Vessel {
    /// Outer profile of (radius, height), from the edge of the base to the rim, m.
    pub outer: Vec<[f64; 2]>,
    /// Inner profile of (radius, height), from the edge of the floor to the rim, m.
    pub inner: Vec<[f64; 2]>,
    /// Number of collision wedges around; a multiple of four so that the size is exact.
    pub sectors: usize,
    /// Visual profile of the outside, from the edge of the base to the rim, m; empty for `outer`.
    #[serde(default)]
    pub outline: Vec<[f64; 2]>,
    /// True to smooth the visual profiles.
    #[serde(default)]
    pub smooth: bool,
    /// Finish of the outside, from the centre of the base to the rim.
    pub outside: Finish,
    /// Finish of the inside, v = 0 at the centre of the floor, v = 1 at the rim.
    pub inside: Finish,
    /// Finish of the rim; if absent, the plain base colour of the inside.
    #[serde(default)]
    pub rim: Option<Finish>,
    /// Centre of the base, m.
    #[serde(default)]
    pub at: DVec3,
    /// Factors on the cross-section along x and y, for oval vessels.
    #[serde(default = "unstretched")]
    pub stretch: DVec2,
    /// Height of the cavity's top, m; the rim if absent.
    #[serde(default)]
    pub cavity_top: Option<f64>,
}

impl Vessel {
    pub(super) fn add_to(&self, link: &mut LinkBuilder, seed: Seed) {
        let rim_round = self.rim_thickness() / 2.0;
        let curve = |points: &[[f64; 2]]| smooth_profile(points, if self.smooth { 6 } else { 1 });
        let mut outside = vec![DVec2::new(0.0, self.outer[0][1])];
        outside.extend(curve(if self.outline.is_empty() { &self.outer } else { &self.outline }));
        let inner = curve(&self.inner);
        let (rim_out, rim_in) = (outside[outside.len() - 1], inner[inner.len() - 1]);
        let shoulder = (rim_round * 0.5).min(0.0015);
        let last = outside.len() - 1;
        outside[last].y -= shoulder;
        let bevel = DVec2::new((rim_in.x - rim_out.x).signum() * shoulder, 0.0);
        let mut rim = vec![outside[last], rim_out + bevel, rim_in - bevel];
        let mut inside = inner;
        let first_inside = inside.len() - 1;
        inside[first_inside].y -= shoulder;
        rim.push(inside[first_inside]);
        inside.reverse();
        inside.push(DVec2::new(0.0, self.inner[0][1]));
        let sides = (self.sectors * 3).clamp(48, 72);
        for (name, profile, finish) in
            [("outside", outside, &self.outside), ("rim", rim, &self.rim_finish()), ("inside", inside, &self.inside)]
        {
            let mesh = |detail: Detail| {
                let is_plain = detail == Detail::Simplified && !finish.is_painted();
                let profile = if is_plain { profile.clone() } else { subdivided(&profile) };
                let rings: Vec<_> = profile.into_iter().map(|point| self.ring(point, sides)).collect();
                from_rings(&rings, detail)
            };
            link.visual.push(surface(name, mesh, finish, seed.fork(name)));
        }
        self.add_solids(link);
        link.cavity.push(self.cavity());
    }

    fn ring(&self, radius_height: DVec2, sides: usize) -> Vec<DVec3> {
        circle(radius_height, sides, 0.0).into_iter().map(|point| self.placed(point)).collect()
    }

    fn placed(&self, point: DVec3) -> DVec3 {
        self.at + point * self.stretch.extend(1.0)
    }

    fn rim_finish(&self) -> Finish {
        self.rim.clone().unwrap_or_else(|| Finish { paint: Vec::new(), ..self.inside.clone() })
    }

    fn rim_thickness(&self) -> f64 {
        let (out, inn) = (self.outer[self.outer.len() - 1], self.inner[self.inner.len() - 1]);
        (out[0] - inn[0]).abs()
    }

    fn add_solids(&self, link: &mut LinkBuilder) {
        let base = [self.outer[0], self.inner[0]].map(|p| self.ring(DVec2::from_array(p), self.sectors));
        link.solids.push(Solid::loft(&base));
        let mut outer: Vec<DVec2> = self.outer.iter().map(|&point| DVec2::from_array(point)).collect();
        let rise = (outer[1].y - outer[0].y).max(CLEARANCE);
        outer[0] = outer[0].lerp(outer[1], CLEARANCE / rise);
        for (low, high) in
            outer.windows(2).zip(self.inner.windows(2)).map(|(o, i)| ((o[0].to_array(), i[0]), (o[1].to_array(), i[1])))
        {
            for sector in 0..self.sectors {
                let section = |step: usize| {
                    let angle = step as f64 / self.sectors as f64 * TAU;
                    [low.0, high.0, high.1, low.1]
                        .map(|[r, z]| self.placed(DVec3::new(r * angle.cos(), r * angle.sin(), z)))
                        .to_vec()
                };
                link.solids.push(Solid::loft(&[section(sector + 1), section(sector)]));
            }
        }
    }

    /// Cavity up to the rim or `cavity_top`.
    pub(super) fn cavity(&self) -> Piece {
        let top = self.cavity_top.unwrap_or(f64::INFINITY);
        let rings: Vec<_> = self
            .inner
            .iter()
            .filter(|point| point[1] <= top + 1e-9)
            .map(|&point| self.ring(DVec2::from_array(point), self.sectors))
            .collect();
        Solid::loft(&rings).piece
    }
}

fn unstretched() -> DVec2 {
    DVec2::ONE
}
