//! Collision shells of objects that are open at the top: convex wedges around a cavity, a base, and protrusions. The
//! object stays hollow. A wall of a closed mesh keeps its thickness, at least 1.5 mm; a single surface, or a wall
//! thicker than `MAX_WALL_M`, gets the thickness `SHEET_M`.

use std::f64::consts::TAU;

use genmanip_core::{Aabb, Piece};
use glam::{DVec2, DVec3};

use super::hull;
use crate::clean::is_closed;
use crate::raw::RawMesh;

/// Cells per side of the height map in which the cavity is searched. Chosen by hand.
const CELLS: usize = 72;
/// Fractions of the height at which a closed wall is searched, highest first. Chosen by hand.
const LEVELS: [f64; 5] = [0.9, 0.75, 0.6, 0.45, 0.3];
/// Minimum area of the cavity as a fraction of the footprint, and (`MIN_DEPTH`) minimum depth as a fraction of the
/// height. Chosen by hand.
const MIN_AREA: f64 = 0.12;
const MIN_DEPTH: f64 = 0.2;
/// Number of directions in which the wall is measured, and (`SECTORS`) minimum number of wedges: corners of the outline
/// add more. Chosen by hand.
const DIRECTIONS: usize = 96;
const SECTORS: usize = 24;
/// Heights at which the wall is measured, as fractions of the cavity's depth from the floor. Chosen by hand.
const HEIGHTS: [f64; 4] = [0.02, 0.3, 0.65, 0.95];
/// Minimum fraction of directions in which a ray from the centre must hit the wall. Chosen by hand.
const MIN_HIT_SHARE: f64 = 0.93;
/// Thickness assigned to a wall that is a single surface, and (`MAX_WALL_M`) maximum wall thickness, m. Chosen by hand.
const SHEET_M: f64 = 0.0025;
const MAX_WALL_M: f64 = 0.05;
/// Minimum distance outside the wall from which a vertex counts as protruding, m. Chosen by hand.
const OUTSIDE_M: f64 = 0.004;

/// A hollow object decomposed into convex pieces.
pub struct Shell {
    /// Convex pieces of base and wall.
    pub pieces: Vec<Piece>,
    /// Convex hull of the cavity's volume.
    pub cavity: Piece,
    /// Protruding triangles, such as a handle.
    pub rest: RawMesh,
    /// Mean thickness of the wall, m.
    pub thickness_m: f64,
}

/// Shell of an upright mesh that is open at the top; `None` for any other mesh.
pub fn shell(mesh: &RawMesh) -> Option<Shell> {
    let bounds = Aabb::from_points(mesh.positions.iter().copied());
    let heights = Heights::of(mesh, &bounds);
    let (middle, floor, rim) = heights.hollow()?;
    let wall = Wall::measured(mesh, middle, floor, rim)?;
    let edges = wall.edges();
    let ring = |which: Distance, level: usize, edge: usize, z: f64| {
        let (sin, cos) = (TAU * edge as f64 / DIRECTIONS as f64).sin_cos();
        let radius = which(&wall.stations[level][edge]);
        DVec3::new(middle.x + radius * cos, middle.y + radius * sin, z)
    };
    let z = |level: usize| match level {
        0 => floor,
        level if level + 1 == HEIGHTS.len() => rim,
        level => floor + HEIGHTS[level] * (rim - floor),
    };
    let (inner, outer): (Distance, Distance) = (|s| s.inner, |s| s.outer);
    let mut pieces = Vec::new();
    for (index, &from) in edges.iter().enumerate() {
        let to = edges[(index + 1) % edges.len()];
        for level in 0..HEIGHTS.len() - 1 {
            let corners: Vec<DVec3> = [level, level + 1]
                .into_iter()
                .flat_map(|level| {
                    [from, to].into_iter().flat_map(move |edge| [inner, outer].map(|which| (which, level, edge)))
                })
                .map(|(which, level, edge)| ring(which, level, edge, z(level)))
                .collect();
            pieces.extend(hull::piece(&corners, 16));
        }
    }
    // Base: convex hull of the vertices below the floor that are not outside the wall, and of the wall's outer ring at
    // the floor and halfway down to the bottom.
    let mut base: Vec<DVec3> = edges.iter().map(|&edge| ring(outer, 0, edge, floor)).collect();
    let reach = base.iter().map(|corner| corner.truncate().distance(middle)).fold(0.0, f64::max);
    base.extend(mesh.positions.iter().filter(|p| p.z <= floor && p.truncate().distance(middle) <= reach + 1e-3));
    base.extend(
        edges
            .iter()
            .map(|&edge| ring(outer, 0, edge, floor.min(bounds.min.z + 0.5 * (floor - bounds.min.z))))
            .filter(|p| p.z > bounds.min.z + 1e-4),
    );
    pieces.extend(hull::piece(&base, 64));
    let cavity: Vec<DVec3> = (0..HEIGHTS.len())
        .flat_map(|level| edges.iter().map(move |&edge| (level, edge)))
        .map(|(level, edge)| ring(inner, level, edge, z(level)))
        .collect();
    let cavity = hull::piece(&cavity, 96)?;
    let stations = wall.stations.iter().flatten();
    let thickness_m = stations.clone().map(|s| s.outer - s.inner).sum::<f64>() / stations.count() as f64;
    Some(Shell { pieces, cavity, rest: wall.rest(mesh, middle, floor, rim), thickness_m })
}

