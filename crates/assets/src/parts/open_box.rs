use genmanip_core::{Piece, Pose, Seed, TriMesh};
use glam::{DVec2, DVec3};
use serde::Deserialize;

use super::visual::surface;
use crate::finish::Finish;
use crate::link_builder::LinkBuilder;
use crate::solid::Solid;
use crate::surface::{from_rings, rounded_rectangle};

/// Box without a lid: basket, cardboard box, tray.
///
/// Collision: exact boxes for the floor and the four walls. Cavity: the interior up to the rim.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OpenBox {
    /// Outer extent along x, y and z, m.
    pub size: DVec3,
    /// Centre of the underside in the link's frame, m.
    #[serde(default)]
    pub at: DVec3,
    /// Thickness of the walls, m.
    pub wall: f64,
    /// Thickness of the floor, m.
    pub floor: f64,
    /// Radius of the vertical edges of the visual, m; the collision boxes have sharp edges.
    #[serde(default)]
    pub corner: f64,
    /// Finish of the walls' outside; u covers the circumference once.
    pub outside: Finish,
    /// Finish of the walls' inside; the rim has its material without its paint.
    pub inside: Finish,
    /// Finish of the floor and of the underside.
    pub bottom: Finish,
}

impl OpenBox {
    pub(super) fn add_to(&self, link: &mut LinkBuilder, seed: Seed) {
        let half = DVec2::new(self.size.x, self.size.y) / 2.0;
        let ring = |inset: f64, z: f64| -> Vec<DVec3> {
            let ring = rounded_rectangle(half - inset, (self.corner - inset).max(1e-4), z, 5);
            ring.into_iter().map(|point| point + self.at).collect()
        };
        let (top, wall, floor) = (self.size.z, self.wall, self.floor);
        let lip = (wall * 0.3).min(0.0015);
        let outside = [ring(0.0, 0.0), ring(0.0, top - lip)];
        let rim = [ring(0.0, top - lip), ring(lip, top), ring(wall - lip, top), ring(wall, top - lip)];
        let inside = [ring(wall, top - lip), ring(wall, floor)];
        let rim_finish = Finish { paint: Vec::new(), ..self.inside.clone() };
        for (name, rings, finish) in
            [("outside", &outside[..], &self.outside), ("rim", &rim, &rim_finish), ("inside", &inside, &self.inside)]
        {
            link.visual.push(surface(name, |detail| from_rings(rings, detail), finish, seed.fork(name)));
        }
        link.visual.push(surface("floor", |_| fan(&ring(wall, floor), true), &self.bottom, seed.fork("floor")));
        link.visual.push(surface("underside", |_| fan(&ring(0.0, 0.0), false), &self.bottom, seed.fork("floor")));
        self.add_solids(link);
        link.cavity.push(self.cavity());
    }

    /// Interior up to the rim.
    pub(super) fn cavity(&self) -> Piece {
        let hollow =
            DVec3::new(self.size.x / 2.0 - self.wall, self.size.y / 2.0 - self.wall, (self.size.z - self.floor) / 2.0);
        let center = Pose::from_position(self.at + DVec3::Z * (self.floor + hollow.z));
        Solid::cuboid(center, hollow).piece
    }

    fn add_solids(&self, link: &mut LinkBuilder) {
        let half = self.size / 2.0;
        let mut add = |center: DVec3, half: DVec3| {
            link.solids.push(Solid::cuboid(Pose::from_position(self.at + center), half));
        };
        add(DVec3::Z * (self.floor / 2.0), DVec3::new(half.x, half.y, self.floor / 2.0));
        let (middle, half_height) = ((self.size.z + self.floor) / 2.0, (self.size.z - self.floor) / 2.0);
        let thin = self.wall / 2.0;
        for side in [-1.0, 1.0] {
            add(DVec3::new(side * (half.x - thin), 0.0, middle), DVec3::new(thin, half.y, half_height));
            add(DVec3::new(0.0, side * (half.y - thin), middle), DVec3::new(half.x - self.wall, thin, half_height));
        }
    }
}

/// Triangle fan over a convex ring; texture coordinates span its bounds.
fn fan(ring: &[DVec3], upward: bool) -> TriMesh {
    let low = ring.iter().fold(DVec3::INFINITY, |low, point| low.min(*point));
    let high = ring.iter().fold(DVec3::NEG_INFINITY, |high, point| high.max(*point));
    let size = (high - low).max(DVec3::splat(1e-9));
    let normal = if upward { DVec3::Z } else { DVec3::NEG_Z };
    let mut mesh = TriMesh::default();
    for point in ring {
        let uv = (*point - low) / size;
        mesh.positions.push(point.as_vec3());
        mesh.normals.push(normal.as_vec3());
        mesh.uvs.push(DVec2::new(1.0 - uv.y, 1.0 - uv.x).as_vec2());
    }
    for i in 1..ring.len() as u32 - 1 {
        mesh.triangles.push(if upward { [0, i, i + 1] } else { [0, i + 1, i] });
    }
    mesh
}
