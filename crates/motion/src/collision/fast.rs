//! Fast path: sphere covers of the robot against bounding primitives of obstacles, eight configurations at a time
//! (SIMD).
//!
//! Written as loops, since closures passed to library functions are not compiled for wide registers.
//!
//! The result is either "clear", "touching", or a list of unresolved pairs and lanes for the exact check. After W.
//! Thomason, Z. Kingston and L. Kavraki, *Motions in Microseconds via Vectorized Sampling-Based Planning* (2024).

use multiversion::multiversion;

use super::convex::Ball;
use super::cover::CoverBall;
use super::fast_piece::FastPiece;
use super::field::DistanceField;
use super::lane_geometry::{LaneFrame, Point, ROUNDING, Transform, add, place, rotate_sparse, scale, then};
use super::lanes::{Lanes, Verdict};
use super::narrow::Skeleton;

/// Robot, obstacles and margins in single precision.
#[derive(Clone, Debug, Default)]
pub(super) struct FastModel<'a> {
    pub(super) joints: Vec<FastJoint>,
    pub(super) bodies: Vec<FastBody<'a>>,
    pub(super) obstacles: Vec<FastObstacle<'a>>,
    /// Clearance thresholds per body and obstacle, row-major by body; `None` if contact is allowed or out of reach.
    pub(super) margins: Vec<Option<FastMargin>>,
    pub(super) body_pairs: Vec<(usize, usize, f32)>,
}

#[derive(Clone, Debug)]
pub(super) struct FastJoint {
    pub(super) parent_frame: usize,
    pub(super) parent_from_joint: Transform,
    pub(super) is_prismatic: bool,
    /// Index of the entry of the configuration that moves the joint. `coupling` holds multiplier and offset of a
    /// coupled joint.
    pub(super) driver: usize,
    pub(super) coupling: Option<[f32; 2]>,
}

/// Clearance between a body and an obstacle (m).
#[derive(Clone, Copy, Debug)]
pub(super) struct FastMargin {
    /// Clear beyond this distance.
    pub(super) accept: f32,
    /// Touching within this distance; if negative, only the exact check decides.
    pub(super) reject: f32,
}

#[derive(Clone, Debug)]
pub(super) struct FastBody<'a> {
    pub(super) frame: usize,
    pub(super) frame_from_body: Transform,
    pub(super) skeletons: &'a [Skeleton],
    pub(super) ball: FastBall,
    pub(super) cover: Vec<FastBall>,
}

#[derive(Clone, Debug)]
pub(super) struct FastObstacle<'a> {
    pub(super) ball: FastBall,
    pub(super) pieces: Vec<FastPiece>,
    /// Distance field of a surface; `None` for an obstacle of convex pieces.
    pub(super) field: Option<&'a DistanceField>,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct FastBall {
    center: [f32; 3],
    radius: f32,
    /// Radius around the centre that is certainly inside the body (m); 0 if unknown.
    inner: f32,
}

/// A pair that may violate its clearance, in the lanes whose bit is set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Unresolved {
    Obstacle { body: usize, obstacle: usize, lanes: u8 },
    Bodies { pair: usize, lanes: u8 },
}

/// A body and an obstacle not proven clear by their spheres in some lanes.
#[derive(Clone, Copy, Debug)]
struct Near {
    body: usize,
    obstacle: usize,
    lanes: u8,
    accept: f32,
    reject: f32,
}

/// Storage reused between batches.
#[derive(Clone, Debug, Default)]
pub(super) struct Scratch {
    /// Joint positions, one per joint and lane.
    pub(super) config: Vec<Lanes>,
    /// Length added to the clearances of each body (m), for checks of whole segments.
    pub(super) inflation: Vec<f32>,
    frames: Vec<LaneFrame>,
    centers: Vec<Point>,
    cover: Vec<Point>,
    near: Vec<Near>,
    pub(super) unresolved: Vec<Unresolved>,
}

