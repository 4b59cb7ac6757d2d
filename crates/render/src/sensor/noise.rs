//! Bounded approximation of the normal distribution for sensor noise.

use rand::Rng;

/// Approximately standard normal number, with an absolute value below 3.5: the scaled sum of four uniform numbers.
pub(super) fn bell(rng: &mut impl Rng) -> f32 {
    let bits = rng.next_u64();
    let sum: u32 = (0..4).map(|part| (bits >> (16 * part)) as u32 & 0xFFFF).sum();
    // The sum of four uniform integers below 65536 has the mean 131070 and the variance 65536²/3 (almost).
    (sum as f32 - 131_070.0) * (1.732_050_8 / 65_536.0)
}
