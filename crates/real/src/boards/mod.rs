//! Printed boards: their layout, and detection of their corners in images.
//!
//! Tags are detected as by Wang and Olson, "AprilTag 2: Efficient and robust fiducial detection" (2016), after Olson,
//! "AprilTag: A robust and flexible visual fiducial system" (2011): adaptive threshold, dark segments with four sides,
//! lines fitted to their edges, a homography, bits, and the nearest code. Chessboard corners are then refined by
//! fitting a model of the brightness around them.

mod crossing;
mod detect;
mod grey;
mod layout;
mod print;
mod quads;
mod segments;
mod tags;
#[cfg(test)]
mod tests;

pub use detect::{NoBoard, detect};
pub use grey::GreyImage;
pub use layout::{Charuco, Corner, CornerKind, LEVELS, Layout, PlacedTag, Rectangle, TagGrid};
pub use print::{BORDER_MM, svg};
pub use tags::TAGS;
