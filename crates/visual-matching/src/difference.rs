//! Colour differences in CIELAB: ΔE2000.

use genmanip_render::color::linear_from_srgb8;

use crate::flip::{WHITE, xyz_from_linear};

/// CIELAB coordinates L*, a*, b* of an 8-bit sRGB colour under D65.
pub fn lab(rgb: [u8; 3]) -> [f64; 3] {
    let curve = |value: f32| {
        let value = f64::from(value);
        if value > (6.0_f64 / 29.0).powi(3) { value.cbrt() } else { value * 841.0 / 108.0 + 4.0 / 29.0 }
    };
    let [x, y, z] = (xyz_from_linear(linear_from_srgb8(rgb)) / WHITE).to_array().map(curve);
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

/// CIEDE2000 colour difference of two CIELAB colours, with unit weights: the formulas of Sharma, Wu and Dalal, "The
/// CIEDE2000 color-difference formula: implementation notes, supplementary test data, and mathematical observations"
/// (2005).
pub fn delta_e_2000([l1, a1, b1]: [f64; 3], [l2, a2, b2]: [f64; 3]) -> f64 {
    const FAR: f64 = 6_103_515_625.0; // 25⁷
    let share = |chroma: f64| (chroma.powi(7) / (chroma.powi(7) + FAR)).sqrt();
    let gain = 1.5 - 0.5 * share(0.5 * (a1.hypot(b1) + a2.hypot(b2)));
    let polar = |a: f64, b: f64| {
        let a = a * gain;
        let hue = if a == 0.0 && b == 0.0 { 0.0 } else { b.atan2(a).to_degrees().rem_euclid(360.0) };
        (a.hypot(b), hue)
    };
    let ((c1, h1), (c2, h2)) = (polar(a1, b1), polar(a2, b2));
    let turn = h2 - h1;
    let (hue_step, hue) = if c1 * c2 == 0.0 {
        (0.0, h1 + h2)
    } else if turn.abs() <= 180.0 {
        (turn, 0.5 * (h1 + h2))
    } else {
        let step = if turn > 180.0 { turn - 360.0 } else { turn + 360.0 };
        let half = 0.5 * (h1 + h2);
        (step, if h1 + h2 < 360.0 { half + 180.0 } else { half - 180.0 })
    };
    let (light, chroma) = (0.5 * (l1 + l2), 0.5 * (c1 + c2));
    let cosine = |factor: f64, offset: f64| (factor * hue + offset).to_radians().cos();
    let t =
        1.0 - 0.17 * cosine(1.0, -30.0) + 0.24 * cosine(2.0, 0.0) + 0.32 * cosine(3.0, 6.0) - 0.20 * cosine(4.0, -63.0);
    let off = (light - 50.0).powi(2);
    let (weight_l, weight_c, weight_h) =
        (1.0 + 0.015 * off / (20.0 + off).sqrt(), 1.0 + 0.045 * chroma, 1.0 + 0.015 * chroma * t);
    let angle = 30.0 * (-((hue - 275.0) / 25.0).powi(2)).exp();
    let rotation = -(2.0 * angle).to_radians().sin() * 2.0 * share(chroma);
    let l = (l2 - l1) / weight_l;
    let c = (c2 - c1) / weight_c;
    let h = 2.0 * (c1 * c2).sqrt() * (0.5 * hue_step).to_radians().sin() / weight_h;
    (l * l + c * c + h * h + rotation * c * h).sqrt()
}

/// ΔE2000 of each pixel of two 8-bit sRGB images of the same size.
pub fn delta_e(a: &[u8], b: &[u8]) -> Vec<f64> {
    let pixel = |rgb: &[u8]| lab([rgb[0], rgb[1], rgb[2]]);
    a.chunks_exact(3).zip(b.chunks_exact(3)).map(|(a, b)| delta_e_2000(pixel(a), pixel(b))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pairs of Sharma, Wu and Dalal (2005), table 1, with their published differences: among them those that decide
    /// the mean hue and the sign of the hue difference.
    #[test]
    fn published_pairs_have_their_published_differences() {
        let pairs = [
            ([50.0, 2.6772, -79.7751], [50.0, 0.0, -82.7485], 2.0425),
            ([50.0, 3.1571, -77.2803], [50.0, 0.0, -82.7485], 2.8615),
            ([50.0, 2.8361, -74.0200], [50.0, 0.0, -82.7485], 3.4412),
            ([50.0, -1.3802, -84.2814], [50.0, 0.0, -82.7485], 1.0000),
            ([50.0, -1.1848, -84.8006], [50.0, 0.0, -82.7485], 1.0000),
            ([50.0, -0.9009, -85.5211], [50.0, 0.0, -82.7485], 1.0000),
            ([50.0, 0.0, 0.0], [50.0, -1.0, 2.0], 2.3669),
            ([50.0, -1.0, 2.0], [50.0, 0.0, 0.0], 2.3669),
            ([50.0, 2.4900, -0.0010], [50.0, -2.4900, 0.0009], 7.1792),
            ([50.0, 2.4900, -0.0010], [50.0, -2.4900, 0.0010], 7.1792),
            ([50.0, 2.4900, -0.0010], [50.0, -2.4900, 0.0011], 7.2195),
            ([50.0, 2.4900, -0.0010], [50.0, -2.4900, 0.0012], 7.2195),
            ([50.0, -0.0010, 2.4900], [50.0, 0.0009, -2.4900], 4.8045),
            ([50.0, -0.0010, 2.4900], [50.0, 0.0011, -2.4900], 4.7461),
            ([50.0, 2.5, 0.0], [50.0, 0.0, -2.5], 4.3065),
            ([50.0, 2.5, 0.0], [73.0, 25.0, -18.0], 27.1492),
            ([50.0, 2.5, 0.0], [61.0, -5.0, 29.0], 22.8977),
            ([50.0, 2.5, 0.0], [56.0, -27.0, -3.0], 31.9030),
            ([50.0, 2.5, 0.0], [58.0, 24.0, 15.0], 19.4535),
            ([50.0, 2.5, 0.0], [50.0, 3.1736, 0.5854], 1.0000),
            ([60.2574, -34.0099, 36.2677], [60.4626, -34.1751, 39.4387], 1.2644),
            ([63.0109, -31.0961, -5.8663], [62.8187, -29.7946, -4.0864], 1.2630),
            ([61.2901, 3.7196, -5.3901], [61.4292, 2.2480, -4.9620], 1.8731),
            ([35.0831, -44.1164, 3.7933], [35.0232, -40.0716, 1.5901], 1.8645),
            ([22.7233, 20.0904, -46.6940], [23.0331, 14.9730, -42.5619], 2.0373),
            ([36.4612, 47.8580, 18.3852], [36.2715, 50.5065, 21.2231], 1.4146),
            ([90.8027, -2.0831, 1.4410], [91.1528, -1.6435, 0.0447], 1.4441),
            ([90.9257, -0.5406, -0.9208], [88.6381, -0.8985, -0.7239], 1.5381),
            ([6.7747, -0.2908, -2.4247], [5.8714, -0.0985, -2.2286], 0.6377),
            ([2.0776, 0.0795, -1.1350], [0.9033, -0.0636, -0.5514], 0.9082),
        ];
        for (a, b, expected) in pairs {
            let got = delta_e_2000(a, b);
            assert!((got - expected).abs() < 5e-5, "{a:?} and {b:?}: {got}, published {expected}");
            assert!((delta_e_2000(b, a) - got).abs() < 1e-9, "{a:?} and {b:?} exchanged");
        }
    }

    #[test]
    fn white_has_lightness_100_and_no_color() {
        let [l, a, b] = lab([255; 3]);
        assert!((l - 100.0).abs() < 1e-3 && a.abs() < 0.02 && b.abs() < 0.02, "{l} {a} {b}");
        assert!(lab([0; 3])[0].abs() < 1e-9);
    }
}
