//! An observed object: its points and a convex body for collision checking.

use genmanip_core::{Aabb, Piece, Pose, Shape};
use glam::{DVec2, DVec3};

/// Number of sampled directions for the vertices of the hull. Chosen by hand.
const HULL_DIRECTIONS: usize = 80;
/// Number of sampled horizontal directions for the vertices of the base. Chosen by hand.
const BASE_DIRECTIONS: usize = 16;
/// Maximum height of an object's lowest visible point for the object to count as standing on the table (m).
const ON_TABLE_M: f64 = 0.012;
/// Minimum height of the body of a flat object (m). Chosen by hand.
const MIN_HEIGHT_M: f64 = 0.004;
/// Gap between the body and its support (m): measured points are less accurate than that, and a body that touched its
/// support would be in collision.
const ABOVE_BASE_M: f64 = 0.002;
/// Share of points at each end of each axis that are excluded from the extent as outliers: stray pixels at edges.
const OUTLIER_SHARE: f64 = 0.002;

/// An object to be moved. Its frame is upright, at the centre of its footprint, at the height of its support.
#[derive(Clone, Debug)]
pub struct ObservedObject {
    /// Object points, world frame (m).
    pub points: Vec<DVec3>,
    /// `world_from_object`: centre of the footprint, height of the support, no rotation.
    pub pose: Pose,
    /// Convex body, object frame: hull of the extreme points in sampled directions, which other points may exceed
    /// slightly, and of their outline 2 mm above the base.
    pub pieces: Vec<Piece>,
    /// Half extents along x and y (m).
    pub half: DVec2,
    /// Height above the base (m).
    pub height_m: f64,
}

impl ObservedObject {
    /// Builds an object from its points; `around` holds the points of everything else, both in the world frame, and
    /// `table_height` is the table's z (m). `None` for fewer than 12 points.
    pub fn new(points: Vec<DVec3>, around: &[DVec3], table_height: f64) -> Option<Self> {
        let bounds = robust_bounds(&points)?;
        let points: Vec<DVec3> = points.into_iter().filter(|point| is_inside(&bounds, *point)).collect();
        let under = around.iter().filter(|point| {
            let margin = 0.01;
            point.x > bounds.min.x - margin
                && point.x < bounds.max.x + margin
                && point.y > bounds.min.y - margin
                && point.y < bounds.max.y + margin
        });
        let base = match bounds.min.z - table_height < ON_TABLE_M {
            true => table_height,
            // The object stands on something else: the lowest other point within 1 cm of its bounds counts as the
            // support's height.
            false => under.map(|point| point.z).fold(bounds.min.z, f64::min).max(table_height),
        };
        let center = bounds.center().truncate();
        let pose = Pose::from_position(center.extend(base));
        let local: Vec<DVec3> = points.iter().map(|&point| point - pose.position).collect();
        let height_m = (bounds.max.z - base).max(MIN_HEIGHT_M);
        Some(Self {
            pieces: vec![body(&local, height_m)],
            pose,
            half: bounds.size().truncate() / 2.0,
            height_m,
            points,
        })
    }
}

/// Bounds without outliers.
fn robust_bounds(points: &[DVec3]) -> Option<Aabb> {
    if points.len() < 12 {
        return None;
    }
    let mut bounds = Aabb::EMPTY;
    let mut ends = [[0.0; 2]; 3];
    for (axis, ends) in ends.iter_mut().enumerate() {
        let mut along: Vec<f64> = points.iter().map(|point| point[axis]).collect();
        along.sort_by(f64::total_cmp);
        let skip = (along.len() as f64 * OUTLIER_SHARE) as usize;
        *ends = [along[skip], along[along.len() - 1 - skip]];
    }
    bounds = bounds.including(DVec3::new(ends[0][0], ends[1][0], ends[2][0]));
    Some(bounds.including(DVec3::new(ends[0][1], ends[1][1], ends[2][1])))
}

fn is_inside(bounds: &Aabb, point: DVec3) -> bool {
    let margin = DVec3::splat(0.002);
    point.cmpge(bounds.min - margin).all() && point.cmple(bounds.max + margin).all()
}

/// Convex hull of the extreme points and of their footprint.
fn body(points: &[DVec3], height_m: f64) -> Piece {
    let farthest = |direction: DVec3| {
        points.iter().copied().max_by(|a, b| a.dot(direction).total_cmp(&b.dot(direction))).unwrap_or_default()
    };
    let mut corners: Vec<DVec3> = (0..HULL_DIRECTIONS)
        .map(|index| {
            // Vogel spiral: evenly distributed directions.
            let z = 1.0 - (2.0 * index as f64 + 1.0) / HULL_DIRECTIONS as f64;
            let turn = index as f64 * std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
            let level = (1.0 - z * z).sqrt();
            farthest(DVec3::new(level * turn.cos(), level * turn.sin(), z))
        })
        .collect();
    for index in 0..BASE_DIRECTIONS {
        let turn = index as f64 / BASE_DIRECTIONS as f64 * std::f64::consts::TAU;
        let edge = farthest(DVec3::new(turn.cos(), turn.sin(), 0.0));
        corners.push(edge.with_z(ABOVE_BASE_M));
        corners.push(edge.with_z((edge.z).max(MIN_HEIGHT_M.min(height_m))));
    }
    for corner in &mut corners {
        corner.z = corner.z.max(ABOVE_BASE_M);
    }
    corners.sort_by(|a, b| a.to_array().partial_cmp(&b.to_array()).unwrap_or(std::cmp::Ordering::Equal));
    corners.dedup_by(|a, b| a.distance(*b) < 5e-4);
    Piece::at(DVec3::ZERO, Shape::Hull { points: corners })
}
