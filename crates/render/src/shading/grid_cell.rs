//! Tiles multibounce_ao nodes, and what is linear multibounce_ao these.

#![allow(clippy::needless_range_loop, reason = "loops over lanes by index are compiled for wide registers")]

use crate::gbuffer::static_layer::TILE;
use crate::simd::{BatchColumn, ZERO, lerp};

/// A tile multibounce_ao its four nodes.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct GridCell {
    /// Its upper left node; the others follow.
    pub at: usize,
    /// Where it begins and ends multibounce_ao the left nodes and the right ones.
    pub from: f32,
    pub to: f32,
    /// Whether all nodes lie before the viewpoint, and the same size of the texture fits them.
    pub is_linear: bool,
}

/// How far the pixels of a tile lie from its first column and from its first row, in tiles.
static ACROSS: BatchColumn = steps(1);
static DOWN: BatchColumn = steps(TILE);

const fn steps(stride: usize) -> BatchColumn {
    let mut steps = ZERO;
    let mut i = 0;
    while i < ZERO.len() {
        steps[i] = (i / stride % TILE) as f32 / TILE as f32;
        i += 1;
    }
    steps
}

impl GridCell {
    /// Fills the tile from its nodes.
    #[inline(always)]
    pub fn bilinear(&self, nodes: &BatchColumn, out: &mut BatchColumn) {
        let &[left, left_below, right, right_below] = nodes[self.at..].first_chunk().expect("four nodes");
        let (first, next) = (lerp(left, right, self.from), lerp(left, right, self.to));
        let (below, below_next) = (lerp(left_below, right_below, self.from), lerp(left_below, right_below, self.to));
        let (right, down, twist) = (next - first, below - first, below_next - below - next + first);
        for i in 0..out.len() {
            out[i] = ACROSS[i].mul_add(twist, down).mul_add(DOWN[i], ACROSS[i].mul_add(right, first));
        }
    }
}