/// Lists the pairs not proven clear in the scratch's configurations.
///
/// Returns `false` with an incomplete list as soon as a body and an obstacle certainly violate their clearance in one
/// lane.
#[multiversion(targets("x86_64+avx2", "x86_64+avx"))]
pub(super) fn find_unresolved(model: &FastModel<'_>, scratch: &mut Scratch) -> bool {
    scratch.unresolved.clear();
    forward(&model.joints, &scratch.config, &mut scratch.frames);
    scratch.centers.clear();
    for body in &model.bodies {
        scratch.centers.push(place(&scratch.frames[body.frame], body.ball.center));
    }
    let count = model.obstacles.len();
    scratch.near.clear();
    // From the gripper to the base, since most contacts are at the gripper and one is enough.
    for (index, body) in model.bodies.iter().enumerate().rev() {
        let center = scratch.centers[index];
        scratch.cover.clear();
        for (other, obstacle) in model.obstacles.iter().enumerate() {
            let Some(margin) = model.margins[index * count + other] else { continue };
            let accept = margin.accept + scratch.inflation[index];
            let near = near_obstacle(obstacle, &center, body.ball.radius + accept);
            if near == 0 {
                continue;
            }
            place_all(&scratch.frames[body.frame], &body.cover, &mut scratch.cover);
            let found = compare_all(obstacle, &scratch.cover, &body.cover, accept, margin.reject);
            if found.touching != 0 {
                return false;
            }
            if found.undecided != 0 {
                let (lanes, reject) = (found.undecided, margin.reject);
                scratch.near.push(Near { body: index, obstacle: other, lanes, accept, reject });
            }
        }
    }
    for near in &scratch.near {
        let body = &model.bodies[near.body];
        let verdict = narrow_phase(body, &model.obstacles[near.obstacle], &scratch.frames[body.frame], near);
        if verdict.touching != 0 {
            return false;
        }
        if verdict.undecided != 0 {
            let Near { body, obstacle, .. } = *near;
            scratch.unresolved.push(Unresolved::Obstacle { body, obstacle, lanes: verdict.undecided });
        }
    }
    for (pair, &(first, second, margin)) in model.body_pairs.iter().enumerate() {
        let (a, b) = (&model.bodies[first], &model.bodies[second]);
        let margin = margin + scratch.inflation[first] + scratch.inflation[second];
        let reach = a.ball.radius + b.ball.radius + margin;
        let near = near_point(&scratch.centers[first], &scratch.centers[second], reach);
        if near == 0 {
            continue;
        }
        scratch.cover.clear();
        place_all(&scratch.frames[b.frame], &b.cover, &mut scratch.cover);
        let mut lanes = 0;
        for ball in &a.cover {
            let center = place(&scratch.frames[a.frame], ball.center);
            if near_point(&center, &scratch.centers[second], ball.radius + b.ball.radius + margin) & !lanes == 0 {
                continue;
            }
            for (other, other_center) in b.cover.iter().zip(&scratch.cover) {
                lanes |= near_point(&center, other_center, ball.radius + other.radius + margin);
            }
            if lanes == near {
                break;
            }
        }
        if lanes != 0 {
            scratch.unresolved.push(Unresolved::Bodies { pair, lanes });
        }
    }
    true
}

/// Lanes in which a body is not proven clear of an obstacle; `None` if it certainly touches.
#[multiversion(targets("x86_64+avx2", "x86_64+avx"))]
pub(super) fn find_unresolved_lanes(
    model: &FastModel<'_>,
    scratch: &mut Scratch,
    body: usize,
    obstacle: usize,
) -> Option<u8> {
    let count = model.obstacles.len();
    let Some(FastMargin { accept, reject }) = model.margins[body * count + obstacle] else { return Some(0) };
    let (index, other) = (body, obstacle);
    let (body, obstacle) = (&model.bodies[index], &model.obstacles[other]);
    forward(&model.joints[..body.frame], &scratch.config, &mut scratch.frames);
    let frame = &scratch.frames[body.frame];
    scratch.cover.clear();
    place_all(frame, &body.cover, &mut scratch.cover);
    let found = compare_all(obstacle, &scratch.cover, &body.cover, accept, reject);
    let lanes = found.undecided;
    if lanes == 0 || found.touching != 0 {
        return (found.touching == 0).then_some(0);
    }
    let verdict = narrow_phase(body, obstacle, frame, &Near { body: index, obstacle: other, lanes, accept, reject });
    (verdict.touching == 0).then_some(verdict.undecided)
}

/// Compares all spheres of a cover with an obstacle; stops at the first contact.
#[inline(always)]
fn compare_all(obstacle: &FastObstacle, centers: &[Point], balls: &[FastBall], accept: f32, reject: f32) -> Verdict {
    let mut all = Verdict::default();
    for (ball, center) in balls.iter().zip(centers) {
        let found = compare(obstacle, center, ball, accept, reject);
        if found.touching != 0 {
            return found;
        }
        all.undecided |= found.undecided;
    }
    all
}

/// Narrow phase of one body and one obstacle, piece by piece.
#[inline(always)]
fn narrow_phase(body: &FastBody, obstacle: &FastObstacle, frame: &LaneFrame, near: &Near) -> Verdict {
    let Near { lanes, accept, reject, .. } = *near;
    let mut found = Verdict::default();
    if obstacle.field.is_some() {
        return Verdict { undecided: lanes, touching: 0 };
    }
    let world_from_body = then(frame, &body.frame_from_body);
    for skeleton in body.skeletons {
        let center = place(&world_from_body, skeleton.center);
        for piece in &obstacle.pieces {
            let near = lanes & !found.undecided & piece.near(&center, skeleton.ball_radius + accept);
            if near == 0 {
                continue;
            }
            let core_from_body = piece.core_from_world.before(&world_from_body);
            let verdict = skeleton.compare(piece, &core_from_body, accept, reject, near);
            if verdict.touching != 0 {
                return verdict;
            }
            found.undecided |= verdict.undecided;
        }
    }
    found
}

