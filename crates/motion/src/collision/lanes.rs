//! Eight numbers at a time, written so that the compiler turns them into vector instructions.
//!
//! No fused multiply-add is used, so every instruction set gives the same bits.

use std::ops::{Add, Mul, Sub};

pub(crate) const LANES: usize = 8;

/// One number per lane.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(align(32))]
pub(crate) struct Lanes(pub(crate) [f32; LANES]);

impl Lanes {
    #[inline(always)]
    pub(crate) fn all(value: f32) -> Self {
        Self([value; LANES])
    }

    #[inline(always)]
    pub(crate) fn map(self, f: impl Fn(f32) -> f32) -> Self {
        let mut out = self.0;
        for value in &mut out {
            *value = f(*value);
        }
        Self(out)
    }

    /// Bit k is set when lane k is at most zero.
    #[inline(always)]
    pub(crate) fn not_positive(self) -> u8 {
        let mut any = false;
        for value in self.0 {
            any |= value <= 0.0;
        }
        if !any {
            return 0;
        }
        self.0.iter().enumerate().fold(0, |mask, (lane, value)| mask | (u8::from(*value <= 0.0) << lane))
    }

    /// Sine, to 2e-7 for arguments of a few turns.
    #[inline(always)]
    pub(crate) fn sin(self) -> Self {
        self.map(|x| {
            // Adding and subtracting 1.5·2²³ rounds to the nearest whole number.
            const ROUND: f32 = 12_582_912.0;
            let turns = (x * std::f32::consts::FRAC_1_PI + ROUND) - ROUND;
            let r = (x - turns * 3.140_625) - turns * 9.676_536e-4;
            let odd = turns - 2.0 * ((turns * 0.5 + ROUND) - ROUND);
            let s = r * r;
            let series = -2.505_210_8e-8;
            let series = series * s + 2.755_731_9e-6;
            let series = series * s - 1.984_127e-4;
            let series = series * s + 8.333_334e-3;
            let series = series * s - 0.166_666_67;
            (r + r * s * series) * (1.0 - 2.0 * odd * odd)
        })
    }
}

macro_rules! lanewise {
    ($trait:ident, $method:ident) => {
        impl $trait for Lanes {
            type Output = Self;

            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                let mut out = self.0;
                for (value, other) in out.iter_mut().zip(other.0) {
                    *value = $trait::$method(*value, other);
                }
                Self(out)
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
