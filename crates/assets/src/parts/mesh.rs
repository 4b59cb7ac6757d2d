use genmanip_core::{Piece, Pose, Seed, Shape, VisualPart};
use glam::{DVec2, DVec3};
use serde::Deserialize;

use crate::finish::Finish;
use crate::link_builder::LinkBuilder;
use crate::solid::{Moments, Solid};
use crate::surface::smooth;

/// Triangle mesh, as written by imports: rendered, colliding as its convex hull, or both.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mesh {
    /// Name of the visual part.
    #[serde(default = "body")]
    pub name: String,
    /// Vertex positions in the object's frame, m.
    pub positions: Vec<DVec3>,
    /// Triangles as three vertex indices each, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Finish; a mesh without one is not rendered.
    #[serde(default)]
    pub finish: Option<Finish>,
    /// True if the convex hull of the vertices collides; the mesh must then be closed and convex.
    #[serde(default)]
    pub solid: bool,
}

/// Maximum number of vertices and of triangles of a mesh; then the maximum number of vertices if the mesh collides.
const MAX_VERTICES: usize = 50_000;
const MAX_CORNERS: usize = 512;

impl Mesh {
    pub(super) fn add_to(&self, link: &mut LinkBuilder, seed: Seed) {
        let corners = |triangle: &[u32; 3]| triangle.map(|index| self.positions[index as usize]);
        if let Some(finish) = &self.finish {
            let flat: Vec<[(DVec3, DVec2); 3]> =
                self.triangles.iter().map(|triangle| corners(triangle).map(|corner| (corner, DVec2::ZERO))).collect();
            link.visual.push(VisualPart::new(&self.name, smooth(&flat), finish.material(seed), Pose::IDENTITY));
        }
        if self.solid {
            let moments = Moments::of_surface(&self.triangles.iter().map(corners).collect::<Vec<_>>());
            let points = self.positions.iter().map(|&point| point - moments.center).collect();
            link.solids.push(Solid { piece: Piece::at(moments.center, Shape::Hull { points }), moments });
        }
    }

    /// True if every index and number is valid, and a colliding mesh encloses a volume.
    pub(super) fn is_sound(&self) -> bool {
        let count = self.positions.len();
        let numbers = self.positions.iter().all(|point| point.is_finite() && point.abs().max_element() < 100.0);
        let indices = self.triangles.iter().flatten().all(|&index| (index as usize) < count);
        let sizes = (3..=MAX_VERTICES).contains(&count) && (1..=2 * MAX_VERTICES).contains(&self.triangles.len());
        if !(numbers && indices && sizes) {
            return false;
        }
        let corners = |triangle: &[u32; 3]| triangle.map(|index| self.positions[index as usize]);
        let volume = || Moments::of_surface(&self.triangles.iter().map(corners).collect::<Vec<_>>()).volume;
        !self.solid || (4..=MAX_CORNERS).contains(&count) && volume() > 0.0
    }
}

fn body() -> String {
    "body".into()
}
