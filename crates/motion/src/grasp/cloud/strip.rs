//! One approach and one roll: the points as heights over strips, and where pads fit on them.

use genmanip_core::{Grasp, Pose};
use glam::DVec3;

use super::filter::Cloud;
use super::score::{Contacts, Features};
use super::{CloudGrasp, CloudSettings, Gripper, tcp_pose};

/// Cells along the closing direction and across it, m.
const CELL: f64 = 0.002;
const ROW: f64 = 0.003;
/// Distance between strips that are looked at, in rows.
const STRIDE: usize = 2;
/// The target counts from this far above the tips on, m.
const BITE: f64 = 0.0015;

/// A point in the frame of a hand: along closing, across, along approach.
#[derive(Clone, Copy)]
pub(super) struct Local {
    pub(super) c: f64,
    pub(super) h: f64,
    pub(super) a: f64,
    pub(super) guessed: bool,
}

/// What is nearest to the hand, per cell.
struct Relief {
    columns: usize,
    target: Vec<f64>,
    all: Vec<f64>,
}

/// Adds every candidate with this approach and closing direction.
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
        c: point.dot(closing),
        h: point.dot(across),
        a: point.dot(approach),
        guessed,
    };
    let points: Vec<Local> = cloud.target.iter().map(|seen| local(seen.point, seen.guessed)).collect();
    let range = |value: fn(&Local) -> f64| {
        points.iter().map(value).fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)))
    };
    let ((c_low, c_high), (h_low, h_high)) = (range(|p| p.c), range(|p| p.h));
    // Room for an open finger on either side.
    let margin = gripper.max_width / 2.0 + finger_thickness(gripper);
    let (c_low, h_margin) = (c_low - margin, gripper.pad_size.y / 2.0 + 0.003);
    let columns = ((c_high + margin - c_low) / CELL).ceil() as usize + 1;
    let h_low = h_low - h_margin;
    let rows = ((h_high + h_margin - h_low) / ROW).ceil() as usize + 1;
    let cell = |point: &Local| {
        let (column, row) = ((point.c - c_low) / CELL, (point.h - h_low) / ROW);
        let inside = column >= 0.0 && row >= 0.0 && (column as usize) < columns && (row as usize) < rows;
        inside.then_some((column as usize, row as usize))
    };
    let mut relief =
        Relief { columns, target: vec![f64::INFINITY; rows * columns], all: vec![f64::INFINITY; rows * columns] };
    let mut by_row: Vec<Vec<Local>> = vec![Vec::new(); rows];
    for point in &points {
        if let Some((column, row)) = cell(point) {
            let nearest = &mut relief.target[row * columns + column];
            *nearest = nearest.min(point.a);
            by_row[row].push(*point);
        }
    }
    relief.all.copy_from_slice(&relief.target);
    for point in &cloud.scene {
        if let Some((column, row)) = cell(&local(*point, false)) {
            let nearest = &mut relief.all[row * columns + column];
            *nearest = nearest.min(point.dot(approach));
        }
    }
    let frame = Frame { cloud, gripper, settings, approach, closing, across, c_low };
    let half = (h_margin / ROW).round() as usize;
    for row in (half..rows.saturating_sub(half)).step_by(STRIDE) {
        let rows = row - half..row + half + 1;
        let h = h_low + (row as f64 + 0.5) * ROW;
        let mut strip: Vec<Local> = by_row[rows.clone()]
            .iter()
            .flatten()
            .filter(|point| (point.h - h).abs() <= gripper.pad_size.y / 2.0)
            .copied()
            .collect();
        if strip.len() >= 4 {
            strip.sort_unstable_by(|a, b| a.c.total_cmp(&b.c));
            let (target, all) = (relief.lowest(&relief.target, rows.clone()), relief.lowest(&relief.all, rows));
            frame.strip(h, &strip, &target, &all, found);
        }
    }
}

