//! What no camera saw: the target's far sides, guessed, and space in which something may be.

use glam::{DQuat, DVec3};

use super::points::{Seen, long_axis};

/// The space behind what was seen, world frame; empty without cameras.
#[derive(Debug)]
pub(super) struct Unseen {
    views: Vec<View>,
    tops: Tops,
    middle: DVec3,
}

impl Unseen {
    /// From points of the target, of everything else, and where the cameras were.
    pub(super) fn new(target: &[DVec3], scene: &[DVec3], cameras: &[DVec3]) -> Self {
        let middle = target.iter().sum::<DVec3>() / target.len() as f64;
        let views = cameras.iter().map(|&eye| View::new(eye, middle, target, scene)).collect();
        let tops = if cameras.is_empty() { Tops::default() } else { Tops::new(middle, target, scene) };
        Self { views, tops, middle }
    }

    /// Whether something else than the target keeps every camera from seeing a point: the target may go on there.
    pub(super) fn is_behind_others(&self, point: DVec3) -> bool {
        !self.views.is_empty() && self.views.iter().all(|view| view.before(point)[1] > BEHIND_M)
    }

    /// Whether a point lies below a surface that was seen from above, and no camera sees it: most likely in a solid.
    pub(super) fn is_inside(&self, point: DVec3) -> bool {
        !self.views.is_empty() && self.tops.above(point) > BELOW_M && self.before(point) > BEHIND_M
    }

    /// Takes what was guessed for seen from above as well.
    pub(super) fn raise(&mut self, guessed: &[Seen]) {
        self.tops.add(guessed.iter().map(|seen| seen.point));
    }

    /// Mirror images of what was seen, where every camera's view was blocked.
    ///
    /// Things are taken to be symmetric about an upright plane that more or less faces the cameras (Bohg et al., *Mind
    /// the Gap: Robotic Grasping under Incomplete Observation*, 2011).
    /// In each of some directions the farthest plane is tried of whose mirror image no camera should have seen more
    /// than `1 - hidden_share`; the one is taken whose image falls most on what was seen.
    pub(super) fn complete(&self, points: &[DVec3], hidden_share: f64) -> Vec<Seen> {
        let sample: Vec<DVec3> = points.iter().copied().step_by((points.len() / 150).max(1)).collect();
        let allowed = ((1.0 - hidden_share) * sample.len() as f64) as usize;
        let best = self.facing(points).into_iter().filter_map(|normal| {
            let plane = |step: i32| Mirror { normal, middle: self.middle - normal * (f64::from(step) * OFFSET_M) };
            let matching = |step: i32| self.matching(&sample, &plane(step), allowed).map(|count| (count, step));
            // A step nearer, since what was seen covers a little more than its points.
            OFFSETS.rev().find_map(matching).map(|(count, step)| (count as f64 / sample.len() as f64, plane(step - 1)))
        });
        // The first direction, to the cameras, unless another fits clearly better.
        let better = |best: (f64, Mirror), next: (f64, Mirror)| if next.0 > best.0 + CLEARLY { next } else { best };
        let Some((_, mirror)) = best.reduce(better) else { return Vec::new() };
        let images = points.iter().map(|&point| mirror.image(point)).filter(|&point| self.before(point) > HIDDEN_M);
        images.map(|point| Seen { point, guessed: true }).collect()
    }

    /// How many images of points fall on what was seen; `None` when a camera should have seen more than `allowed`.
    fn matching(&self, points: &[DVec3], mirror: &Mirror, allowed: usize) -> Option<usize> {
        let (mut seen, mut matching) = (0, 0);
        for &point in points {
            let before = self.before(mirror.image(point));
            seen += usize::from(before <= 0.0);
            if seen > allowed {
                return None;
            }
            matching += usize::from(before > 0.0 && before <= MATCH_M);
        }
        Some(matching)
    }

    /// Level directions to the cameras, about there, and along the target's axes as far as they face the cameras.
    fn facing(&self, points: &[DVec3]) -> Vec<DVec3> {
        let eye = self.views.iter().map(|view| view.eye).sum::<DVec3>() / self.views.len() as f64;
        let Some(towards) = DVec3::new(eye.x - self.middle.x, eye.y - self.middle.y, 0.0).try_normalize() else {
            return Vec::new();
        };
        let long = long_axis(points.iter().copied(), self.middle);
        let axes = [long, -long, DVec3::new(-long.y, long.x, 0.0), DVec3::new(long.y, -long.x, 0.0)];
        let turned =
            [0.0, 0.15, -0.15, 0.3, -0.3, 0.45, -0.45, 0.6, -0.6].map(|angle| DQuat::from_rotation_z(angle) * towards);
        turned.into_iter().chain(axes.into_iter().filter(|axis| axis.dot(towards) > 0.5)).collect()
    }

