//! Four vectors at a time, one component of all four in one register: what shading computes with.

use std::ops::{Add, AddAssign, Mul, Neg, Sub};

use glam::{BVec4A, Mat3A, Mat4, Vec3A, Vec4};

/// Four vectors or colours.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Vec3x4 {
    pub x: Vec4,
    pub y: Vec4,
    pub z: Vec4,
}

impl Vec3x4 {
    #[inline]
    pub fn splat(vector: Vec3A) -> Self {
        Self { x: Vec4::splat(vector.x), y: Vec4::splat(vector.y), z: Vec4::splat(vector.z) }
    }

    #[inline]
    pub fn from_lanes(lanes: [Vec3A; 4]) -> Self {
        transpose(each(|lane| lanes[lane].extend(0.0))).0
    }

    #[inline]
    pub fn to_lanes(self) -> [Vec3A; 4] {
        let rows = Mat4::from_cols(self.x, self.y, self.z, Vec4::ZERO).transpose();
        let lane = Vec3A::from_vec4;
        [lane(rows.x_axis), lane(rows.y_axis), lane(rows.z_axis), lane(rows.w_axis)]
    }

    /// The same rotation of all four.
    #[inline]
    pub fn turned(self, turn: &Mat3A) -> Self {
        Self::splat(turn.x_axis) * self.x + Self::splat(turn.y_axis) * self.y + Self::splat(turn.z_axis) * self.z
    }

    #[inline]
    pub fn dot(self, other: Self) -> Vec4 {
        self.x * other.x + self.y * other.y + self.z * other.z
    }

    #[inline]
    pub fn min_element(self) -> Vec4 {
        self.x.min(self.y).min(self.z)
    }

    #[inline]
    pub fn max_element(self) -> Vec4 {
        self.x.max(self.y).max(self.z)
    }

    #[inline]
    pub fn map(self, change: impl Fn(Vec4) -> Vec4) -> Self {
        Self { x: change(self.x), y: change(self.y), z: change(self.z) }
    }

    #[inline]
    pub fn select(mask: BVec4A, yes: Self, no: Self) -> Self {
        Self {
            x: Vec4::select(mask, yes.x, no.x),
            y: Vec4::select(mask, yes.y, no.y),
            z: Vec4::select(mask, yes.z, no.z),
        }
    }
}

/// An array made lane by lane, always in line: `array::from_fn` and `map` often end as calls through memory.
#[inline(always)]
pub(crate) fn each<T>(make: impl Fn(usize) -> T) -> [T; 4] {
    [make(0), make(1), make(2), make(3)]
}

/// Four numbers made lane by lane.
#[inline(always)]
pub(crate) fn gather(make: impl Fn(usize) -> f32) -> Vec4 {
    Vec4::new(make(0), make(1), make(2), make(3))
}

/// The first three components and the fourth of four vectors.
#[inline]
pub(crate) fn transpose([a, b, c, d]: [Vec4; 4]) -> (Vec3x4, Vec4) {
    let rows = Mat4::from_cols(a, b, c, d).transpose();
    (Vec3x4 { x: rows.x_axis, y: rows.y_axis, z: rows.z_axis }, rows.w_axis)
}

impl Add for Vec3x4 {
    type Output = Self;
    #[inline]
    fn add(self, other: Self) -> Self {
        Self { x: self.x + other.x, y: self.y + other.y, z: self.z + other.z }
    }
}

impl AddAssign for Vec3x4 {
    #[inline]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl Sub for Vec3x4 {
    type Output = Self;
    #[inline]
    fn sub(self, other: Self) -> Self {
        Self { x: self.x - other.x, y: self.y - other.y, z: self.z - other.z }
    }
}

impl Neg for Vec3x4 {
    type Output = Self;
    #[inline]
    fn neg(self) -> Self {
        self.map(|value| -value)
    }
}

/// Component by component, for colours.
impl Mul for Vec3x4 {
    type Output = Self;
    #[inline]
    fn mul(self, other: Self) -> Self {
        Self { x: self.x * other.x, y: self.y * other.y, z: self.z * other.z }
    }
}

/// One factor per vector.
impl Mul<Vec4> for Vec3x4 {
    type Output = Self;
    #[inline]
    fn mul(self, factors: Vec4) -> Self {
        Self { x: self.x * factors, y: self.y * factors, z: self.z * factors }
    }
}

/// One factor for all.
impl Mul<f32> for Vec3x4 {
    type Output = Self;
    #[inline]
    fn mul(self, factor: f32) -> Self {
        self * Vec4::splat(factor)
    }
}
