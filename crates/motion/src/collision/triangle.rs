//! Triangles, the facets of meshes.

use glam::DVec3;
use parry3d_f64::math::Vector;
use parry3d_f64::shape::SupportMap;

use crate::rigid::Rigid;

/// A triangle by its vertices.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Triangle(pub(super) [DVec3; 3]);

impl Triangle {
    pub(super) fn moved(&self, outer_from_inner: &Rigid) -> Self {
        Self(self.0.map(|corner| outer_from_inner.point(corner)))
    }

    pub(super) fn area(&self) -> f64 {
        let [a, b, c] = self.0;
        0.5 * (b - a).cross(c - a).length()
    }

    pub(super) fn perimeter(&self) -> f64 {
        let [a, b, c] = self.0;
        a.distance(b) + b.distance(c) + c.distance(a)
    }

    /// Calls `mark` with the lower and upper corners of boxes that together contain the triangle, each at most about
    /// `cell` (m) large.
    pub(super) fn subdivide(&self, cell: f64, mark: &mut dyn FnMut(DVec3, DVec3)) {
        let [a, b, c] = self.0;
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        if (high - low).max_element() <= cell {
            return mark(low, high);
        }
        let length = |[a, b, _]: &[DVec3; 3]| a.distance_squared(*b);
        let sides = [[a, b, c], [b, c, a], [c, a, b]].into_iter();
        let [a, b, c] = sides.max_by(|one, other| length(one).total_cmp(&length(other))).unwrap_or(self.0);
        let middle = (a + b) / 2.0;
        Self([a, middle, c]).subdivide(cell, mark);
        Self([middle, b, c]).subdivide(cell, mark);
    }
}

impl SupportMap for Triangle {
    fn local_support_point(&self, direction: Vector) -> Vector {
        let direction = DVec3::from_array(direction.to_array());
        let [a, b, c] = self.0;
        let farther = |a: DVec3, b: DVec3| if b.dot(direction) > a.dot(direction) { b } else { a };
        Vector::from_array(farther(farther(a, b), c).to_array())
    }
}
