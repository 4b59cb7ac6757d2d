//! From the world to pixels and back, row by row.

use genmanip_core::glam::{DMat3, DQuat, DVec2, DVec3};
use genmanip_core::{Distortion, Intrinsics, Pose, Projection as Core};
use genmanip_workspace::WorkspaceError;
use pyo3::prelude::*;

use crate::errors::error;
use crate::observation::array;

/// Largest deviation of a matrix from a rotation; chosen: the rounding of 32-bit numbers.
const NO_ROTATION: f64 = 1e-4;

/// A camera at its place in the world.
#[pyclass(frozen)]
pub struct Projection(Core);

#[pymethods]
impl Projection {
    /// K and the camera's pose as matrices row by row, width and height, and k1, k2, p1, p2, k3 of a lens.
    #[new]
    fn new(
        k: [[f64; 3]; 3],
        size: [u32; 2],
        world_from_camera: [[f64; 4]; 4],
        distortion: Option<[f64; 5]>,
    ) -> PyResult<Self> {
        let refused = |what: &str, hint: &str| error(WorkspaceError::input(what).with_hint(hint));
        let [[fx, skew, cx], [down, fy, cy], last] = k;
        let numbers = k.iter().flatten().chain(world_from_camera.iter().flatten());
        if !numbers.chain(distortion.iter().flatten()).all(|number| number.is_finite()) {
            return Err(refused("a number of the camera is not finite", "every entry must be a number"));
        }
        if fx <= 0.0 || fy <= 0.0 || skew != 0.0 || down != 0.0 || last != [0.0, 0.0, 1.0] {
            let hint = "expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in pixels, fx and fy above 0";
            return Err(refused("K is not that of a pinhole without skew", hint));
        }
        if size.contains(&0) {
            return Err(refused("size holds a 0", "expected (width, height) in pixels"));
        }
        let [x, y, z, bottom] = world_from_camera;
        let turn = DMat3::from_cols_array_2d(&[x, y, z].map(|row| [row[0], row[1], row[2]])).transpose();
        let off = turn.transpose() * turn - DMat3::IDENTITY;
        let is_rotation = off.to_cols_array().iter().all(|entry| entry.abs() < NO_ROTATION) && turn.determinant() > 0.0;
        if !is_rotation || bottom != [0.0, 0.0, 0.0, 1.0] {
            let hint = "expected a rotation, a position in metres, and 0 0 0 1 in the last row";
            return Err(refused("world_from_camera is no rigid transform", hint));
        }
        let world_from_camera = Pose::new(DVec3::new(x[3], y[3], z[3]), DQuat::from_mat3(&turn));
        let distortion = distortion.map(|[k1, k2, p1, p2, k3]| Distortion { k1, k2, p1, p2, k3 });
        let [width, height] = size;
        Ok(Self(Core { intrinsics: Intrinsics { width, height, fx, fy, cx, cy }, distortion, world_from_camera }))
    }

    /// Pixels and depths of points of the world, a row each: u, v, metres; not a number where a point is not shown.
    fn pixels<'py>(&self, py: Python<'py>, points: Vec<[f64; 3]>) -> PyResult<Bound<'py, PyAny>> {
        let row = |point: &[f64; 3]| {
            let seen = self.0.pixel(DVec3::from_array(*point));
            seen.map_or([f64::NAN; 3], |(pixel, depth_m)| [pixel.x, pixel.y, depth_m])
        };
        rows(py, points.iter().map(row).collect())
    }

    /// Points of the world that pixels show at depths, from rows u, v, metres.
    fn points<'py>(&self, py: Python<'py>, pixels: Vec<[f64; 3]>) -> PyResult<Bound<'py, PyAny>> {
        let row = |[u, v, depth_m]: &[f64; 3]| {
            let point = self.0.point(DVec2::new(*u, *v), *depth_m);
            point.map_or([f64::NAN; 3], |point| point.to_array())
        };
        rows(py, pixels.iter().map(row).collect())
    }

    /// Directions of pixels in the camera's frame, z = 1.
    fn rays<'py>(&self, py: Python<'py>, pixels: Vec<[f64; 2]>) -> PyResult<Bound<'py, PyAny>> {
        let row = |[u, v]: &[f64; 2]| self.0.ray(DVec2::new(*u, *v)).map_or([f64::NAN; 3], |ray| ray.to_array());
        rows(py, pixels.iter().map(row).collect())
    }

    /// Points of the world in the camera's frame, metres.
    fn to_camera<'py>(&self, py: Python<'py>, points: Vec<[f64; 3]>) -> PyResult<Bound<'py, PyAny>> {
        rows(py, points.iter().map(|point| self.0.to_camera(DVec3::from_array(*point)).to_array()).collect())
    }

    /// Points of the camera's frame in the world, metres.
    fn to_world<'py>(&self, py: Python<'py>, points: Vec<[f64; 3]>) -> PyResult<Bound<'py, PyAny>> {
        rows(py, points.iter().map(|point| self.0.to_world(DVec3::from_array(*point)).to_array()).collect())
    }

    /// The pose as a 4x4 matrix.
    fn world_from_camera<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        array(py, &self.0.world_from_camera.to_matrix(), &[4, 4])
    }
}

fn rows<'py>(py: Python<'py>, rows: Vec<[f64; 3]>) -> PyResult<Bound<'py, PyAny>> {
    array(py, rows.as_flattened(), &[rows.len(), 3])
}
