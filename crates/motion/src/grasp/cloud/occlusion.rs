//! Occlusion model: completion of the target's hidden sides, and unobserved space.

use glam::{DQuat, DVec3};

use super::points::{Seen, long_axis};

/// Space behind observed points, world frame; empty without cameras.
#[derive(Debug)]
pub(super) struct Occlusion {
    views: Vec<DepthBuffer>,
    heights: HeightGrid,
    middle: DVec3,
}

impl Occlusion {
    /// Builds the model from target points, scene points and camera positions.
    pub(super) fn new(target: &[DVec3], scene: &[DVec3], cameras: &[DVec3]) -> Self {
        let middle = target.iter().sum::<DVec3>() / target.len() as f64;
        let views = cameras.iter().map(|&camera| DepthBuffer::new(camera, middle, target, scene)).collect();
        let heights = if cameras.is_empty() { HeightGrid::default() } else { HeightGrid::new(middle, target, scene) };
        Self { views, heights, middle }
    }

    /// True if other objects hide a point from every camera: the target may extend there.
    pub(super) fn is_behind_others(&self, point: DVec3) -> bool {
        !self.views.is_empty() && self.views.iter().all(|view| view.depth_behind(point)[1] > BEHIND_M)
    }

    /// True if a point lies below an observed surface and is hidden from every camera: most likely inside a solid.
    pub(super) fn is_inside(&self, point: DVec3) -> bool {
        !self.views.is_empty() && self.heights.above(point) > BELOW_M && self.depth_behind(point) > BEHIND_M
    }

    /// Adds points of the completed target to the height grid.
    pub(super) fn add_estimated(&mut self, guessed: &[Seen]) {
        self.heights.add(guessed.iter().map(|seen| seen.point));
    }

    /// Completes hidden sides by mirroring observed points into occluded space.
    ///
    /// Assumes symmetry about a vertical plane that roughly faces the cameras (Bohg et al., *Mind the Gap: Robotic
    /// Grasping under Incomplete Observation*, 2011). For each of several directions, the farthest plane is tested of
    /// whose mirror image at most the share `1 - hidden_share` should have been visible to a camera; the plane whose
    /// image best matches observed points is used.
    pub(super) fn complete(&self, points: &[DVec3], hidden_share: f64) -> Vec<Seen> {
        let sample: Vec<DVec3> = points.iter().copied().step_by((points.len() / 150).max(1)).collect();
        let allowed = ((1.0 - hidden_share) * sample.len() as f64) as usize;
        let best = self.mirror_normals(points).into_iter().filter_map(|normal| {
            let plane = |step: i32| Mirror { normal, middle: self.middle - normal * (f64::from(step) * OFFSET_M) };
            let matching = |step: i32| self.matching(&sample, &plane(step), allowed).map(|count| (count, step));
            // The plane one step closer is used, since the surface extends slightly beyond its points.
            OFFSETS.rev().find_map(matching).map(|(count, step)| (count as f64 / sample.len() as f64, plane(step - 1)))
        });
        // Prefer the first direction, towards the cameras, unless another fits clearly better.
        let better =
            |best: (f64, Mirror), next: (f64, Mirror)| if next.0 > best.0 + MIN_IMPROVEMENT { next } else { best };
        let Some((_, mirror)) = best.reduce(better) else { return Vec::new() };
        let images =
            points.iter().map(|&point| mirror.image(point)).filter(|&point| self.depth_behind(point) > HIDDEN_M);
        images.map(|point| Seen { point, guessed: true }).collect()
    }

    /// Number of mirrored points that match observed ones; `None` if more than `allowed` would be visible to a camera.
    fn matching(&self, points: &[DVec3], mirror: &Mirror, allowed: usize) -> Option<usize> {
        let (mut seen, mut matching) = (0, 0);
        for &point in points {
            let depth_behind = self.depth_behind(mirror.image(point));
            seen += usize::from(depth_behind <= 0.0);
            if seen > allowed {
                return None;
            }
            matching += usize::from(depth_behind > 0.0 && depth_behind <= MATCH_M);
        }
        Some(matching)
    }

    /// Candidate mirror normals: horizontal directions towards the cameras, nearby ones, and the target's axes that
    /// face the cameras.
    fn mirror_normals(&self, points: &[DVec3]) -> Vec<DVec3> {
        let camera = self.views.iter().map(|view| view.camera).sum::<DVec3>() / self.views.len() as f64;
        let Some(towards) = DVec3::new(camera.x - self.middle.x, camera.y - self.middle.y, 0.0).try_normalize() else {
            return Vec::new();
        };
        let long = long_axis(points.iter().copied(), self.middle);
        let axes = [long, -long, DVec3::new(-long.y, long.x, 0.0), DVec3::new(long.y, -long.x, 0.0)];
        let rotated =
            [0.0, 0.15, -0.15, 0.3, -0.3, 0.45, -0.45, 0.6, -0.6].map(|angle| DQuat::from_rotation_z(angle) * towards);
        rotated.into_iter().chain(axes.into_iter().filter(|axis| axis.dot(towards) > 0.5)).collect()
    }

    /// Depth of a point behind the nearest observed surface (m): the minimum over the cameras.
    fn depth_behind(&self, point: DVec3) -> f64 {
        let depth_behind =
            self.views.iter().map(|view| view.depth_behind(point).into_iter().fold(f64::NEG_INFINITY, f64::max));
        depth_behind.fold(f64::INFINITY, f64::min)
    }
}