/// Height map of a mesh's topmost points.
struct Heights {
    low: DVec2,
    cell: DVec2,
    base: f64,
    height: f64,
    /// Heights in row-major order; minus infinity for empty cells.
    top: Vec<f64>,
}

impl Heights {
    fn of(mesh: &RawMesh, bounds: &Aabb) -> Self {
        // A free border of one cell, from which the outside is flood-filled.
        let cell = bounds.size().truncate() / (CELLS - 2) as f64;
        let low = bounds.min.truncate() - cell;
        let mut map = Self {
            low,
            cell: cell.max(DVec2::splat(1e-9)),
            base: bounds.min.z,
            height: bounds.size().z,
            top: vec![f64::NEG_INFINITY; CELLS * CELLS],
        };
        for triangle in mesh.corners() {
            map.add(triangle);
        }
        map
    }

    fn add(&mut self, [a, b, c]: [DVec3; 3]) {
        let cell = self.cell.min_element();
        let steps =
            |from: DVec3, to: DVec3| (2.0 * (to - from).truncate().length() / cell).ceil().clamp(1.0, 400.0) as usize;
        // Sample the triangle in rows half a cell apart, so that vertical walls are covered as well.
        let rows = steps(a, b).max(steps(a, c));
        for row in 0..=rows {
            let t = row as f64 / rows as f64;
            let (from, to) = (a.lerp(b, t), a.lerp(c, t));
            let columns = steps(from, to);
            for column in 0..=columns {
                let point = from.lerp(to, column as f64 / columns as f64);
                let at = ((point.truncate() - self.low) / self.cell).floor();
                let (x, y) =
                    (at.x.clamp(0.0, CELLS as f64 - 1.0) as usize, at.y.clamp(0.0, CELLS as f64 - 1.0) as usize);
                let top = &mut self.top[y * CELLS + x];
                *top = top.max(point.z);
            }
        }
    }

    /// Centre, floor height and rim height (m) of a cavity enclosed by a closed wall; `None` if there is none.
    fn hollow(&self) -> Option<(DVec2, f64, f64)> {
        let filled = self.top.iter().filter(|top| top.is_finite()).count();
        LEVELS.iter().find_map(|share| {
            let rim = self.base + share * self.height;
            let is_low = |cell: usize| self.top[cell] < rim;
            let outside = self.flood_from_outside(&is_low);
            let inside: Vec<usize> = (0..CELLS * CELLS).filter(|&cell| is_low(cell) && !outside[cell]).collect();
            if (inside.len() as f64) < MIN_AREA * filled as f64 {
                return None;
            }
            let mut heights: Vec<f64> =
                inside.iter().map(|&cell| self.top[cell]).filter(|top| top.is_finite()).collect();
            heights.sort_by(f64::total_cmp);
            // The lowest tenth is ignored: holes in the floor, e.g. of a plant pot.
            let floor = *heights.get(heights.len() / 10)?;
            if heights.len() * 2 < inside.len() || rim - floor < MIN_DEPTH * self.height {
                return None;
            }
            let sum: DVec2 = inside.iter().map(|&cell| DVec2::new((cell % CELLS) as f64, (cell / CELLS) as f64)).sum();
            let middle = self.low + (sum / inside.len() as f64 + 0.5) * self.cell;
            Some((middle, floor, rim))
        })
    }

    fn flood_from_outside(&self, is_low: &dyn Fn(usize) -> bool) -> Vec<bool> {
        let mut reached = vec![false; CELLS * CELLS];
        let mut open = vec![0];
        reached[0] = true;
        while let Some(cell) = open.pop() {
            let (x, y) = (cell % CELLS, cell / CELLS);
            let beside = [
                (x > 0).then(|| cell - 1),
                (x + 1 < CELLS).then_some(cell + 1),
                (y > 0).then(|| cell - CELLS),
                (y + 1 < CELLS).then_some(cell + CELLS),
            ];
            for next in beside.into_iter().flatten() {
                if !reached[next] && is_low(next) {
                    reached[next] = true;
                    open.push(next);
                }
            }
        }
        reached
    }
}

/// Distances of the inner and outer wall surface from the centre, in one direction at one height, m.
#[derive(Clone, Copy, Debug)]
struct Station {
    inner: f64,
    outer: f64,
}

/// Selects the inner or outer distance of a station.
type Distance = fn(&Station) -> f64;

struct Wall {
    /// Stations by height, then direction.
    stations: Vec<Vec<Station>>,
}

