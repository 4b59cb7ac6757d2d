use genmanip_core::{Pose, Seed};
use glam::DVec3;
use serde::Deserialize;

use super::Block;
use super::block::Face;
use crate::finish::Finish;
use crate::link_builder::LinkBuilder;
use crate::solid::Solid;

/// Box that is open at the front (-x), with shelves: carcass of a cabinet, microwave.
///
/// Collision: a box per wall and shelf, of which only the floor touches the table. Cavity: the space above each shelf
/// and the floor, unless drawers fill it.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Case {
    /// Outer extent along x, y and z, m.
    pub size: DVec3,
    /// Centre of the base in the object's frame, m.
    #[serde(default)]
    pub at: DVec3,
    /// Thickness of the left (+y), right (-y), bottom, top and back (+x) walls, m.
    pub walls: [f64; 5],
    /// Number of evenly spaced shelves.
    #[serde(default)]
    pub shelves: usize,
    /// Thickness of a shelf, m.
    #[serde(default)]
    pub shelf: f64,
    /// True if drawers fill the case, so that it has no cavity of its own.
    #[serde(default)]
    pub drawers: bool,
    /// Colour and material of the outside and of the walls' edges.
    pub outside: Finish,
    /// Colour and material of the inside.
    pub inside: Finish,
}

impl Case {
    /// Lower and upper corner of the interior, shelves ignored.
    fn hollow(&self) -> [DVec3; 2] {
        let [left, right, bottom, top, back] = self.walls;
        let half = DVec3::new(self.size.x / 2.0, self.size.y / 2.0, 0.0);
        let low = self.at - half + DVec3::new(0.0, right, bottom);
        [low, self.at + half + DVec3::Z * self.size.z - DVec3::new(back, left, top)]
    }

    pub(super) fn is_sound(&self) -> bool {
        let [low, high] = self.hollow();
        let shelves = self.shelves as f64 * self.shelf;
        self.walls.iter().all(|&wall| wall > 0.0)
            && (high - low).min_element() > 0.0
            && high.z - low.z > shelves
            && (self.shelves == 0 || self.shelf > 0.0)
    }

    pub(super) fn add_to(&self, link: &mut LinkBuilder, seed: Seed) {
        let [low, high] = self.hollow();
        let half = DVec3::new(self.size.x / 2.0, self.size.y / 2.0, 0.0);
        let [min, max] = [self.at - half, self.at + half + DVec3::Z * self.size.z];
        let mut wall = |name: &str, min: DVec3, max: DVec3, faces: &[Face]| {
            self.block(name, min, max, faces).add_to(link, seed.fork(name));
        };
        wall("left", DVec3::new(min.x, high.y, low.z), max, &[Face::Right]);
        wall("right", min.with_z(low.z), DVec3::new(max.x, low.y, max.z), &[Face::Left]);
        wall("floor", min, max.with_z(low.z), &[Face::Top]);
        wall("top", DVec3::new(min.x, low.y, high.z), DVec3::new(max.x, high.y, max.z), &[Face::Bottom]);
        wall("back", DVec3::new(high.x, low.y, low.z), DVec3::new(max.x, high.y, high.z), &[Face::Front]);
        let height = (high.z - low.z - self.shelves as f64 * self.shelf) / (self.shelves + 1) as f64;
        for level in 0..=self.shelves {
            let floor = low.z + level as f64 * (height + self.shelf);
            if level > 0 {
                let (from, to) = (low.with_z(floor - self.shelf), high.with_z(floor));
                self.block("shelf", from, to, &[Face::Top, Face::Bottom]).add_to(link, seed.fork("shelf"));
            }
            if !self.drawers {
                let (from, to) = (low.with_z(floor), high.with_z(floor + height));
                link.cavity.push(Solid::cuboid(Pose::from_position((from + to) / 2.0), (to - from) / 2.0).piece);
            }
        }
    }

    fn block(&self, name: &str, min: DVec3, max: DVec3, inner: &[Face]) -> Block {
        Block {
            name: name.to_owned(),
            size: max - min,
            at: ((min + max) / 2.0).with_z(min.z),
            turn_deg: [0.0; 3],
            round: 0.0,
            corner: super::block::CORNER,
            ghost: false,
            finish: self.outside.clone(),
            faces: inner.iter().map(|&face| (face, self.inside.clone())).collect(),
        }
    }
}
