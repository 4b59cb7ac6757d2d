//! The photograph of the workspace without the arm: its shadow on the table is lifted, and what it hides is filled in.

use glam::Vec3A;

/// Share of light below which a table pixel is brightened; above it only noise would be added.
const SHADOWED: f32 = 0.985;
/// Smallest share of light by which a pixel is brightened: in deeper shadow there is more noise than image.
const DARKEST: f32 = 0.08;

/// Kind of content that each pixel of a photograph shows, row by row.
pub struct Layers<'a> {
    /// Width of the image, px.
    pub width: usize,
    /// True where the arm is seen.
    pub is_arm: &'a [bool],
    /// True where the table would be seen without the arm.
    pub is_table: &'a [bool],
    /// Share of light on the table, by channel, relative to the open table.
    pub light: &'a [Vec3A],
}

/// Radiance of the empty workspace from a photograph with the arm in it.
pub fn emptied(radiance: &[Vec3A], layers: &Layers<'_>) -> Vec<Vec3A> {
    let hidden = widened(layers.is_arm, layers.width);
    let mut out: Vec<Vec3A> = (0..radiance.len())
        .map(|at| {
            let light = layers.light[at];
            let lift = layers.is_table[at] && !hidden[at] && light.min_element() < SHADOWED;
            if lift { radiance[at] / light.max(Vec3A::splat(DARKEST)) } else { radiance[at] }
        })
        .collect();
    for of_table in [true, false] {
        let belongs = |at: usize| layers.is_table[at] == of_table;
        let known: Vec<bool> = (0..out.len()).map(|at| belongs(at) && !hidden[at]).collect();
        if known.iter().any(|known| *known) {
            let filled = spread(&out, &known, layers.width);
            (0..out.len()).filter(|&at| belongs(at) && hidden[at]).for_each(|at| out[at] = filled[at]);
        }
    }
    out
}

/// The mask with two more pixels on every side.
fn widened(mask: &[bool], width: usize) -> Vec<bool> {
    let height = mask.len() / width;
    let near = |at: usize| {
        let (column, row) = (at % width, at / width);
        let rows = row.saturating_sub(2)..(row + 3).min(height);
        rows.into_iter()
            .any(|row| (column.saturating_sub(2)..(column + 3).min(width)).any(|column| mask[row * width + column]))
    };
    (0..mask.len()).map(near).collect()
}

/// Known values, spread into the unknown pixels from coarser and coarser means (pull and push: Gortler et al., "The
/// Lumigraph", 1996).
fn spread(values: &[Vec3A], known: &[bool], width: usize) -> Vec<Vec3A> {
    let height = values.len() / width;
    if width <= 1 && height <= 1 || known.iter().all(|known| *known) {
        return values.to_vec();
    }
    let (columns, rows) = (width.div_ceil(2), height.div_ceil(2));
    let mut coarse = vec![Vec3A::ZERO; columns * rows];
    let mut count = vec![0.0_f32; columns * rows];
    for at in (0..values.len()).filter(|&at| known[at]) {
        let cell = at / width / 2 * columns + at % width / 2;
        coarse[cell] += values[at];
        count[cell] += 1.0;
    }
    coarse.iter_mut().zip(&count).for_each(|(sum, count)| *sum /= count.max(1.0));
    let is_known: Vec<bool> = count.iter().map(|count| *count > 0.0).collect();
    let coarse = spread(&coarse, &is_known, columns);
    let sample = |at: usize| {
        // Bilinear interpolation of the coarser level.
        let place = |index: usize, last: usize| {
            let at = (index as f32 - 0.5) / 2.0;
            let low = at.floor().clamp(0.0, last as f32);
            (low as usize, (low as usize + 1).min(last), (at - low).clamp(0.0, 1.0))
        };
        let ((x, next_x, share_x), (y, next_y, share_y)) =
            (place(at % width, columns - 1), place(at / width, rows - 1));
        let row = |y: usize| coarse[y * columns + x].lerp(coarse[y * columns + next_x], share_x);
        row(y).lerp(row(next_y), share_y)
    };
    (0..values.len()).map(|at| if known[at] { values[at] } else { sample(at) }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A shadow is lifted, the arm is replaced by what surrounds it, and the background stays.
    #[test]
    fn the_arm_and_its_shadow_vanish() {
        let (width, height) = (32, 24);
        let is_table: Vec<bool> = (0..width * height).map(|at| at / width >= 8).collect();
        let is_arm: Vec<bool> =
            (0..width * height).map(|at| (10..14).contains(&(at % width)) && at / width < 20).collect();
        let shadow = |at: usize| is_table[at] && (14..22).contains(&(at % width));
        let light: Vec<Vec3A> =
            (0..width * height).map(|at| Vec3A::splat(if shadow(at) { 0.5 } else { 1.0 })).collect();
        let truth = |at: usize| Vec3A::splat(if is_table[at] { 0.4 } else { 0.9 });
        let photo: Vec<Vec3A> =
            (0..width * height).map(|at| if is_arm[at] { Vec3A::ZERO } else { truth(at) * light[at] }).collect();
        let layers = Layers { width, is_arm: &is_arm, is_table: &is_table, light: &light };
        for (at, got) in emptied(&photo, &layers).into_iter().enumerate() {
            assert!((got - truth(at)).abs().max_element() < 1e-5, "{at}: {got}");
        }
    }
}
