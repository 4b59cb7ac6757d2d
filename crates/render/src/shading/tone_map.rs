//! Tone mapping with the Khronos PBR Neutral operator.

use crate::simd::lerp;

/// Largest channel from which colours are compressed: 0.8 before the toe, which subtracts 0.04.
const START: f32 = 0.8 - 0.04;

/// Khronos PBR Neutral: subtracts the toe; results above 0.76 are compressed towards white.
#[inline(always)]
pub fn tone_map(color: [f32; 3]) -> [f32; 3] {
    const DESATURATION: f32 = 0.15;
    const D: f32 = 1.0 - START;
    let color = toe(color);
    let peak = largest(color);
    let bright = if peak > START { peak } else { START };
    let new_peak = 1.0 - D * D / (bright + (D - START));
    let weight = 1.0 - 1.0 / (bright - new_peak).mul_add(DESATURATION, 1.0);
    let scale = new_peak / bright;
    let mut out = [0.0; 3];
    for channel in 0..3 {
        let scaled = color[channel] * scale;
        let compressed = lerp(scaled, new_peak, weight);
        out[channel] = if peak >= START { compressed } else { color[channel] };
    }
    out
}

/// Toe of [`tone_map`]: subtracts up to 0.04 from all channels, less in dark colours.
#[inline(always)]
fn toe([r, g, b]: [f32; 3]) -> [f32; 3] {
    let low = if r < g { r } else { g };
    let low = if b < low { b } else { low };
    let offset = if low < 0.08 { (low * low).mul_add(-6.25, low) } else { 0.04 };
    [r - offset, g - offset, b - offset]
}

#[inline(always)]
fn largest([r, g, b]: [f32; 3]) -> f32 {
    let peak = if r > g { r } else { g };
    if b > peak { b } else { peak }
}
