//! Grasp search for one approach and one roll: height profiles over strips, and pad positions on them.

use genmanip_core::{Grasp, Pose};
use glam::DVec3;

use super::filter::Cloud;
use super::points::Local;
use super::score::{Contacts, Features};
use super::{CloudGrasp, CloudSettings, Gripper, tcp_pose};

/// Cell size along the closing direction ([`CELL`]) and across it ([`ROW`], m).
const CELL: f64 = 0.002;
const ROW: f64 = 0.003;
/// Distance between strips (rows).
const STRIDE: usize = 2;
/// Distance of a pad's centre from the contact (m), outwards along the closing direction.
const PAD_MIDDLE_M: f64 = 0.005;
/// Minimum height of the target above the fingertips for a grasp (m).
const MIN_GRASP_HEIGHT_M: f64 = 0.0015;

/// Height field of target and of all points: minimum coordinate along the approach per cell, infinite without points.
struct HeightField {
    columns: usize,
    target: Vec<f32>,
    all: Vec<f32>,
}

/// Points grouped by strip, sorted along the closing direction.
struct Strips {
    points: Vec<Local>,
    /// Start index of each strip in `points`, and the length of `points` at the end.
    starts: Vec<usize>,
}

/// Adds all candidates with this approach and closing direction.
pub(super) fn search(
    cloud: &Cloud,
    gripper: &Gripper,
    settings: &CloudSettings,
    approach: DVec3,
    closing: DVec3,
    found: &mut Vec<CloudGrasp>,
) {
    let across = closing.cross(approach);
    let local = |point: DVec3, guessed: bool| Local {
        c: point.dot(closing) as f32,
        h: point.dot(across) as f32,
        a: point.dot(approach) as f32,
        guessed: f32::from(u8::from(guessed)),
    };
    let points = sorted(cloud.target.iter().map(|seen| local(seen.point, seen.guessed)).collect());
    let (c_low, c_high) = points.first().zip(points.last()).map_or((0.0, 0.0), |(low, high)| (low.c, high.c));
    let (h_low, h_high) =
        points.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), p| (low.min(p.h), high.max(p.h)));
    let [c_low, c_high, h_low, h_high] = [c_low, c_high, h_low, h_high].map(f64::from);
    // Space for an open finger on either side.
    let margin = gripper.max_width / 2.0 + finger_thickness(gripper);
    let (c_low, h_margin) = (c_low - margin, gripper.pad_size.y / 2.0 + 0.003);
    let columns = ((c_high + margin - c_low) / CELL).ceil() as usize + 1;
    let h_low = h_low - h_margin;
    let rows = ((h_high + h_margin - h_low) / ROW).ceil() as usize + 1;
    let cell = |point: &Local| {
        let (column, row) = ((f64::from(point.c) - c_low) * (1.0 / CELL), (f64::from(point.h) - h_low) * (1.0 / ROW));
        let inside = column >= 0.0 && row >= 0.0 && column < columns as f64 && row < rows as f64;
        inside.then_some(row as i32 as usize * columns + column as i32 as usize)
    };
    let mut target = vec![f32::INFINITY; rows * columns];
    for point in &points {
        if let Some(cell) = cell(point) {
            target[cell] = target[cell].min(point.a);
        }
    }
    let mut all = target.clone();
    for point in cloud.scene.iter().map(|point| local(*point, false)) {
        if let Some(cell) = cell(&point) {
            all[cell] = all[cell].min(point.a);
        }
    }
    let heights = HeightField { columns, target, all };
    let half = (h_margin / ROW).round() as usize;
    let middles: Vec<usize> = (half..rows.saturating_sub(half)).step_by(STRIDE).collect();
    let middle_of = |row: usize| h_low + (row as f64 + 0.5) * ROW;
    let strips = Strips::new(&points, middle_of(half), middles.len(), gripper.pad_size.y / 2.0);
    let frame = Frame { cloud, gripper, settings, approach, closing, across, c_low };
    let mut buffer = vec![Local::default(); points.len() + 1];
    for (strip, &row) in strips.iter().zip(&middles).filter(|(strip, _)| strip.len() >= 4) {
        let rows = row - half..row + half + 1;
        let (target, all) = (heights.lowest(&heights.target, rows.clone()), heights.lowest(&heights.all, rows));
        frame.strip(middle_of(row), strip, &target, &all, &mut buffer, found);
    }
}

