//! From light to what a display shows.

/// Khronos PBR Neutral: colours below 0.76 stay what they are, highlights are compressed towards white.
#[inline(always)]
pub(crate) fn tone_map([r, g, b]: [f32; 3]) -> [f32; 3] {
    const START: f32 = 0.8 - 0.04;
    const DESATURATION: f32 = 0.15;
    const D: f32 = 1.0 - START;
    let low = if r < g { r } else { g };
    let low = if b < low { b } else { low };
    let offset = if low < 0.08 { low - low * low * 6.25 } else { 0.04 };
    let color = [r - offset, g - offset, b - offset];
    let peak = if color[0] > color[1] { color[0] } else { color[1] };
    let peak = if color[2] > peak { color[2] } else { peak };
    let bright = if peak > START { peak } else { START };
    let new_peak = 1.0 - D * D / (bright + (D - START));
    let weight = 1.0 - 1.0 / ((bright - new_peak) * DESATURATION + 1.0);
    let scale = new_peak / bright;
    let mut out = [0.0; 3];
    for channel in 0..3 {
        let scaled = color[channel] * scale;
        let compressed = scaled + (new_peak - scaled) * weight;
        out[channel] = if peak >= START { compressed } else { color[channel] };
    }
    out
}
