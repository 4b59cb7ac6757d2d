//! Collision: named obstacles, the robot's exact pieces, a carried object, and rules about who may touch whom.
//!
//! The question is always whether moving bodies keep their *margins*, in metres, from obstacles and from each other, at
//! one configuration or everywhere along straight joint-space edges.
//! A body is a link that has pieces, or the attached object; the base is tested against links only, not against obstacles.
//!
//! **What there is of each body and obstacle**, compiled once per robot, per obstacle or per query, metres throughout:
//!
//! | form | file | says |
//! |---|---|---|
//! | exact pieces: a convex core rounded by a radius, with a ball around it | `convex` | the distance, negative where they penetrate (GJK and EPA, 64 bits) |
//! | cover: balls that hold a body, each with a radius that is surely inside | `cover` | bounds from above and below, of bodies |
//! | skeleton: at most some dozens of corners of a piece | `narrow` | clear, touching or undecided |
//! | simple bound: box, cylinder or segment around an obstacle's piece | `fast_piece` | the same, by squared distances |
//! | surface: a tree over the points of a cloud or the `triangle`s of a mesh (`points` and `mesh` build it) | `surface` | exact, facet by facet; `probe` and its planes of a piece's faces spare most of it |
//! | field: a grid of distance bounds around a surface | `field` | clear or touching by one look-up |
//! | table over two joints for a pair of links that only these move | `pair_table` | a lower bound on their distance |
//!
//! `robot_shape` holds the compiled robot, `world` obstacles, attached object and allowed contacts, `body` and
//! `placed_obstacle` what of it stands where in one query, and [`Checker`] all of that with a margin per pair.
//! `lanes` and `lane_geometry` compute eight configurations at a time in 32 bits; `ROUNDING` (2e-5 m) is what that may
//! lose, and every bound gives it away on the safe side.
//!
//! **Margins.** A query has one `padding`; a pair whose contact is allowed, or that can never meet, has none.
//! [`Checker::relax`] lets start and goal of a motion be nearer: such a pair keeps nearly the distance that it has there,
//! and of a surface only the facets that are near are excused.
//! The fast path turns a margin into two: beyond `accept` a pair is clear, within `reject` it surely touches.
//!
//! **In which order they are asked** (`edge` for one edge, as the search tries them; `polyline` for a whole path, at the
//! end):
//!
//! 1. Eight states at a time go through forward kinematics (`fast`): of an edge's states, which are so close that no point
//!    moves farther than `spacing` between two of them (the *motion bounds* of the joints say so), or of the middles of
//!    stretches, with margins widened by what a body may move over half a stretch.
//! 2. Each body's ball against each obstacle's ball, bounds or field; then the body's cover; most pairs are clear here.
//! 3. What is left: skeletons against simple bounds, by a few Frank-Wolfe steps. A certain touch ends the query at once.
//! 4. What is undecided is a `Doubt`: this pair, in these lanes. Obstacles are then asked exactly, one state at a time; a
//!    path first cuts a doubtful stretch into steps of `spacing` and asks 1 to 3 again for that pair alone.
//! 5. Doubtful pairs of bodies come last, and are followed along the whole edge by conservative advancement: the table's
//!    bound or the exact distance at one state is also how far the pair may move before it can meet.
//!
//! With `spacing` at most twice the padding nothing can be touched between two states that keep it; a pair that may come
//! closer is followed in steps a fifth as long.
//! [`Checker::check`] and [`Checker::is_free`] answer for one configuration: balls, then exactly.

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

pub use body::Part;
pub use checker::{Checker, CollisionReport};
pub use convex::GeometryError;
pub use mesh::triangulate;
pub use points::SurfaceError;
pub(crate) use probe::Solid;
pub use robot_shape::{RobotError, RobotShape};
pub use world::{Allowed, Attached, CollisionWorld};