/// Sorts points by `c` to 0.1 µm; integer keys sort faster.
fn sorted(points: Vec<Local>) -> Vec<Local> {
    let low = points.iter().map(|point| point.c).fold(f32::INFINITY, f32::min);
    let key = |(index, point): (usize, &Local)| ((f64::from(point.c - low) * 1e7) as u64) << 32 | index as u64;
    let mut order: Vec<u64> = points.iter().enumerate().map(key).collect();
    order.sort_unstable();
    order.into_iter().map(|key| points[key as u32 as usize]).collect()
}

impl Strips {
    /// Distributes sorted points to `count` overlapping strips with centres from `first` on and half width
    /// `half_width`.
    fn new(points: &[Local], first: f64, count: usize, half_width: f64) -> Self {
        let step = STRIDE as f64 * ROW;
        let per_strip = 1.0 / step;
        let strips_of = |point: &Local| {
            // Casts truncate towards 0; rounding and unsigned casts would take a tenth of the sampler's time.
            let begun = |h: f64| if h < 0.0 { 0 } else { h as i32 as usize + 1 };
            let h = f64::from(point.h) - first;
            begun((h - half_width) * per_strip)..begun((h + half_width) * per_strip).min(count)
        };
        let mut starts = vec![0; count + 1];
        for strip in points.iter().flat_map(strips_of) {
            starts[strip + 1] += 1;
        }
        for strip in 0..count {
            starts[strip + 1] += starts[strip];
        }
        let mut next = starts.clone();
        let mut distributed = vec![Local::default(); starts[count]];
        for point in points {
            for strip in strips_of(point) {
                distributed[next[strip]] = *point;
                next[strip] += 1;
            }
        }
        Self { points: distributed, starts }
    }

    fn iter(&self) -> impl Iterator<Item = &[Local]> {
        self.starts.windows(2).map(|ends| &self.points[ends[0]..ends[1]])
    }
}

impl HeightField {
    fn lowest(&self, field: &[f32], rows: std::ops::Range<usize>) -> Vec<f32> {
        let mut lowest = vec![f32::INFINITY; self.columns];
        for row in rows {
            let row = &field[row * self.columns..(row + 1) * self.columns];
            for (lowest, value) in lowest.iter_mut().zip(row) {
                *lowest = lowest.min(*value);
            }
        }
        lowest
    }
}

struct Frame<'a> {
    cloud: &'a Cloud,
    gripper: &'a Gripper,
    settings: &'a CloudSettings,
    approach: DVec3,
    closing: DVec3,
    across: DVec3,
    c_low: f64,
}

