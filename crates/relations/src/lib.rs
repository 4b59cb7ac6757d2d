//! Spatial relations between objects and verdicts on goals, for exact posed geometry (profile `seed`) and point clouds.
//!
//! [`PosedScene`] holds objects at their poses. [`judge_atom`], [`judge_goal`] and [`judge_edges`] return verdicts with
//! every measured quantity, its threshold and the margin. [`label_pair`] returns the spatial labels of two objects.
//!
//! Bodies are the exact convex pieces of the object models, not bounding boxes:
//! - *distance in the plane* is the shortest distance between the projections of the pieces;
//! - *resting on* is decided by the vertical gap between pieces whose projections overlap. A mug is on a saucer even
//!   though the saucer's rim is higher than the point of contact;
//! - *inside* is the share of an object's surface points in the other's cavity, or in its convex hull if the model has
//!   no cavity.
//!
//! [`CloudScene`] applies the same rules to point clouds, for objects that are only observed; [`observed`] makes the
//! clouds from depth images. [`clouds`] reproduces the verdicts of two released evaluators on point clouds.
//!
//! Curved outlines are polygons of 64 sides (error below 0.12 % of the radius). Vertical gaps are exact to a
//! micrometre.

mod body_model;
#[cfg(test)]
mod catalogue_tests;
mod cloud_scene;
#[cfg(test)]
mod cloud_scene_tests;
pub mod clouds;
mod contact;
mod extent;
mod hull;
mod judge;
pub mod observed;
mod pair;
mod planar;
mod posed;
mod posed_scene;
mod requirement;
mod shape;
mod solid;
mod state;
#[cfg(test)]
mod tests;
mod window;

pub use cloud_scene::CloudScene;
pub use contact::Contact;
pub use genmanip_core::RelationSettings;
pub use judge::{Rest, between_bend_rad, judge_atom, judge_edges, judge_goal, judge_states};
pub use pair::{Label, PairGeometry, PairVerdict, contact_below, label_pair, measure_pair, outlines_apart, planar_gap};
pub use posed_scene::{PosedObject, PosedScene};
pub use requirement::is_clear;
pub use shape::{ObjectShape, ShapeCache};
pub use state::joint_state;
pub use window::{Window, placement_window};
