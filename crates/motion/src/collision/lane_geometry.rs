//! SIMD points and frames: one value per lane, eight configurations at a time, in single precision.

use super::lanes::Lanes;
use crate::rigid::Rigid;

/// Rounding error of single precision over the length of an arm (m).
pub(super) const ROUNDING: f32 = 2e-5;

/// x, y and z of a point or vector, per lane.
pub(super) type Point = [Lanes; 3];

/// `world_from_frame` in every lane: columns of the rotation, and the origin.
#[derive(Clone, Copy, Debug)]
pub(super) struct LaneFrame {
    pub(super) columns: [Point; 3],
    pub(super) origin: Point,
}

/// A rigid transform: rotation rows and translation.
#[derive(Clone, Copy, Debug)]
pub(super) struct Transform {
    pub(super) rows: [[f32; 3]; 3],
    pub(super) translation: [f32; 3],
}

#[inline(always)]
pub(super) fn place(frame: &LaneFrame, point: [f32; 3]) -> Point {
    add(rotate(frame, point), frame.origin)
}

/// Composition of an outer frame per lane with a constant inner transform.
#[inline(always)]
pub(super) fn then(outer: &LaneFrame, inner: &Transform) -> LaneFrame {
    let Transform { rows, translation } = inner;
    let column = |k: usize| rotate(outer, [rows[0][k], rows[1][k], rows[2][k]]);
    LaneFrame { columns: [column(0), column(1), column(2)], origin: place(outer, *translation) }
}

#[inline(always)]
fn rotate(frame: &LaneFrame, vector: [f32; 3]) -> Point {
    let [x, y, z] = &frame.columns;
    let row = |k: usize| x[k] * vector[0] + y[k] * vector[1] + z[k] * vector[2];
    [row(0), row(1), row(2)]
}

/// Like `rotate`, for mostly axis-aligned vectors, as joints are mounted.
#[inline(always)]
pub(super) fn rotate_sparse(frame: &LaneFrame, vector: [f32; 3]) -> Point {
    let mut rotated = [Lanes::all(0.0); 3];
    for (column, part) in frame.columns.iter().zip(vector) {
        if part != 0.0 {
            rotated = add(rotated, scale(*column, Lanes::all(part)));
        }
    }
    rotated
}

impl Transform {
    #[inline(always)]
    pub(super) fn before(&self, inner: &LaneFrame) -> LaneFrame {
        let row = |v: &Point, k: usize| v[0] * self.rows[k][0] + v[1] * self.rows[k][1] + v[2] * self.rows[k][2];
        let rotated = |v: &Point| [row(v, 0), row(v, 1), row(v, 2)];
        let [x, y, z] = &inner.columns;
        LaneFrame {
            columns: [rotated(x), rotated(y), rotated(z)],
            origin: add(rotated(&inner.origin), self.translation.map(Lanes::all)),
        }
    }
}

#[inline(always)]
pub(super) fn subtract(a: Point, b: Point) -> Point {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
pub(super) fn dot(a: Point, b: Point) -> Lanes {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
pub(super) fn add(a: Point, b: Point) -> Point {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

#[inline(always)]
pub(super) fn scale(a: Point, factor: Lanes) -> Point {
    [a[0] * factor, a[1] * factor, a[2] * factor]
}

impl From<&Rigid> for Transform {
    #[inline]
    fn from(rigid: &Rigid) -> Self {
        // Rounds residuals of right angles to 0.
        let single = |value: f64| if value.abs() < 1e-12 { 0.0 } else { value as f32 };
        let rows = rigid.rotation.transpose().to_cols_array_2d();
        Self { rows: rows.map(|row| row.map(single)), translation: rigid.translation.to_array().map(single) }
    }
}