/// Transforms the centres of a cover unless already done.
#[inline(always)]
fn place_all(frame: &LaneFrame, balls: &[FastBall], centers: &mut Vec<Point>) {
    if centers.is_empty() {
        for ball in balls {
            centers.push(place(frame, ball.center));
        }
    }
}

/// Number of joints whose sines are computed in advance, so that the processor can overlap them.
const PRECOMPUTED: usize = 7;

#[inline(always)]
fn forward(joints: &[FastJoint], config: &[Lanes], frames: &mut Vec<LaneFrame>) {
    let (zero, one) = (Lanes::all(0.0), Lanes::all(1.0));
    frames.clear();
    frames.push(LaneFrame {
        columns: [[one, zero, zero], [zero, one, zero], [zero, zero, one]],
        origin: [zero, zero, zero],
    });
    let mut sines = [(zero, one); PRECOMPUTED];
    let position = |joint: &FastJoint| {
        let q = config[joint.driver];
        joint.coupling.map_or(q, |[multiplier, offset]| q * multiplier + Lanes::all(offset))
    };
    for (sine, joint) in sines.iter_mut().zip(joints) {
        *sine = position(joint).sin_cos();
    }
    for (index, joint) in joints.iter().enumerate() {
        let q = position(joint);
        let parent = &frames[joint.parent_frame];
        let Transform { rows, translation } = &joint.parent_from_joint;
        let column = |k: usize| rotate_sparse(parent, [rows[0][k], rows[1][k], rows[2][k]]);
        let (x, y, z) = (column(0), column(1), column(2));
        let mut origin = add(rotate_sparse(parent, *translation), parent.origin);
        if joint.is_prismatic {
            origin = add(origin, scale(z, q));
            frames.push(LaneFrame { columns: [x, y, z], origin });
        } else {
            let (sin, cos) = sines.get(index).copied().unwrap_or_else(|| q.sin_cos());
            let rotated_x = add(scale(x, cos), scale(y, sin));
            let rotated_y = add(scale(y, cos), scale(x, sin * -1.0));
            frames.push(LaneFrame { columns: [rotated_x, rotated_y, z], origin });
        }
    }
}

#[inline(always)]
fn near_obstacle(obstacle: &FastObstacle, center: &Point, reach: f32) -> u8 {
    if let Some(field) = obstacle.field {
        return field.near(center, reach);
    }
    let ball = &obstacle.ball;
    let [x, y, z] = ball.center;
    let middle = [Lanes::all(x), Lanes::all(y), Lanes::all(z)];
    if near_point(center, &middle, ball.radius + reach) == 0 {
        return 0;
    }
    let mut lanes = 0;
    for piece in &obstacle.pieces {
        lanes |= piece.near(center, reach);
    }
    lanes
}

/// Compares a sphere with an obstacle: near (undecided) or certainly touching, per lane.
#[inline(always)]
fn compare(obstacle: &FastObstacle, center: &Point, ball: &FastBall, accept: f32, reject: f32) -> Verdict {
    let mut found = Verdict::default();
    if let Some(field) = obstacle.field {
        let touch = if ball.inner > 0.0 && reject >= 0.0 { ball.inner + reject } else { 0.0 };
        return field.compare(center, ball.radius + accept, touch);
    }
    for piece in &obstacle.pieces {
        let squared = piece.squared_distance(center);
        let reach = ball.radius + accept + piece.rounding + ROUNDING;
        found.undecided |= (squared - Lanes::all(reach * reach)).not_positive();
        let touch = ball.inner + reject + piece.rounding - ROUNDING;
        if found.undecided != 0 && ball.inner > 0.0 && reject >= 0.0 && piece.exact && touch > 0.0 {
            found.touching |= (squared - Lanes::all(touch * touch)).not_positive();
        }
    }
    found
}

#[inline(always)]
fn near_point(a: &Point, b: &Point, reach: f32) -> u8 {
    let d = [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    let squared = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
    let reach = reach + ROUNDING;
    (squared - Lanes::all(reach * reach)).not_positive()
}

impl From<&Ball> for FastBall {
    fn from(ball: &Ball) -> Self {
        Self { center: ball.center.as_vec3().to_array(), radius: ball.radius as f32, inner: 0.0 }
    }
}

impl From<&CoverBall> for FastBall {
    fn from(ball: &CoverBall) -> Self {
        Self { inner: ball.inner as f32, ..Self::from(&ball.ball) }
    }
}
