//! The fast path: balls that cover the robot against simple bounds of the obstacles, eight configurations at a time.
//!
//! Its answer is either "clear" or "look closely at this pair in these lanes"; it never says "collision".
//! After W. Thomason, Z. Kingston and L. Kavraki, *Motions in Microseconds via Vectorized Sampling-Based Planning* (2024).

use multiversion::multiversion;

use super::convex::{Ball, Core};
use super::lanes::{LANES, Lanes};
use crate::rigid::Rigid;

/// Rounding of single precision over the length of an arm, m.
const ROUNDING: f32 = 2e-5;

/// Robot, obstacles and margins in single precision.
#[derive(Clone, Debug, Default)]
pub(super) struct FastModel {
    pub(super) joints: Vec<FastJoint>,
    pub(super) bodies: Vec<FastBody>,
    pub(super) obstacles: Vec<FastObstacle>,
    /// Row by row of bodies; `None` where contact is allowed.
    pub(super) margins: Vec<Option<f32>>,
    pub(super) body_pairs: Vec<(usize, usize, f32)>,
}

#[derive(Clone, Debug)]
pub(super) struct FastJoint {
    pub(super) parent_frame: usize,
    pub(super) parent_from_joint: Transform,
    pub(super) slides: bool,
}

#[derive(Clone, Debug)]
pub(super) struct FastBody {
    pub(super) frame: usize,
    pub(super) ball: FastBall,
    pub(super) cover: Vec<FastBall>,
}

#[derive(Clone, Debug)]
pub(super) struct FastObstacle {
    pub(super) ball: FastBall,
    pub(super) pieces: Vec<FastPiece>,
}

/// A primitive at least as large as the piece it stands for.
#[derive(Clone, Debug)]
pub(super) struct FastPiece {
    core_from_world: Transform,
    shape: FastShape,
    rounding: f32,
}

#[derive(Clone, Debug)]
enum FastShape {
    Box([f32; 3]),
    Cylinder {
        radius: f32,
        half_height: f32,
    },
    /// A point when the half length is 0.
    Segment(f32),
}

/// Rows of a rotation matrix, and a translation.
#[derive(Clone, Copy, Debug)]
pub(super) struct Transform {
    rows: [[f32; 3]; 3],
    translation: [f32; 3],
}

#[derive(Clone, Copy, Debug)]
pub(super) struct FastBall {
    center: [f32; 3],
    radius: f32,
}

/// A pair that may be too near; for obstacles in the lanes whose bit is set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Doubt {
    Obstacle { body: usize, obstacle: usize, lanes: u8 },
    Bodies { pair: usize },
}

type Point = [Lanes; 3];

/// `world_from_frame` in every lane: columns of the rotation, and the origin.
#[derive(Clone, Copy)]
pub(super) struct LaneFrame {
    columns: [Point; 3],
    origin: Point,
}

/// Storage that is used again from batch to batch.
#[derive(Default)]
pub(super) struct Scratch {
    frames: Vec<LaneFrame>,
    centers: Vec<Point>,
    cover: Vec<Point>,
    pub(super) doubts: Vec<Doubt>,
}

/// Lists the pairs that are not proven clear; `config` holds one position per joint and lane.
#[multiversion(targets("x86_64+avx2", "x86_64+avx"))]
pub(super) fn find_doubts(model: &FastModel, config: &[Lanes], scratch: &mut Scratch) {
    scratch.doubts.clear();
    forward(model, config, &mut scratch.frames);
    scratch.centers.clear();
    for body in &model.bodies {
        scratch.centers.push(place(&scratch.frames[body.frame], &body.ball));
    }
    let count = model.obstacles.len();
    for (index, body) in model.bodies.iter().enumerate() {
        let center = scratch.centers[index];
        scratch.cover.clear();
        for (other, obstacle) in model.obstacles.iter().enumerate() {
            let Some(margin) = model.margins[index * count + other] else { continue };
            let near = near_obstacle(obstacle, &center, body.ball.radius + margin);
            if near == 0 {
                continue;
            }
            place_all(&scratch.frames[body.frame], &body.cover, &mut scratch.cover);
            let mut lanes = 0;
            for (ball, center) in body.cover.iter().zip(&scratch.cover) {
                lanes |= near_obstacle(obstacle, center, ball.radius + margin);
                if lanes == near {
                    break;
                }
            }
            if lanes != 0 {
                scratch.doubts.push(Doubt::Obstacle { body: index, obstacle: other, lanes });
            }
        }
    }
    for (pair, &(first, second, margin)) in model.body_pairs.iter().enumerate() {
        let (a, b) = (&model.bodies[first], &model.bodies[second]);
        let reach = a.ball.radius + b.ball.radius + margin;
        if near_point(&scratch.centers[first], &scratch.centers[second], reach) == 0 {
            continue;
        }
        scratch.cover.clear();
        place_all(&scratch.frames[b.frame], &b.cover, &mut scratch.cover);
        let near = a.cover.iter().any(|ball| {
            let center = place(&scratch.frames[a.frame], ball);
            near_point(&center, &scratch.centers[second], ball.radius + b.ball.radius + margin) != 0
                && b.cover.iter().zip(&scratch.cover).any(|(other, other_center)| {
                    near_point(&center, other_center, ball.radius + other.radius + margin) != 0
                })
        });
        if near {
            scratch.doubts.push(Doubt::Bodies { pair });
        }
    }
}

/// Centres of the balls of a cover, unless they are there already.
#[inline(always)]
fn place_all(frame: &LaneFrame, balls: &[FastBall], centers: &mut Vec<Point>) {
    if centers.is_empty() {
        centers.extend(balls.iter().map(|ball| place(frame, ball)));
    }
}

