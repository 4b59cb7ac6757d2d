//! Low-discrepancy samples of a pixel's paths.
//!
//! Each decision uses a two-dimensional Sobol sequence with its own Owen scrambling and shuffling (Burley, "Practical
//! Hash-based Owen Scrambling", 2020), so that any number of decisions is possible.

use glam::Vec2;

/// Sample generator of one path; each call of `one` or `two` serves one random decision of the path.
#[derive(Clone, Debug)]
pub(crate) struct Samples {
    /// Seed of the pixel, from which each decision derives its own.
    seed: u32,
    /// Index of the path in the pixel.
    path: u32,
    decisions: u32,
}

impl Samples {
    /// Generator of a path of a pixel.
    pub fn new(seed: u32, path: u32) -> Self {
        Self { seed, path, decisions: 0 }
    }

    /// Number in [0, 1) for the next decision.
    pub fn one(&mut self) -> f32 {
        self.two().x
    }

    /// Point in the unit square for the next decision.
    pub fn two(&mut self) -> Vec2 {
        self.decisions += 1;
        let seed = mixed(self.seed ^ mixed(self.decisions));
        let index = shuffled(self.path, seed);
        let fraction = |digits: u32, salt: u32| (shuffled(digits, mixed(seed ^ salt)) >> 8) as f32 / 16_777_216.0;
        Vec2::new(fraction(index.reverse_bits(), 0x55), fraction(second(index), 0xaa))
    }
}

/// Second Sobol dimension as a binary fraction; the first is the bit-reversed index.
fn second(mut index: u32) -> u32 {
    let (mut sum, mut direction) = (0, 1 << 31);
    while index != 0 {
        if index & 1 == 1 {
            sum ^= direction;
        }
        direction ^= direction >> 1;
        index >>= 1;
    }
    sum
}

/// Nested uniform (Owen) scrambling with the constants of the paper.
fn shuffled(digits: u32, seed: u32) -> u32 {
    let mut x = digits.reverse_bits().wrapping_add(seed);
    for factor in [0x6c50_b47c, 0xb82f_1e52, 0xc7af_e638, 0x8d22_f6e6_u32] {
        x ^= x.wrapping_mul(factor);
    }
    x.reverse_bits()
}

/// 32-bit hash (finaliser of MurmurHash3).
fn mixed(mut x: u32) -> u32 {
    x = (x ^ (x >> 16)).wrapping_mul(0x85eb_ca6b);
    x = (x ^ (x >> 13)).wrapping_mul(0xc2b2_ae35);
    x ^ (x >> 16)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 64 points fill every grid of 64 equal cells with one point per cell; two decisions get different points.
    #[test]
    fn places_fill_the_square_evenly() {
        for seed in [0, 1, 77, u32::MAX] {
            for decision in 0..5 {
                let places: Vec<Vec2> = (0..64)
                    .map(|path| {
                        let mut samples = Samples::new(seed, path);
                        for _ in 0..decision {
                            samples.two();
                        }
                        samples.two()
                    })
                    .collect();
                for columns in [1, 2, 4, 8, 16, 32, 64_usize] {
                    let rows = 64 / columns;
                    let mut seen = vec![0; 64];
                    for place in &places {
                        let cell = (place * Vec2::new(columns as f32, rows as f32)).as_uvec2();
                        seen[cell.y as usize * columns + cell.x as usize] += 1;
                    }
                    assert!(
                        seen.iter().all(|&count| count == 1),
                        "seed {seed}, decision {decision}, {columns} columns"
                    );
                }
            }
        }
        let mut samples = Samples::new(3, 5);
        assert_ne!(samples.two(), samples.two());
    }
}
