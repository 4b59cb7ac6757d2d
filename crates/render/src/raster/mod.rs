//! Rasterisation into a visibility buffer: the nearest triangle at each sample.
//!
//! Triangles that share an edge compute its crossing with a row from the same two vertices, so that every sample belongs to
//! exactly one of them: no cracks, no double hits, no fixed-point grid.
//!
//! On equal depth the smaller id wins, so the order of drawing does not matter. If the number of samples per
//! pixel and axis is a power of two, samples at pixel centres have the same bits as with one sample per pixel: scaling
//! by a power of two is exact in floating point.

mod span;
mod triangle_setup;
mod vertex;
mod visibility_buffer;

pub(crate) use vertex::{Corner, extremes};
pub(crate) use visibility_buffer::{Block, Sides, VisibilityBuffer, draw_mesh, read_window};