#[inline(always)]
fn forward(model: &FastModel, config: &[Lanes], frames: &mut Vec<LaneFrame>) {
    let (zero, one) = (Lanes::all(0.0), Lanes::all(1.0));
    frames.clear();
    frames.push(LaneFrame {
        columns: [[one, zero, zero], [zero, one, zero], [zero, zero, one]],
        origin: [zero, zero, zero],
    });
    for (joint, q) in model.joints.iter().zip(config) {
        let parent = &frames[joint.parent_frame];
        let Transform { rows, translation } = &joint.parent_from_joint;
        let column = |k: usize| turn(parent, [rows[0][k], rows[1][k], rows[2][k]]);
        let (x, y, z) = (column(0), column(1), column(2));
        let mut origin = add(turn(parent, *translation), parent.origin);
        if joint.slides {
            origin = add(origin, scale(z, *q));
            frames.push(LaneFrame { columns: [x, y, z], origin });
        } else {
            let sin = q.sin();
            let cos = (*q + Lanes::all(std::f32::consts::FRAC_PI_2)).sin();
            let turned_x = add(scale(x, cos), scale(y, sin));
            let turned_y = add(scale(y, cos), scale(x, sin * -1.0));
            frames.push(LaneFrame { columns: [turned_x, turned_y, z], origin });
        }
    }
}

#[inline(always)]
fn near_obstacle(obstacle: &FastObstacle, center: &Point, reach: f32) -> u8 {
    if let [piece] = obstacle.pieces.as_slice() {
        return piece.near(center, reach);
    }
    let ball = &obstacle.ball;
    let middle = ball.center.map(Lanes::all);
    if near_point(center, &middle, ball.radius + reach) == 0 {
        return 0;
    }
    obstacle.pieces.iter().fold(0, |lanes, piece| lanes | piece.near(center, reach))
}

#[inline(always)]
fn near_point(a: &Point, b: &Point, reach: f32) -> u8 {
    let d = [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    let squared = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
    let reach = reach + ROUNDING;
    (squared - Lanes::all(reach * reach)).not_positive()
}

impl FastPiece {
    #[inline(always)]
    fn near(&self, center: &Point, reach: f32) -> u8 {
        let Transform { rows, translation } = &self.core_from_world;
        let local = |k: usize| {
            center[0] * rows[k][0] + center[1] * rows[k][1] + center[2] * rows[k][2] + Lanes::all(translation[k])
        };
        let (x, y, z) = (local(0), local(1), local(2));
        let beyond = |value: Lanes, half: f32| value.map(|v| (v.abs() - half).max(0.0));
        let squared = match self.shape {
            FastShape::Box([hx, hy, hz]) => {
                let (x, y, z) = (beyond(x, hx), beyond(y, hy), beyond(z, hz));
                x * x + y * y + z * z
            }
            FastShape::Cylinder { radius, half_height } => {
                let across = (x * x + y * y).map(|squared| (squared.sqrt() - radius).max(0.0));
                let z = beyond(z, half_height);
                across * across + z * z
            }
            FastShape::Segment(half_length) => {
                let z = beyond(z, half_length);
                x * x + y * y + z * z
            }
        };
        let reach = reach + self.rounding + ROUNDING;
        (squared - Lanes::all(reach * reach)).not_positive()
    }

    pub(super) fn new(core: &Core, rounding: f64, core_from_world: &Rigid) -> Self {
        let mut core_from_world = *core_from_world;
        let shape = match core {
            Core::Point => FastShape::Segment(0.0),
            Core::Segment(half_length) => FastShape::Segment(*half_length as f32),
            Core::Box(half) | Core::Ellipsoid(half) => FastShape::Box(half.as_vec3().to_array()),
            Core::Cylinder { radius, half_height } => {
                FastShape::Cylinder { radius: *radius as f32, half_height: *half_height as f32 }
            }
            Core::Hull { center, half, .. } => {
                core_from_world.translation -= *center;
                FastShape::Box(half.as_vec3().to_array())
            }
        };
        Self { core_from_world: Transform::from(&core_from_world), shape, rounding: rounding as f32 }
    }
}

#[inline(always)]
fn place(frame: &LaneFrame, ball: &FastBall) -> Point {
    add(turn(frame, ball.center), frame.origin)
}

#[inline(always)]
fn turn(frame: &LaneFrame, vector: [f32; 3]) -> Point {
    let [x, y, z] = &frame.columns;
    let row = |k: usize| x[k] * vector[0] + y[k] * vector[1] + z[k] * vector[2];
    [row(0), row(1), row(2)]
}

#[inline(always)]
fn add(a: Point, b: Point) -> Point {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

#[inline(always)]
fn scale(a: Point, factor: Lanes) -> Point {
    [a[0] * factor, a[1] * factor, a[2] * factor]
}

impl From<&Rigid> for Transform {
    fn from(rigid: &Rigid) -> Self {
        let columns = rigid.rotation.transpose().to_cols_array_2d();
        Self {
            rows: columns.map(|row| row.map(|value| value as f32)),
            translation: rigid.translation.as_vec3().to_array(),
        }
    }
}

impl From<&Ball> for FastBall {
    fn from(ball: &Ball) -> Self {
        Self { center: ball.center.as_vec3().to_array(), radius: ball.radius as f32 }
    }
}

/// The lanes whose bits are set.
pub(super) fn lanes_of(mask: u8) -> impl Iterator<Item = usize> {
    (0..LANES).filter(move |lane| mask >> lane & 1 == 1)
}