    /// How far the nearest thing that was seen is before a point, m, for the camera that has the freest view.
    fn before(&self, point: DVec3) -> f64 {
        let before = self.views.iter().map(|view| view.before(point).into_iter().fold(f64::NEG_INFINITY, f64::max));
        before.fold(f64::INFINITY, f64::min)
    }
}

/// An upright plane.
struct Mirror {
    normal: DVec3,
    middle: DVec3,
}

impl Mirror {
    fn image(&self, point: DVec3) -> DVec3 {
        point - self.normal * (2.0 * (point - self.middle).dot(self.normal))
    }
}

/// Distances of planes from the middle of the points, in steps of so many metres.
const OFFSETS: std::ops::RangeInclusive<i32> = -6..=15;
const OFFSET_M: f64 = 0.003;
/// An image falls on what was seen when it is at most so far behind, m.
const MATCH_M: f64 = 0.005;
/// An image so far behind what was seen is new, m; the others would only cost time.
const HIDDEN_M: f64 = 0.003;
/// A share of points that fall on what was seen is clearly larger from this difference on.
const CLEARLY: f64 = 0.05;

/// A point is behind or below a surface from this distance on, m: noise and thin walls do not count.
const BEHIND_M: f64 = 0.004;
const BELOW_M: f64 = 0.006;

/// How near a camera sees something, by direction.
#[derive(Debug)]
struct View {
    eye: DVec3,
    axes: [DVec3; 3],
    distance: f64,
    /// Along the camera's axis, of target and others, m.
    nearest: Vec<[f32; 2]>,
}

/// Cells of a view per side, and their size at the target, m.
const CELLS: usize = 160;
const CELL_M: f64 = 0.003;

impl View {
    fn new(eye: DVec3, middle: DVec3, target: &[DVec3], scene: &[DVec3]) -> Self {
        let forward = (middle - eye).normalize_or(DVec3::NEG_Z);
        let right = forward.any_orthonormal_vector();
        let mut view = Self {
            eye,
            axes: [right, forward.cross(right), forward],
            distance: middle.distance(eye),
            nearest: vec![[f32::INFINITY; 2]; CELLS * CELLS],
        };
        for (layer, points) in [target, scene].into_iter().enumerate() {
            for &point in points {
                let Some((column, row, range)) = view.cell(point) else { continue };
                // Points are some cells apart: each covers its neighbours.
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
        let offset = point - self.eye;
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

    /// How far target and others are before a point, m; below 0 when they are behind it or beside.
    fn before(&self, point: DVec3) -> [f64; 2] {
        let Some((column, row, range)) = self.cell(point) else { return [f64::NEG_INFINITY; 2] };
        self.nearest[row * CELLS + column].map(|nearest| range - f64::from(nearest))
    }
}

/// Highest seen point over each cell of the table around the target.
#[derive(Debug, Default)]
struct Tops {
    corner: DVec3,
    highest: Vec<f32>,
}

/// Cells of the table per side, and their size, m.
const TOPS: usize = 80;
const TOP_M: f64 = 0.005;

impl Tops {
    fn new(middle: DVec3, target: &[DVec3], scene: &[DVec3]) -> Self {
        let half = TOPS as f64 * TOP_M / 2.0;
        let mut tops =
            Self { corner: middle - DVec3::new(half, half, 0.0), highest: vec![f32::NEG_INFINITY; TOPS * TOPS] };
        tops.add(target.iter().chain(scene).copied());
        tops
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
            let cell = value / TOP_M;
            (0.0..TOPS as f64).contains(&cell).then_some(cell as usize)
        };
        Some(place(point.y - self.corner.y)? * TOPS + place(point.x - self.corner.x)?)
    }

    /// How far below the highest seen point a point lies, m.
    fn above(&self, point: DVec3) -> f64 {
        self.cell(point).map_or(f64::NEG_INFINITY, |cell| f64::from(self.highest[cell]) - point.z)
    }
}
