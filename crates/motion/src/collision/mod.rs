//! Collision checking: named obstacles, exact robot geometry, an attached object, and allowed contacts.
//!
//! A query asks if moving bodies keep their *clearance* (m) from obstacles and from each other, at one configuration or
//! everywhere along straight joint-space edges. A body is a link with collision pieces, or the attached object; the
//! base is checked against links only, not against obstacles.
//!
//! **Representations** of bodies and obstacles, compiled once per robot, per obstacle or per query:
//!
//! | form | file | result |
//! |---|---|---|
//! | exact pieces: a convex core rounded by a radius, with a bounding sphere | `convex` | distance, negative for penetration (GJK and EPA, 64 bits) |
//! | cover: spheres that contain a body, each with an inscribed radius | `cover` | upper and lower distance bounds, for bodies |
//! | skeleton: at most a few dozen vertices of a piece | `narrow` | clear, touching or undecided |
//! | bounding primitive: box, cylinder or segment around an obstacle's piece | `fast_piece` | the same, by squared distances |
//! | surface: a hierarchy over the points of a cloud or the `triangle`s of a mesh (built by `points` and `mesh`) | `surface` | exact distance per facet; `probe` with a piece's face planes avoids most of them |
//! | distance field: a grid of distance bounds around a surface | `field` | clear or touching by one lookup |
//! | distance table over two joints for a link pair that only these move | `pair_table` | lower bound on their distance |
//!
//! `robot_shape` holds the compiled robot; `always_near` finds link pairs that need no check; `world` the obstacles, the attached object and allowed contacts; `body` and
//! `placed_obstacle` their poses in one query; and [`Checker`] all of these with a clearance per pair. `lanes` and
//! `lane_geometry` process eight configurations at a time in single precision (SIMD); `ROUNDING` (2e-5 m) bounds the
//! rounding error, and every bound is conservative by that amount.
//!
//! **Clearances.** A query has one `padding`; pairs with allowed contact, or that can never meet, are not checked.
//! [`Checker::relax`] permits start and goal of a motion to be closer: such a pair keeps nearly the distance it has
//! there, and of a surface only the nearby facets are relaxed. The fast path turns a clearance into two thresholds:
//! beyond `accept` a pair is clear, within `reject` it certainly touches.
//!
//! **Order of checks** (`edge` for one edge, as the search tries it; `polyline` for a whole path, at the end):
//!
//! 1. Forward kinematics of eight states at a time (`fast`): states of an edge, so close that no point moves more than
//!    `spacing` between two of them (by the *motion bounds* of the joints), or the middle states of segments, with
//!    clearances enlarged by the motion of a body over half a segment.
//! 2. Broad phase: each body's bounding sphere against each obstacle's sphere, primitives or distance field, then the
//!    body's cover; most pairs are clear here.
//! 3. Narrow phase for the rest: skeletons against bounding primitives, by a few Frank-Wolfe steps. A certain contact
//!    ends the query.
//! 4. The remaining pairs are `Unresolved`, each with its lanes. Obstacles are then checked exactly, one state at a time; a
//!    path first subdivides the segment into steps of `spacing` and repeats 1 to 3 for that pair alone.
//! 5. Unresolved pairs of bodies come last and are followed along the whole edge by conservative advancement: the
//!    table's bound or the exact distance at one state limits how far the pair can move before it may touch.
//!
//! With `spacing` at most twice the padding, nothing can be touched between two free states; relaxed pairs are followed
//! in steps a fifth as long. [`Checker::check`] and [`Checker::is_free`] check one configuration: bounding spheres, then
//! exact distances.

mod always_near;
mod body;
pub(crate) mod checker;
pub(crate) mod convex;
mod cover;
mod edge;
mod fast;
mod fast_piece;
mod field;
mod lane_geometry;
pub(crate) mod lanes;
mod mesh;
mod narrow;
mod pair_table;
mod placed_obstacle;
mod points;
mod polyline;
mod probe;
pub(crate) mod robot_shape;
pub(crate) mod surface;
#[cfg(test)]
mod surface_tests;
#[cfg(test)]
mod tests;
mod triangle;
pub(crate) mod world;

pub use always_near::always_near;
pub use body::MovingBody;
pub use checker::{Checker, CollisionReport};
pub use convex::GeometryError;
pub use mesh::triangulate;
pub use points::SurfaceError;
pub(crate) use probe::Solid;
pub use robot_shape::{RobotError, RobotShape};
pub use world::{AllowedCollisions, Attached, CollisionWorld};