/// A vertical mirror plane.
struct Mirror {
    normal: DVec3,
    middle: DVec3,
}

impl Mirror {
    fn image(&self, point: DVec3) -> DVec3 {
        point - self.normal * (2.0 * (point - self.middle).dot(self.normal))
    }
}

/// Plane offsets along the mirror normal from the target's centroid, in steps of [`OFFSET_M`].
const OFFSETS: std::ops::RangeInclusive<i32> = -6..=15;
const OFFSET_M: f64 = 0.003;
/// Maximum depth behind an observed surface that counts as a match (m).
const MATCH_M: f64 = 0.005;
/// Minimum depth (m) behind an observed surface at which a mirrored point is added; points nearer to it bring no
/// information.
const HIDDEN_M: f64 = 0.003;
/// Minimum improvement of the share of matching points to prefer another direction than the first.
const MIN_IMPROVEMENT: f64 = 0.05;

/// Minimum depth behind ([`BEHIND_M`]) and below ([`BELOW_M`]) a surface [m] for occlusion: ignores noise and thin
/// walls.
const BEHIND_M: f64 = 0.004;
const BELOW_M: f64 = 0.006;

/// Depth buffer around the target as seen from one camera.
#[derive(Debug)]
struct DepthBuffer {
    camera: DVec3,
    axes: [DVec3; 3],
    distance: f64,
    /// Nearest depth along the camera axis, of target and scene (m).
    nearest: Vec<[f32; 2]>,
}

/// Cells per side of the depth buffer, and their size at the target (m).
const CELLS: usize = 160;
const CELL_M: f64 = 0.003;

impl DepthBuffer {
    fn new(camera: DVec3, middle: DVec3, target: &[DVec3], scene: &[DVec3]) -> Self {
        let forward = (middle - camera).normalize_or(DVec3::NEG_Z);
        let right = forward.any_orthonormal_vector();
        let mut view = Self {
            camera,
            axes: [right, forward.cross(right), forward],
            distance: middle.distance(camera),
            nearest: vec![[f32::INFINITY; 2]; CELLS * CELLS],
        };
        for (layer, points) in [target, scene].into_iter().enumerate() {
            for &point in points {
                let Some((column, row, range)) = view.cell(point) else { continue };
                // Points are several cells apart: each covers its neighbours.
                for row in row.saturating_sub(1)..(row + 2).min(CELLS) {
                    for column in column.saturating_sub(1)..(column + 2).min(CELLS) {
                        let nearest = &mut view.nearest[row * CELLS + column][layer];
                        *nearest = nearest.min(range as f32);
                    }
                }
            }
        }
        view
    }

    fn cell(&self, point: DVec3) -> Option<(usize, usize, f64)> {
        let offset = point - self.camera;
        let [x, y, range] = self.axes.map(|axis| offset.dot(axis));
        if range <= 0.0 {
            return None;
        }
        let scale = self.distance / (CELL_M * range);
        let place = |value: f64| {
            let cell = value * scale + CELLS as f64 / 2.0;
            (0.0..CELLS as f64).contains(&cell).then_some(cell as usize)
        };
        Some((place(x)?, place(y)?, range))
    }

    /// Depth of a point behind target and scene (m); negative if it is in front of them, or nothing was observed there.
    fn depth_behind(&self, point: DVec3) -> [f64; 2] {
        let Some((column, row, range)) = self.cell(point) else { return [f64::NEG_INFINITY; 2] };
        self.nearest[row * CELLS + column].map(|nearest| range - f64::from(nearest))
    }
}

/// Height grid: highest observed point in each cell around the target.
#[derive(Debug, Default)]
struct HeightGrid {
    corner: DVec3,
    highest: Vec<f32>,
}

/// Cells per side of the height grid, and their size (m).
const GRID_CELLS: usize = 80;
const GRID_CELL_M: f64 = 0.005;

impl HeightGrid {
    fn new(middle: DVec3, target: &[DVec3], scene: &[DVec3]) -> Self {
        let half = GRID_CELLS as f64 * GRID_CELL_M / 2.0;
        let mut heights = Self {
            corner: middle - DVec3::new(half, half, 0.0),
            highest: vec![f32::NEG_INFINITY; GRID_CELLS * GRID_CELLS],
        };
        heights.add(target.iter().chain(scene).copied());
        heights
    }

    fn add(&mut self, points: impl Iterator<Item = DVec3>) {
        for point in points {
            if let Some(cell) = self.cell(point) {
                self.highest[cell] = self.highest[cell].max(point.z as f32);
            }
        }
    }

    fn cell(&self, point: DVec3) -> Option<usize> {
        let place = |value: f64| {
            let cell = value / GRID_CELL_M;
            (0.0..GRID_CELLS as f64).contains(&cell).then_some(cell as usize)
        };
        Some(place(point.y - self.corner.y)? * GRID_CELLS + place(point.x - self.corner.x)?)
    }

    /// Depth of a point below the highest observed point of its cell (m); negative if it is above or the cell is empty.
    fn above(&self, point: DVec3) -> f64 {
        self.cell(point).map_or(f64::NEG_INFINITY, |cell| f64::from(self.highest[cell]) - point.z)
    }
}
