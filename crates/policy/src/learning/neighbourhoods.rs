//! im2col: 3×3 neighbourhoods of the cells of a grid, with which a convolution and its gradients become matrix
//! products.
//!
//! Burn's own convolution derives the weight gradient as a convolution with a kernel of the size of the image, which
//! dominates the training time on a CPU.

use burn_autodiff::checkpoint::base::Checkpointer;
use burn_autodiff::checkpoint::strategy::NoCheckpointing;
use burn_autodiff::grads::Gradients;
use burn_autodiff::ops::{Backward, Ops, OpsKind, unary};
use burn_backend::tensor::FloatTensor;
use burn_backend::{Backend, TensorMetadata};

use super::tensor::{Cpu, CpuTraining, Tensor};

/// Side of the square neighbourhood (kernel size), cells.
pub(super) const SIDE: usize = 3;

/// im2col: entries of the 3×3 cells around each cell in row-major order, 0 outside the grid. Shape images × rows ×
/// columns × channels becomes images × cells × (9 · channels).
pub(super) fn neighbourhoods<B: NetworkBackend>(grid: Tensor<B>) -> Tensor<B> {
    Tensor::of(B::neighbourhoods(grid.primitive()))
}

/// Back end of the networks: Burn's, with im2col as an additional operation.
pub trait NetworkBackend: Backend {
    /// [`neighbourhoods`] of the back end's tensor.
    fn neighbourhoods(grid: FloatTensor<Self>) -> FloatTensor<Self>;
}

impl NetworkBackend for Cpu {
    fn neighbourhoods(grid: FloatTensor<Self>) -> FloatTensor<Self> {
        let shape = shape(&grid);
        let [images, rows, columns, channels] = shape;
        let from = Tensor::<Self>::of(grid).values();
        let mut to = vec![0.0; from.len() * SIDE * SIDE];
        runs(shape, |cell, neighbour, length| {
            to[neighbour..neighbour + length].copy_from_slice(&from[cell..cell + length]);
        });
        Tensor::<Self>::owned(to, &[images, rows * columns, SIDE * SIDE * channels]).primitive()
    }
}

/// Backward pass of im2col (col2im): gradient of a cell, summed over all neighbourhoods that contain it.
#[derive(Debug)]
struct Neighbours;

impl Backward<Cpu, 1> for Neighbours {
    type State = [usize; 4];

    fn backward(self, ops: Ops<Self::State, 1>, gradients: &mut Gradients, _: &mut Checkpointer) {
        let shape = ops.state;
        unary::<Cpu, _>(ops.parents, ops.node, gradients, |gradient| {
            let from = Tensor::<Cpu>::of(gradient).values();
            let mut to = vec![0.0; shape.iter().product()];
            runs(shape, |cell, neighbour, length| {
                let sums = to[cell..cell + length].iter_mut().zip(&from[neighbour..neighbour + length]);
                sums.for_each(|(sum, value)| *sum += value);
            });
            Tensor::<Cpu>::owned(to, &shape).primitive()
        });
    }
}

impl NetworkBackend for CpuTraining {
    fn neighbourhoods(grid: FloatTensor<Self>) -> FloatTensor<Self> {
        let shape = shape(&grid);
        let (grid, node) = grid.into_parts();
        let neighbours = Cpu::neighbourhoods(grid);
        match Neighbours.prepare::<NoCheckpointing>([node]).compute_bound().stateful() {
            OpsKind::Tracked(prepared) => prepared.finish(shape, neighbours),
            OpsKind::UnTracked(prepared) => prepared.finish(neighbours),
        }
    }
}

fn shape(grid: &impl TensorMetadata) -> [usize; 4] {
    grid.shape().dims()
}

/// Contiguous runs of entries that a grid and its neighbourhoods have in common: calls `run` with the offset in the
/// grid, the offset in the neighbourhoods, and the length.
fn runs([images, rows, columns, channels]: [usize; 4], mut run: impl FnMut(usize, usize, usize)) {
    for image in 0..images {
        for row in 0..rows {
            for column in 0..columns {
                let cell = (image * rows + row) * columns + column;
                let (first, last) = (column.saturating_sub(1), (column + 1).min(columns - 1));
                let length = (last + 1 - first) * channels;
                for (place, other) in (row.saturating_sub(1)..=(row + 1).min(rows - 1)).map(|it| (it + 1 - row, it)) {
                    let neighbour = (cell * SIDE + place) * SIDE + (first + 1 - column);
                    run(((image * rows + other) * columns + first) * channels, neighbour * channels, length);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cell_sees_its_neighbours_and_nothing_outside_the_grid() {
        let (rows, columns, channels) = (3, 4, 2);
        let grid: Vec<f32> = (0..2 * rows * columns * channels).map(|at| at as f32 + 1.0).collect();
        let shape = [2, rows, columns, channels];
        let leaf = Tensor::<CpuTraining>::leaf(&grid, &shape);
        let neighbours = neighbourhoods(leaf.clone());
        assert_eq!(neighbours.shape(), [2, rows * columns, 9 * channels]);
        let factors: Vec<f32> = (0..2 * rows * columns * 9 * channels).map(|at| (at % 7) as f32).collect();
        let loss = neighbours.clone().mul(Tensor::new(&factors, &neighbours.shape())).sum();
        let (found, gradients) = (neighbours.values(), loss.gradients(&[leaf]));
        let mut expected = vec![0.0; grid.len()];
        for (at, (found, factor)) in found.iter().zip(&factors).enumerate() {
            let (channel, place, cell) = (at % channels, at / channels % 9, at / channels / 9);
            let (image, row, column) = (cell / columns / rows, cell / columns % rows, cell % columns);
            let (row, column) = (row + place / 3, column + place % 3);
            let is_inside = (1..=rows).contains(&row) && (1..=columns).contains(&column);
            let from = is_inside.then(|| ((image * rows + row - 1) * columns + column - 1) * channels + channel);
            assert_eq!(*found, from.map_or(0.0, |from| grid[from]), "{at}");
            from.into_iter().for_each(|from| expected[from] += factor);
        }
        assert_eq!(gradients, [expected]);
    }
}
