//! Drawings of tasks and layouts as SVG: dark on white, no external resources, the same bytes for the same input.
//!
//! In all drawings the page's upward direction is *front* (away from the robot, +x), and left is the robot's left (+y).

mod colors;
mod explain;
mod floor_plan;
mod graph;
mod graph_layout;
mod route;
mod svg;
#[cfg(test)]
mod tests;

pub use colors::color_of_word;
pub use explain::{Refusal, explain_svg};
pub use floor_plan::{DrawnEdge, EdgeRole, Footprint, PlaceWindow, TopView, layout_svg};
pub use graph::graph_svg;
pub use graph::letter;
pub use svg::Svg;
