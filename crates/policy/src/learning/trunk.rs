//! Residual convolution trunk (He et al., 2016) of one camera, whose grid cells become tokens with fixed 2-D positions, as
//! in ACT and DETR (Carion et al., 2020). Trained from scratch, so normalised per cell instead of per batch.

use super::layers::{Initials, Layers};
use super::neighbourhoods::{NetworkBackend, SIDE, neighbourhoods};
use super::tensor::Tensor;
use crate::description::PATCH;
use crate::{ImageBatch, ImageInput, ModelSettings};

/// Stages, each of which halves rows and columns and doubles the channels. Chosen by hand.
const STAGES: usize = 2;
/// Largest period of the sinusoidal positions, as in DETR.
const LONGEST: f64 = 10_000.0;

/// Rows and columns of the last stage.
pub(super) fn grid(input: &ImageInput) -> [usize; 2] {
    (0..STAGES).fold(input.patches(), |grid, _| grid.map(|length| length.div_ceil(2)))
}

/// Adds the initial parameters of the trunk of one camera.
pub(super) fn add(name: &str, settings: &ModelSettings, arrays: &mut Initials) {
    let mut channels = settings.channels;
    arrays.linear(&format!("{name}.patch"), PATCH * PATCH * 3, channels);
    for stage in 0..STAGES {
        let name = format!("{name}.stage.{stage}");
        arrays.norm(&format!("{name}.norm"), channels);
        arrays.linear(&format!("{name}.halve"), SIDE * SIDE * channels, 2 * channels);
        channels *= 2;
        for block in 0..settings.residual_blocks {
            for half in 0..2 {
                let name = format!("{name}.block.{block}.{half}");
                arrays.norm(&format!("{name}.norm"), channels);
                arrays.linear(&format!("{name}.convolution"), SIDE * SIDE * channels, channels);
            }
        }
    }
    arrays.norm(&format!("{name}.norm"), channels);
    arrays.linear(&format!("{name}.cells"), channels, settings.width);
}

/// Tokens of the images of one camera: batch × cells of [`grid`] × width.
pub(super) fn tokens<B: NetworkBackend>(
    layers: &Layers<B>,
    name: &str,
    settings: &ModelSettings,
    input: &ImageInput,
    batch: &ImageBatch,
) -> Tensor<B> {
    let size = batch.shift.len() / 2;
    let ([mut rows, mut columns], mut channels) = (input.patches(), settings.channels);
    let patches = Tensor::new(&batch.patches, &[size, rows * columns, PATCH * PATCH * 3]);
    let mut features = layers.linear(patches, &format!("{name}.patch"));
    for stage in 0..STAGES {
        let name = format!("{name}.stage.{stage}");
        let around = around(layers, features, &name, [size, rows, columns, channels]);
        features = layers.linear(every_second(around, [rows, columns]), &format!("{name}.halve"));
        (rows, columns, channels) = (rows.div_ceil(2), columns.div_ceil(2), 2 * channels);
        for block in 0..settings.residual_blocks {
            let convolved = (0..2).fold(features.clone(), |features, half| {
                let name = format!("{name}.block.{block}.{half}");
                let around = self::around(layers, features, &name, [size, rows, columns, channels]);
                layers.linear(around, &format!("{name}.convolution"))
            });
            features = features.add(convolved);
        }
    }
    let features = layers.norm(features, &format!("{name}.norm")).relu();
    let positions = Tensor::new(&positions([rows, columns], settings.width), &[1, rows * columns, settings.width]);
    layers.linear(features, &format!("{name}.cells")).add(positions)
}

/// Neighbourhoods of the normalised and rectified cells, the input of a convolution.
fn around<B: NetworkBackend>(layers: &Layers<B>, features: Tensor<B>, name: &str, grid: [usize; 4]) -> Tensor<B> {
    neighbourhoods(layers.norm(features, &format!("{name}.norm")).relu().reshape(&grid))
}

/// Every second cell of every second row, from the first on: batch × cells × entries.
fn every_second<B: NetworkBackend>(cells: Tensor<B>, [rows, columns]: [usize; 2]) -> Tensor<B> {
    let [size, entries] = [cells.length(0), cells.length(2)];
    let (half_rows, half_columns) = (rows.div_ceil(2), columns.div_ceil(2));
    let padded = |tensor: Tensor<B>, dimension: usize, length: usize| {
        if length.is_multiple_of(2) {
            return tensor;
        }
        let mut shape = tensor.shape();
        shape[dimension] = 1;
        let zeros = Tensor::owned(vec![0.0; shape.iter().product()], &shape);
        Tensor::join(vec![tensor, zeros], dimension)
    };
    let grid = padded(padded(cells.reshape(&[size, rows, columns, entries]), 1, rows), 2, columns);
    let first_rows = grid.reshape(&[size, half_rows, 2, 2 * half_columns * entries]).narrow(2, 0..1);
    let first_columns = first_rows.reshape(&[size, half_rows * half_columns, 2, entries]).narrow(2, 0..1);
    first_columns.reshape(&[size, half_rows * half_columns, entries])
}

/// Sinusoidal positions of the cells: the first half of the entries for the row, the second for the column.
fn positions([rows, columns]: [usize; 2], width: usize) -> Vec<f32> {
    let of = |at: usize, length: usize, entries: usize| {
        let angle = std::f64::consts::TAU * (at as f64 + 1.0) / length as f64;
        (0..entries).map(move |entry| {
            let angle = angle / LONGEST.powf((entry / 2 * 2) as f64 / entries as f64);
            if entry % 2 == 0 { angle.sin() as f32 } else { angle.cos() as f32 }
        })
    };
    let (first, second) = (width / 2, width - width / 2);
    (0..rows * columns)
        .flat_map(|cell| of(cell / columns, rows, first).chain(of(cell % columns, columns, second)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::learning::tensor::Cpu;

    #[test]
    fn every_second_cell_remains() {
        for (rows, columns) in [(4, 6), (3, 4), (5, 3)] {
            let cells: Vec<f32> = (0..2 * rows * columns * 2).map(|at| at as f32).collect();
            let kept = every_second(Tensor::<Cpu>::new(&cells, &[2, rows * columns, 2]), [rows, columns]);
            let expected: Vec<f32> = (0..cells.len())
                .filter(|at| (at / 2 / columns % rows).is_multiple_of(2) && (at / 2 % columns).is_multiple_of(2))
                .map(|at| cells[at])
                .collect();
            assert_eq!(kept.shape(), [2, rows.div_ceil(2) * columns.div_ceil(2), 2]);
            assert_eq!(kept.values(), expected, "{rows} × {columns}");
        }
    }

    #[test]
    fn each_cell_has_a_position_of_its_own() {
        let (grid, width) = ([5, 8], 16);
        let positions = positions(grid, width);
        let cells: Vec<&[f32]> = positions.chunks_exact(width).collect();
        assert_eq!(cells.len(), 40);
        let distance = |one: &[f32], other: &[f32]| one.iter().zip(other).map(|(a, b)| (a - b).abs()).sum::<f32>();
        let is_own = |one: usize| (0..one).all(|other| distance(cells[one], cells[other]) > 0.1);
        assert!((0..40).all(is_own));
        // Cells of a row share the first half, cells of a column the second.
        assert_eq!((&cells[8][..8], &cells[3][8..]), (&cells[15][..8], &cells[35][8..]));
    }
}