impl Relief {
    fn lowest(&self, field: &[f64], rows: std::ops::Range<usize>) -> Vec<f64> {
        let mut lowest = vec![f64::INFINITY; self.columns];
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
    /// Candidates in one strip, its points sorted along the closing direction: `target` and `all` hold the nearest point per column.
    fn strip(&self, h: f64, points: &[Local], target: &[f64], all: &[f64], found: &mut Vec<CloudGrasp>) {
        let top = target.iter().copied().fold(f64::INFINITY, f64::min);
        let table = self.deepest(h);
        let mut levels: Vec<f64> = self.settings.depths.iter().map(|depth| top + depth).collect();
        // Down to the table, if the palm does not stop the hand before.
        levels.push(table);
        levels.retain(|&tip| tip <= table && tip > top + BITE && tip < top + self.gripper.palm + self.gripper.tip);
        levels.sort_by(f64::total_cmp);
        levels.dedup_by(|a, b| *a - *b < 0.003);
        // Both pads and a little room must fit between two things for them to be held one by one.
        let slot = ((self.gripper.pad_size.x + 0.002) / CELL).ceil() as usize;
        for tip in levels {
            let runs = runs(target, tip - BITE, slot);
            for first in 0..runs.len() {
                for last in first..runs.len() {
                    let (from, to) = (runs[first].0, runs[last].1);
                    if (to - from) as f64 * CELL > self.gripper.max_width {
                        break;
                    }
                    let range = (self.c_low + (from as f64 - 1.0) * CELL, self.c_low + (to as f64 + 1.0) * CELL);
                    found.extend(self.close(h, tip, range, points, all));
                }
            }
        }
    }

    /// How deep the tips may go at a strip, along the approach.
    fn deepest(&self, h: f64) -> f64 {
        let lean = self.across.z.abs() * self.gripper.pad_size.y / 2.0
            + self.closing.z.abs() * (self.gripper.max_width / 2.0 + finger_thickness(self.gripper));
        let height = self.cloud.table_height + self.settings.table_clearance + lean;
        // z = c·closing.z + h·across.z + a·approach.z, and closing is level.
        (height - h * self.across.z) / self.approach.z
    }

    /// Closes the pads on what lies between two columns, if they find room beside it.
    fn close(&self, h: f64, tip: f64, range: (f64, f64), points: &[Local], all: &[f64]) -> Option<CloudGrasp> {
        let (gripper, settings) = (self.gripper, self.settings);
        let pad = gripper.pad_size;
        let from = points.partition_point(|point| point.c < range.0);
        let to = points.partition_point(|point| point.c <= range.1);
        let between = points[from..to].iter().filter(|point| point.a > tip - pad.z && point.a < tip);
        let contacts = Contacts::of(between, h, tip)?;
        let width = contacts.high.c - contacts.low.c;
        if !(0.0..=gripper.max_width - settings.width_clearance).contains(&width) {
            return None;
        }
        let room = |clearance: f64| {
            let opening = (width + 2.0 * clearance).min(gripper.max_width);
            let middle = (contacts.high.c + contacts.low.c) / 2.0;
            let inner = opening / 2.0;
            let is_free = |from: f64, to: f64, level: f64| {
                let column = |c: f64| ((c - self.c_low) / CELL).floor().max(0.0) as usize;
                let cells = all.get(column(from)..=column(to).min(all.len() - 1));
                cells.is_some_and(|cells| cells.iter().all(|&nearest| nearest >= level))
            };
            let outer = inner + finger_thickness(gripper);
            let body = tip - pad.z;
            // One cell of slack, for what is touched lies in it.
            let free = is_free(middle - inner - pad.x, middle - inner - CELL, tip)
                && is_free(middle + inner + CELL, middle + inner + pad.x, tip)
                && is_free(middle - outer, middle - inner - pad.x, body)
                && is_free(middle + inner + pad.x, middle + outer, body);
            free.then_some((opening, clearance))
        };
        let (opening, clearance) = settings.opening_clearances.iter().find_map(|&clearance| room(clearance))?;
        let c = (contacts.high.c + contacts.low.c) / 2.0;
        let position = self.closing * c + self.across * h + self.approach * (tip - gripper.tip);
        let features = Features::new(self.cloud, gripper, &contacts, position, self.approach, self.closing, clearance);
        let score = settings.weights.chance(&features);
        let pose = tcp_pose(position, self.approach, self.closing);
        Some(CloudGrasp { grasp: Grasp { pose, width, score }, opening, features })
    }
}

/// Stretches of columns nearer than `level`, with gaps of fewer than `slot` columns closed.
fn runs(nearest: &[f64], level: f64, slot: usize) -> Vec<(usize, usize)> {
    let mut runs: Vec<(usize, usize)> = Vec::new();
    for column in (0..nearest.len()).filter(|&column| nearest[column] < level) {
        match runs.last_mut() {
            Some(last) if column < last.1 + slot => last.1 = column + 1,
            _ => runs.push((column, column + 1)),
        }
    }
    runs
}

/// How far a finger reaches outwards from its pad's face, m.
fn finger_thickness(gripper: &Gripper) -> f64 {
    gripper.finger_reach
}

/// Whether the hand's body keeps clear of points and table at a pose of the tcp and all along the way there.
pub(super) fn hand_is_clear(cloud: &Cloud, gripper: &Gripper, settings: &CloudSettings, pose: &Pose) -> bool {
    let clearance = settings.hand_clearance;
    let (low, high) = (gripper.hand_bounds.min - clearance, gripper.hand_bounds.max + clearance);
    let axes = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| pose.transform_vector(axis));
    let blocks = |point: &DVec3| {
        let offset = *point - pose.position;
        let within = |axis: usize| (low[axis]..high[axis]).contains(&offset.dot(axes[axis]));
        // What is behind the hand's body now was in front of it on the way.
        offset.dot(axes[2]) < high.z && within(0) && within(1)
    };
    let lean = |axis: usize| (low[axis] * axes[axis].z).min(high[axis] * axes[axis].z);
    pose.position.z + lean(0) + lean(1) + lean(2) > cloud.table_height && !cloud.coarse.iter().any(blocks)
}
