//! Sensor noise.

use rand::Rng;

/// Approximately standard normal number: a sum of four uniform ones, bounded by 3.5.
pub(super) fn bell(rng: &mut impl Rng) -> f32 {
    let bits = rng.next_u64();
    let sum: u32 = (0..4).map(|part| (bits >> (16 * part)) as u32 & 0xFFFF).sum();
    // Four uniform numbers below 65536 have a variance of 65536²/3.
    (sum as f32 - 131_070.0) * (1.732_050_8 / 65_536.0)
}
