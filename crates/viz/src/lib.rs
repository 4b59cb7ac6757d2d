//! Images for people: stills, videos, overlays, diagrams, and views of episodes, scenarios and objects.
//!
//! - [`render`]: images of scenarios and recorded episodes, without physics, as they were or in another appearance.
//! - [`scene_images`]: stills and film strips of episodes, top views of layouts.
//! - [`motion_images`]: a motion of the arm as one image or as a video.
//! - [`object_images`]: portraits and contact sheets of catalogue objects.
//! - [`views`]: images of the cameras of a world or scenario.
//! - [`drawing`]: scene graphs and layouts as SVG.
//! - [`replay`]: bit-exact replay of recorded episodes.

pub mod drawing;
pub mod markup;
pub mod motion_images;
pub mod object_images;
pub mod render;
pub mod replay;
pub mod scene_images;
pub mod views;

pub use drawing::{
    DrawnEdge, EdgeRole, Footprint, PlaceWindow, Refusal, Svg, TopView, explain_svg, graph_svg, layout_svg,
};
