//! Precomputed distance bounds of link pairs that only two joints move relative to each other.
//!
//! Neighbouring links are always close; a table lookup replaces most exact distance queries.

use std::f64::consts::{PI, TAU};

/// Lower bounds on the distance of two bodies over a grid of two joint positions (m).
#[derive(Clone, Debug)]
pub(crate) struct PairTable {
    axes: [Axis; 2],
    /// Bounds of all cells (m), row-major, first joint first.
    bounds: Vec<f32>,
}

#[derive(Clone, Copy, Debug)]
struct Axis {
    joint: usize,
    lower: f64,
    cell: f64,
    /// True for a continuous joint, whose positions are reduced to one turn.
    continuous: bool,
}

/// A joint that moves one body of a pair relative to the other.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Mover {
    pub(crate) joint: usize,
    /// Limits, or one turn of a continuous joint [rad or m].
    pub(crate) range: [f64; 2],
    pub(crate) continuous: bool,
    /// Maximum approach speed of the bodies per unit joint velocity [m/rad or m/m].
    pub(crate) bound: f64,
}

/// Number of cells per joint. Chosen by hand.
const CELLS: usize = 96;

impl PairTable {
    /// Fills the table; `distance` returns the distance of the bodies at positions of the two joints, or a lower bound
    /// (m).
    pub(crate) fn new(movers: [Mover; 2], mut distance: impl FnMut([f64; 2]) -> f64) -> Self {
        // Slightly wider than the limits, for measured positions just outside.
        let axis = |Mover { joint, range: [lower, upper], continuous, .. }: Mover| Axis {
            joint,
            lower: lower - 0.01,
            cell: (upper - lower + 0.02) / CELLS as f64,
            continuous,
        };
        let axes = movers.map(axis);
        let motion: f64 = axes.iter().zip(movers).map(|(axis, mover)| 0.5 * axis.cell * mover.bound).sum();
        let center = |axis: &Axis, index: usize| axis.lower + axis.cell * (index as f64 + 0.5);
        let mut bounds = Vec::with_capacity(CELLS * CELLS);
        for first in 0..CELLS {
            for second in 0..CELLS {
                let at = [center(&axes[0], first), center(&axes[1], second)];
                bounds.push((distance(at) - motion - 1e-6) as f32);
            }
        }
        Self { axes, bounds }
    }

    /// Minimum of the bounds over the whole table (m).
    pub(crate) fn nearest(&self) -> f64 {
        self.bounds.iter().copied().fold(f32::INFINITY, f32::min).into()
    }

    /// Lower bound at a configuration (m); `None` outside the table.
    pub(crate) fn bound(&self, config: impl Fn(usize) -> f64) -> Option<f64> {
        let index = |axis: &Axis| {
            let q = config(axis.joint);
            let q = if axis.continuous { q - TAU * ((q + PI) / TAU).floor() } else { q };
            let cell = (q - axis.lower) / axis.cell;
            (0.0..CELLS as f64).contains(&cell).then_some(cell as usize)
        };
        let (first, second) = (index(&self.axes[0])?, index(&self.axes[1])?);
        self.bounds.get(first * CELLS + second).map(|bound| f64::from(*bound))
    }
}
