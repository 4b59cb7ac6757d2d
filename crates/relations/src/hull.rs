//! Convex hulls of points in space.

use glam::DVec3;
use parry3d_f64::math::Vector;
use parry3d_f64::transformation::try_convex_hull;

/// A convex hull as a closed triangle mesh; empty for coplanar points.
#[derive(Clone, Debug, Default)]
pub(crate) struct Hull {
    pub corners: Vec<DVec3>,
    pub triangles: Vec<[u32; 3]>,
}

impl Hull {
    /// Convex hull of points; empty if they are coplanar.
    pub fn of(points: &[DVec3]) -> Self {
        let points: Vec<Vector> = points.iter().map(|point| Vector::from_array(point.to_array())).collect();
        if points.len() < 4 {
            return Self::default();
        }
        match try_convex_hull(&points) {
            Ok((corners, triangles)) => {
                Self { corners: corners.iter().map(|corner| DVec3::from_array(corner.to_array())).collect(), triangles }
            }
            Err(_) => Self::default(),
        }
    }

    /// Corners of each triangle.
    pub fn faces(&self) -> impl Iterator<Item = [DVec3; 3]> + '_ {
        self.triangles.iter().map(|triangle| triangle.map(|index| self.corners[index as usize]))
    }

    /// Planes of the faces: outward unit normals, and distances from the origin (m) plus a tolerance.
    pub fn planes(&self, tolerance: f64) -> Vec<(DVec3, f64)> {
        let center = self.corners.iter().sum::<DVec3>() / self.corners.len().max(1) as f64;
        self.faces()
            .filter_map(|[a, b, c]| {
                let normal = (b - a).cross(c - a).try_normalize()?;
                let outward = if normal.dot(a - center) < 0.0 { -normal } else { normal };
                Some((outward, outward.dot(a) + tolerance))
            })
            .collect()
    }
}