impl Frame<'_> {
    /// Finds candidates in one strip of sorted points: `target` and `all` are the height profiles, `buffer` has space
    /// for all points.
    fn strip(
        &self,
        h: f64,
        points: &[Local],
        target: &[f32],
        all: &[f32],
        buffer: &mut [Local],
        found: &mut Vec<CloudGrasp>,
    ) {
        let top = f64::from(target.iter().copied().fold(f32::INFINITY, f32::min));
        let table = self.max_depth(h);
        let mut levels: Vec<f64> = self.settings.depths.iter().map(|depth| top + depth).collect();
        // Down to the table unless the palm collides first.
        levels.push(table);
        levels.retain(|&tip| {
            tip <= table && tip > top + MIN_GRASP_HEIGHT_M && tip < top + self.gripper.palm + self.gripper.tip
        });
        levels.sort_by(f64::total_cmp);
        levels.dedup_by(|a, b| *a - *b < 0.003);
        // Both pads and some clearance must fit between two parts for them to be grasped separately.
        let slot = ((self.gripper.pad_size.x + 0.002) / CELL).ceil() as usize;
        for tip in levels {
            let runs = runs(target, tip - MIN_GRASP_HEIGHT_M, slot);
            if runs.is_empty() {
                continue;
            }
            let between = self.points_between(tip, points, buffer);
            for first in 0..runs.len() {
                for last in first..runs.len() {
                    let (from, to) = (runs[first].0, runs[last].1);
                    if (to - from) as f64 * CELL > self.gripper.max_width {
                        break;
                    }
                    let column = |index: f64| (self.c_low + index * CELL) as f32;
                    let from = between.partition_point(|point| point.c < column(from as f64 - 1.0));
                    let to = between.partition_point(|point| point.c <= column(to as f64 + 1.0));
                    found.extend(self.close(h, tip, &between[from..to], all));
                }
            }
        }
    }

    /// Points of a strip within the pads' length.
    fn points_between<'a>(&self, tip: f64, points: &[Local], buffer: &'a mut [Local]) -> &'a [Local] {
        let (above, below) = ((tip - self.gripper.pad_size.z) as f32, tip as f32);
        let mut count = 0;
        for point in points {
            buffer[count] = *point;
            // Branchless, since the branch is unpredictable.
            count += usize::from(point.a > above) & usize::from(point.a < below);
        }
        &buffer[..count]
    }

    /// Maximum depth of the fingertips at a strip, along the approach (m): where they meet the table.
    fn max_depth(&self, h: f64) -> f64 {
        let tilt_height = self.across.z.abs() * self.gripper.pad_size.y / 2.0
            + self.closing.z.abs() * (self.gripper.max_width / 2.0 + finger_thickness(self.gripper));
        let height = self.cloud.table_height + self.settings.table_clearance + tilt_height;
        // z = c·closing.z + h·across.z + a·approach.z, with a horizontal closing direction.
        (height - h * self.across.z) / self.approach.z
    }

    /// Candidate from closing the pads on points between them; `None` without space for the open fingers beside these
    /// points.
    fn close(&self, h: f64, tip: f64, between: &[Local], all: &[f32]) -> Option<CloudGrasp> {
        let (gripper, settings) = (self.gripper, self.settings);
        let (low, high) = extremes(between)?;
        let width = high - low;
        if !(0.0..=gripper.max_width - settings.width_clearance).contains(&width) {
            return None;
        }
        let c = (high + low) / 2.0;
        let opening_for = |clearance: f64| (width + 2.0 * clearance).min(gripper.max_width);
        let &clearance = settings
            .opening_clearances
            .iter()
            .find(|&&clearance| self.has_clearance(c, tip, opening_for(clearance), all))?;
        let opening = opening_for(clearance);
        if self.enters_solid([low, high], h, tip) {
            return None;
        }
        let contacts = Contacts::of(between, [low, high], h, tip);
        let position = self.closing * c + self.across * h + self.approach * (tip - gripper.tip);
        let unseen = self.hidden_share([low, high], opening, h, tip);
        let features = Features {
            unseen,
            ..Features::new(self.cloud, gripper, &contacts, position, self.approach, self.closing, clearance)
        };
        let score = settings.weights.chance(&features);
        let pose = tcp_pose(position, self.approach, self.closing);
        Some(CloudGrasp { grasp: Grasp { pose, width, score }, opening, features })
    }

    /// True if a pad that approaches from the side would enter the unobserved inside of a solid, such as a box behind
    /// its observed end. An approach from above needs no such check, since the observed top blocks it.
    fn enters_solid(&self, ends: [f64; 2], h: f64, tip: f64) -> bool {
        let half_pad = self.gripper.pad_size.y / 2.0;
        self.approach.z > -0.99
            && [ends[0] - PAD_MIDDLE_M, ends[1] + PAD_MIDDLE_M].into_iter().any(|c| {
                [-0.6, 0.0, 0.6].into_iter().any(|share| {
                    let inside = |a: f64| self.cloud.occlusion.is_inside(self.world(c, h + share * half_pad, a));
                    inside(tip - 0.003) || inside(tip - self.gripper.pad_size.z / 2.0)
                })
            })
    }

    /// Share of the space swept by the pads, from the contacts outward, that other objects occlude: the target may
    /// extend there.
    fn hidden_share(&self, [low, high]: [f64; 2], opening: f64, h: f64, tip: f64) -> f64 {
        let pad = self.gripper.pad_size;
        let outer = (opening - (high - low)) / 2.0 + pad.x / 2.0;
        let mut hidden = 0;
        for c in [low - PAD_MIDDLE_M, low - outer, high + PAD_MIDDLE_M, high + outer] {
            for h in [h - 0.3 * pad.y, h + 0.3 * pad.y] {
                for a in [tip - 0.002, tip - 0.6 * pad.z] {
                    hidden += usize::from(self.cloud.occlusion.is_behind_others(self.world(c, h, a)));
                }
            }
        }
        hidden as f64 / 16.0
    }

    fn world(&self, c: f64, h: f64, a: f64) -> DVec3 {
        self.closing * c + self.across * h + self.approach * a
    }

    /// True if open pads and fingers, centred at `middle`, collide with nothing.
    fn has_clearance(&self, middle: f64, tip: f64, opening: f64, all: &[f32]) -> bool {
        let (pad, inner) = (self.gripper.pad_size, opening / 2.0);
        let outer = inner + finger_thickness(self.gripper);
        let is_free = |from: f64, to: f64, level: f64| {
            let column = |c: f64| ((c - self.c_low) / CELL).max(0.0) as usize;
            let cells = all.get(column(from)..=column(to).min(all.len() - 1));
            cells.is_some_and(|cells| cells.iter().all(|&nearest| f64::from(nearest) >= level))
        };
        let body = tip - pad.z;
        // One cell of slack, since the contact lies in it.
        is_free(middle - inner - pad.x, middle - inner - CELL, tip)
            && is_free(middle + inner + CELL, middle + inner + pad.x, tip)
            && is_free(middle - outer, middle - inner - pad.x, body)
            && is_free(middle + inner + pad.x, middle + outer, body)
    }
}