impl Wall {
    fn measured(mesh: &RawMesh, middle: DVec2, floor: f64, rim: f64) -> Option<Self> {
        let closed = is_closed(mesh);
        let mut stations = Vec::new();
        for share in HEIGHTS {
            let z = floor + share * (rim - floor);
            // Only triangles that intersect this height can be hit.
            let cut: Vec<[DVec3; 3]> =
                mesh.corners().filter(|t| t.iter().any(|p| p.z <= z) && t.iter().any(|p| p.z >= z)).collect();
            let measured: Vec<Option<Station>> = (0..DIRECTIONS)
                .map(|index| {
                    let (sin, cos) = (TAU * index as f64 / DIRECTIONS as f64).sin_cos();
                    station(&cut, middle.extend(z), DVec3::new(cos, sin, 0.0), closed)
                })
                .collect();
            let met = measured.iter().flatten().count();
            if (met as f64) < MIN_HIT_SHARE * DIRECTIONS as f64 {
                return None;
            }
            stations.push(fill_gaps(&measured));
        }
        Some(Self { stations })
    }

    /// Indices of the directions at which wedges end: evenly spaced, plus corners of the outline.
    fn edges(&self) -> Vec<usize> {
        let outer = |index: usize| self.stations[HEIGHTS.len() / 2][index % DIRECTIONS].outer;
        (0..DIRECTIONS)
            .filter(|&index| {
                let (before, after) = (outer(index + DIRECTIONS - 1), outer(index + 1));
                let is_corner = outer(index) >= before
                    && outer(index) > after
                    && outer(index) > 1.01 * outer(index + 4).min(outer(index + DIRECTIONS - 4));
                index % (DIRECTIONS / SECTORS) == 0 || is_corner
            })
            .collect()
    }

    /// Triangles that protrude from the wall, such as a handle.
    fn rest(&self, mesh: &RawMesh, middle: DVec2, floor: f64, rim: f64) -> RawMesh {
        let is_outside = |point: DVec3| {
            let across = point.truncate() - middle;
            let direction = (across.to_angle().rem_euclid(TAU) / TAU * DIRECTIONS as f64).round() as usize % DIRECTIONS;
            let share = (point.z - floor) / (rim - floor);
            let level = HEIGHTS.iter().rposition(|height| *height <= share).unwrap_or(0);
            let around = [direction + DIRECTIONS - 1, direction, direction + 1].map(|index| index % DIRECTIONS);
            let levels = [level, (level + 1).min(HEIGHTS.len() - 1)];
            let reach = levels.iter().flat_map(|&level| around.map(|index| self.stations[level][index].outer));
            across.length() > reach.fold(0.0, f64::max) + OUTSIDE_M || point.z > rim + 0.15 * (rim - floor)
        };
        let outside: Vec<bool> = mesh.positions.iter().map(|point| is_outside(*point)).collect();
        let triangles =
            mesh.triangles.iter().filter(|t| t.iter().filter(|&&index| outside[index as usize]).count() >= 2);
        RawMesh { positions: mesh.positions.clone(), uvs: Vec::new(), triangles: triangles.copied().collect() }
    }
}

/// First entry and exit of a ray from the centre through the wall. `None` if the ray hits nothing.
fn station(triangles: &[[DVec3; 3]], from: DVec3, along: DVec3, closed: bool) -> Option<Station> {
    let mut hits: Vec<f64> = triangles.iter().filter_map(|triangle| ray_hit(triangle, from, along)).collect();
    hits.sort_by(f64::total_cmp);
    let inner = *hits.first()?;
    let next = hits.iter().copied().find(|hit| *hit > inner + 2e-4 && *hit < inner + MAX_WALL_M);
    let outer = next.filter(|_| closed).unwrap_or(inner + SHEET_M);
    // Minimum thickness that physics engines resolve without tunnelling.
    Some(Station { inner, outer: outer.max(inner + 0.6 * SHEET_M) })
}

/// Distance at which a ray hits a triangle (Möller and Trumbore 1997). `None` if it misses.
fn ray_hit(&[a, b, c]: &[DVec3; 3], from: DVec3, along: DVec3) -> Option<f64> {
    let (e1, e2) = (b - a, c - a);
    let p = along.cross(e2);
    let determinant = e1.dot(p);
    if determinant.abs() < 1e-18 {
        return None;
    }
    let s = from - a;
    let u = s.dot(p) / determinant;
    let q = s.cross(e1);
    let v = along.dot(q) / determinant;
    let t = e2.dot(q) / determinant;
    (u >= -1e-9 && v >= -1e-9 && u + v <= 1.0 + 1e-9 && t > 1e-6).then_some(t)
}

/// Fills directions without a hit from the nearest direction with one.
fn fill_gaps(measured: &[Option<Station>]) -> Vec<Station> {
    let count = measured.len();
    (0..count)
        .map(|index| {
            let nearest =
                (0..count).find_map(|off| measured[(index + off) % count].or(measured[(index + count - off) % count]));
            nearest.unwrap_or(Station { inner: SHEET_M, outer: 2.0 * SHEET_M })
        })
        .collect()
}
