//! Vector font: text as polylines, for labels on objects and overlays on images.
//!
//! Capitals, digits and some punctuation; lower case is drawn as capitals, unknown characters as a gap.

use glam::Vec2;

/// Cap height, grid units.
const CAP_HEIGHT: f32 = 6.0;
/// Spacing between glyphs, grid units.
const GAP: f32 = 1.6;
/// Width of a blank, grid units.
const SPACE: f32 = 2.4;

/// Strokes of a glyph, separated by spaces: points as two digits (x 0-4, y 0-6 up from the baseline). Empty for a gap.
fn glyph(letter: char) -> &'static str {
    match letter.to_ascii_uppercase() {
        'A' => "002640 1232",
        'B' => "00063645443303 3342413000",
        'C' => "4536160501103041",
        'D' => "00062644422000",
        'E' => "46060040 0333",
        'F' => "460600 0333",
        'G' => "45361605011030414323",
        'H' => "0006 4046 0343",
        'I' => "0006",
        'J' => "3631201001",
        'K' => "0006 4602 1340",
        'L' => "060040",
        'M' => "0006234640",
        'N' => "00064046",
        'O' => "103041453616050110",
        'P' => "00063645443303",
        'Q' => "103041453616050110 2240",
        'R' => "00063645443303 2340",
        'S' => "453616050413334241301001",
        'T' => "0646 2620",
        'U' => "060110304146",
        'V' => "062046",
        'W' => "0610233046",
        'X' => "0046 0640",
        'Y' => "062346 2320",
        'Z' => "06460040",
        '0' => "102031352616050110",
        '1' => "041610",
        '2' => "05163645440040",
        '3' => "05163645443313 334241301001",
        '4' => "360242 3630",
        '5' => "460603334241301001",
        '6' => "4536160501103041423303",
        '7' => "064610",
        '8' => "13334445361605041302011030414233",
        '9' => "0110304145361605041343",
        '&' => "400516263502011020 2043",
        '-' => "0333",
        '.' => "0001",
        ',' => "0110",
        '!' => "0602 0100",
        '\'' => "0604",
        '/' => "0046",
        ':' => "0100 0403",
        '+' => "0343 2125",
        '%' => "0046 0506161505 3041",
        '?' => "05163645443322 2120",
        '=' => "0242 0444",
        '(' => "16050110",
        ')' => "06151100",
        _ => "",
    }
}

/// Strokes (polylines) and width of a text with cap height 1: x to the right from 0, y up from the baseline.
///
/// ```
/// let (strokes, width) = genmanip_core::stroke_font::strokes("I");
/// assert_eq!((strokes.len(), width), (1, 0.0));
/// ```
pub fn strokes(text: &str) -> (Vec<Vec<Vec2>>, f32) {
    let (mut strokes, mut x, mut end): (Vec<Vec<Vec2>>, f32, f32) = (Vec::new(), 0.0, 0.0);
    for letter in text.chars() {
        let mut width = 0.0_f32;
        let glyph = glyph(letter);
        for stroke in glyph.split(' ').filter(|stroke| !stroke.is_empty()) {
            let digits: Vec<f32> = stroke.bytes().map(|digit| f32::from(digit - b'0')).collect();
            let points = digits.chunks_exact(2).map(|point| Vec2::new(x + point[0], point[1]) / CAP_HEIGHT);
            strokes.push(points.collect());
            width = digits.chunks_exact(2).map(|point| point[0]).fold(width, f32::max);
        }
        end = if glyph.is_empty() { end } else { x + width };
        x += if glyph.is_empty() { SPACE } else { width + GAP };
    }
    (strokes, end / CAP_HEIGHT)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_letter_and_digit_has_unique_strokes() {
        let letters: Vec<char> = ('A'..='Z').chain('0'..='9').collect();
        for (index, &letter) in letters.iter().enumerate() {
            let (glyph, width) = strokes(&letter.to_string());
            assert!(!glyph.is_empty() && (0.0..=0.7).contains(&width), "{letter}");
            assert!(glyph.iter().flatten().all(|p| (0.0..=1.0).contains(&p.y)), "{letter}");
            let same = letters[..index].iter().find(|&&other| strokes(&other.to_string()).0 == glyph);
            assert_eq!(same, None, "{letter}");
        }
    }
}