/// Contact positions of pads on points between them, which are sorted along the closing direction; `None` if there are
/// too few.
fn extremes(between: &[Local]) -> Option<(f64, f64)> {
    // Skip the outermost points as noise.
    let skipped = between.len() / 80;
    (between.len() >= 4).then(|| (f64::from(between[skipped].c), f64::from(between[between.len() - 1 - skipped].c)))
}

/// Column ranges nearer than `level`, with gaps of fewer than `slot` columns closed.
fn runs(nearest: &[f32], level: f64, slot: usize) -> Vec<(usize, usize)> {
    let mut runs: Vec<(usize, usize)> = Vec::new();
    for column in (0..nearest.len()).filter(|&column| f64::from(nearest[column]) < level) {
        match runs.last_mut() {
            Some(last) if column < last.1 + slot => last.1 = column + 1,
            _ => runs.push((column, column + 1)),
        }
    }
    runs
}

/// Extent of a finger outwards from its pad face (m).
fn finger_thickness(gripper: &Gripper) -> f64 {
    gripper.finger_reach
}

/// True if the hand keeps clear of points and table at a TCP pose and along the approach.
///
/// `blocker` caches the last blocking point, which most likely blocks again and is tested first.
pub(super) fn hand_is_clear(
    cloud: &Cloud,
    gripper: &Gripper,
    settings: &CloudSettings,
    pose: &Pose,
    blocker: &mut usize,
) -> bool {
    let clearance = settings.hand_clearance;
    let (low, high) = (gripper.hand_bounds.min - clearance, gripper.hand_bounds.max + clearance);
    let axes = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| pose.transform_vector(axis));
    let blocks = |point: &DVec3| {
        let offset = *point - pose.position;
        let within = |axis: usize| (low[axis]..high[axis]).contains(&offset.dot(axes[axis]));
        // Along the approach, the hand passes every point behind its front face.
        offset.dot(axes[2]) < high.z && within(0) && within(1)
    };
    let tilt_height = |axis: usize| (low[axis] * axes[axis].z).min(high[axis] * axes[axis].z);
    if pose.position.z + tilt_height(0) + tilt_height(1) + tilt_height(2) <= cloud.table_height
        || cloud.coarse.get(*blocker).is_some_and(blocks)
    {
        return false;
    }
    let found = cloud.coarse.iter().position(blocks);
    *blocker = found.unwrap_or(*blocker);
    found.is_none()
}
