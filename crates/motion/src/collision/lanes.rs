//! SIMD arithmetic on eight single-precision numbers.
//!
//! No fused multiply-add is used, so every instruction set gives the same bits.

use std::ops::{Add, Mul, Sub};

use wide::f32x8;

pub(crate) const LANES: usize = 8;

/// One number per lane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Lanes(f32x8);

/// Lane mask of a comparison.
#[derive(Clone, Copy)]
pub(crate) struct Mask(f32x8);

/// Result of a comparison with an obstacle; bit k refers to lane k.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Verdict {
    /// Lanes that certainly violate the clearance.
    pub(super) touching: u8,
    /// Lanes that need a closer check.
    pub(super) undecided: u8,
}

impl Lanes {
    #[inline(always)]
    pub(crate) fn all(value: f32) -> Self {
        Self(f32x8::splat(value))
    }

    #[inline(always)]
    pub(crate) fn from_array(values: [f32; LANES]) -> Self {
        Self(f32x8::new(values))
    }

    #[inline(always)]
    pub(crate) fn to_array(self) -> [f32; LANES] {
        self.0.to_array()
    }

    /// Maximum; only for finite numbers.
    #[inline(always)]
    pub(crate) fn max(self, other: f32) -> Self {
        Self(self.0.fast_max(f32x8::splat(other)))
    }

    /// Minimum; only for finite numbers.
    #[inline(always)]
    pub(crate) fn lower(self, other: Self) -> Self {
        Self(self.0.fast_min(other.0))
    }

    /// Maximum; only for finite numbers.
    #[inline(always)]
    pub(crate) fn higher(self, other: Self) -> Self {
        Self(self.0.fast_max(other.0))
    }

    /// Minimum; only for finite numbers.
    #[inline(always)]
    pub(crate) fn min(self, other: f32) -> Self {
        Self(self.0.fast_min(f32x8::splat(other)))
    }

    #[inline(always)]
    pub(crate) fn clamp(self, low: f32, high: f32) -> Self {
        self.max(low).min(high)
    }

    #[inline(always)]
    pub(crate) fn sqrt(self) -> Self {
        Self(self.0.sqrt())
    }

    #[inline(always)]
    pub(crate) fn over(self, other: Self) -> Self {
        Self(self.0 / other.0)
    }

    /// The lanes in which this is less than `other`.
    #[inline(always)]
    pub(crate) fn below(self, other: Self) -> Mask {
        Mask(self.0.simd_lt(other.0))
    }

    /// Bit mask of lanes that are at most zero.
    #[inline(always)]
    pub(crate) fn not_positive(self) -> u8 {
        (self.0.simd_le(f32x8::ZERO).to_bitmask() & 0xff) as u8
    }

    /// Bit mask of lanes below zero.
    #[inline(always)]
    pub(crate) fn negative(self) -> u8 {
        (self.0.simd_lt(f32x8::ZERO).to_bitmask() & 0xff) as u8
    }

    /// Rounds to the nearest integer; for numbers below 2²².
    #[inline(always)]
    fn rounded(self) -> Self {
        // Adding and subtracting 1.5·2²³ rounds.
        (self + Self::all(12_582_912.0)) - Self::all(12_582_912.0)
    }

    /// Rounds down; for numbers below 2²².
    #[inline(always)]
    pub(crate) fn floor(self) -> Self {
        let nearest = self.rounded();
        nearest - self.below(nearest).pick(Self::all(1.0), Self::all(0.0))
    }

    /// Truncates to 32-bit integers.
    #[inline(always)]
    pub(crate) fn whole(self) -> [i32; LANES] {
        self.0.fast_trunc_int().to_array()
    }

    /// Sine and cosine with an error of 3e-7 for arguments of a few turns.
    #[inline(always)]
    pub(crate) fn sin_cos(self) -> (Self, Self) {
        let turns = (self * std::f32::consts::FRAC_1_PI).rounded();
        let r = (self - turns * 3.140_625) - turns * 9.676_536e-4;
        let odd = turns - (turns * 0.5).rounded() * 2.0;
        let sign = Self::all(1.0) - odd * odd * 2.0;
        let s = r * r;
        let (mut sin, mut cos) = (Self::all(-2.505_210_8e-8), Self::all(2.087_675_7e-9));
        for (odd, even) in [
            (2.755_731_9e-6, -2.755_732e-7),
            (-1.984_127e-4, 2.480_158_7e-5),
            (8.333_334e-3, -1.388_888_9e-3),
            (-0.166_666_67, 4.166_666_8e-2),
            (1.0, -0.5),
        ] {
            sin = sin * s + Self::all(odd);
            cos = cos * s + Self::all(even);
        }
        (r * sin * sign, (cos * s + Self::all(1.0)) * sign)
    }
}

impl Mask {
    /// Selects `yes` in masked lanes, `no` in the others.
    #[inline(always)]
    pub(crate) fn pick(self, yes: Lanes, no: Lanes) -> Lanes {
        Lanes(self.0.bitselect(yes.0, no.0))
    }
}

/// Indices of the set bits.
#[inline]
pub(super) fn lanes_of(mask: u8) -> impl Iterator<Item = usize> {
    (0..LANES).filter(move |lane| mask >> lane & 1 == 1)
}

macro_rules! lanewise {
    ($trait:ident, $method:ident) => {
        impl $trait for Lanes {
            type Output = Self;

            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self($trait::$method(self.0, other.0))
            }
        }
    };
}

lanewise!(Add, add);
lanewise!(Sub, sub);
lanewise!(Mul, mul);

impl Mul<f32> for Lanes {
    type Output = Self;

    #[inline(always)]
    fn mul(self, factor: f32) -> Self {
        self * Self::all(factor)
    }
}
