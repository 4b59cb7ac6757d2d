//! Merges neighbouring regions into objects, most probable pair first.

use std::collections::BTreeMap;

use glam::Vec3;

use super::cloud::OrganizedCloud;
use super::regions::{NONE, chroma, normal_angle};

/// Accumulated statistics of a region.
#[derive(Clone, Debug, Default)]
struct Region {
    pixels: f32,
    color: Vec3,
    lowest: f32,
    highest: f32,
    /// Perimeter: number of pixel edges to other pixels.
    perimeter: f32,
    /// Number of pixel edges to the support.
    support_edges: f32,
    /// Sum of the angles between normals [`BEND_PX`] apart (rad), and their number; negative for concave regions.
    bend_rad: f32,
    bends: f32,
}

/// Accumulated statistics of the pixel edges between two regions; the first region has the smaller index.
#[derive(Clone, Debug, Default)]
struct Border {
    edges: f32,
    /// Number of edges with a depth discontinuity, and the sum of the discontinuities (m).
    steps: f32,
    step_m: f32,
    /// Number of concave and convex edges without a discontinuity, and the sum of the concave angles (rad).
    concave: f32,
    /// Number of concave edges with two steep sides.
    steep: f32,
    convex: f32,
    concave_rad: f32,
    /// Number of edges at which the first region occludes the second or rises above it at a concave edge; then vice
    /// versa.
    first_in_front: f32,
    second_in_front: f32,
    color: Vec3,
}

/// Number of features of a pair of regions.
pub const COUNT: usize = 24;

/// Features of a pair of neighbouring regions, in the order of [`FEATURES`].
pub type Features = [f64; COUNT];

/// Names of the features.
///
/// Shares refer to the border. `out` is the share of a region's perimeter at which it occludes or rises above the
/// other, `pit` the share at which the other does, each for the region with the larger share.
pub const FEATURES: [&str; COUNT] = [
    "one",
    "steps",
    "step",
    "concave",
    "concave_angle",
    "upright",
    "convex",
    "brightness",
    "hue",
    "hue_at_steps",
    "hue_at_concave",
    "hue_at_convex",
    "border_hue",
    "out",
    "pit",
    "out_at_steps",
    "pit_at_steps",
    "share",
    "size",
    "tops",
    "hollow",
    "floating",
    "both_stand",
    "border_size",
];

/// Weights of the logistic regression for the merge probability, fitted with `genmanip-lab segment --seed 101 --count
/// 60 --fit`.
const WEIGHTS: Features = [
    5.19, 0.52, -1.79, 4.33, -3.29, 1.58, -0.21, 0.76, -0.6, -1.39, -1.5, 0.0, -0.22, -9.99, 1.13, -3.99, -0.08, 4.28,
    -0.22, -2.1, -0.58, 4.18, 1.47, 0.37,
];

/// Region adjacency graph with statistics of regions and borders.
#[derive(Clone, Debug)]
pub struct Graph {
    regions: Vec<Region>,
    /// For each region, its neighbours with a larger index.
    borders: Vec<BTreeMap<u32, Border>>,
}

impl Graph {
    pub(super) fn new(
        cloud: &OrganizedCloud,
        colors: &[Vec3],
        heights: &[f32],
        is_support: &[bool],
        labels: &[u32],
        count: usize,
    ) -> Self {
        let mut regions =
            vec![Region { lowest: f32::INFINITY, highest: f32::NEG_INFINITY, ..Region::default() }; count];
        let mut borders = vec![BTreeMap::<u32, Border>::new(); count];
        let (width, pixels) = (cloud.width, labels.len());
        for index in 0..pixels {
            let label = labels[index];
            if label != NONE {
                let region = &mut regions[label as usize];
                region.pixels += 1.0;
                region.color += colors[index];
                region.lowest = region.lowest.min(heights[index]);
                region.highest = region.highest.max(heights[index]);
                for apart in [BEND_PX, BEND_PX * width] {
                    if labels.get(index + apart) == Some(&label) {
                        region.bend_rad += normal_angle(cloud, index, index + apart);
                        region.bends += 1.0;
                    }
                }
            }
            let right = (index % width + 1 < width).then_some(index + 1);
            let below = (index + width < pixels).then_some(index + width);
            for other in [right, below].into_iter().flatten() {
                let neighbour = labels[other];
                if label == neighbour {
                    continue;
                }
                for (own, beyond) in [(label, other), (neighbour, index)] {
                    if own != NONE {
                        let region = &mut regions[own as usize];
                        region.perimeter += 1.0;
                        region.support_edges += f32::from(u8::from(is_support[beyond]));
                    }
                }
                if label == NONE || neighbour == NONE {
                    continue;
                }
                let step = other - index;
                let (before, after) = (inner(labels, index, step, false), inner(labels, other, step, true));
                let (mut pixels, mut inside) = ([index, other], [before, after]);
                let (low, high) = (label.min(neighbour), label.max(neighbour));
                if label > neighbour {
                    pixels.reverse();
                    inside.reverse();
                }
                borders[low as usize].entry(high).or_default().add(cloud, colors, heights, pixels, inside);
            }
        }
        Self { regions, borders }
    }

    /// Merges pairs by descending probability while it is at least `min`; returns the index of each region's group.
    pub fn merge(mut self, merge_probability: impl Fn(&Features) -> f64, min: f64) -> Vec<u32> {
        let count = self.regions.len();
        let mut group: Vec<u32> = (0..count as u32).collect();
        let mut probabilities: Vec<BTreeMap<u32, f64>> = (0..count)
            .map(|low| {
                self.borders[low]
                    .keys()
                    .map(|&high| (high, merge_probability(&self.features(low as u32, high))))
                    .collect()
            })
            .collect();
        loop {
            let pairs = probabilities
                .iter()
                .enumerate()
                .flat_map(|(low, row)| row.iter().map(move |(high, p)| (*p, low, *high)));
            let best = pairs.fold((min, usize::MAX, 0), |best, pair| if pair.0 > best.0 { pair } else { best });
            if best.1 == usize::MAX {
                break;
            }
            let (low, high) = (best.1 as u32, best.2);
            self.join(low, high);
            for member in group.iter_mut().filter(|member| **member == high) {
                *member = low;
            }
            probabilities[high as usize].clear();
            for row in &mut probabilities[..high as usize] {
                row.remove(&high);
            }
            for &(one, other) in &self.pairs_of(low) {
                let features = self.features(one, other);
                probabilities[one as usize].insert(other, merge_probability(&features));
            }
        }
        group
    }

    /// All pairs of neighbouring regions.
    pub fn pairs(&self) -> Vec<(u32, u32)> {
        let row = |(low, row): (usize, &BTreeMap<u32, Border>)| {
            row.keys().map(|high| (low as u32, *high)).collect::<Vec<_>>()
        };
        self.borders.iter().enumerate().flat_map(row).collect()
    }

    /// Pairs of a region with its neighbours.
    pub fn pairs_of(&self, region: u32) -> Vec<(u32, u32)> {
        let below = (0..region).filter(|low| self.borders[*low as usize].contains_key(&region));
        let above = self.borders[region as usize].keys().map(|high| (region, *high));
        below.map(|low| (low, region)).chain(above).collect()
    }

    /// Merges the second region into the first, which has the smaller index.
    pub fn join(&mut self, low: u32, high: u32) {
        let lost = std::mem::take(&mut self.regions[high as usize]);
        let between = self.borders[low as usize].remove(&high).unwrap_or_default();
        let kept = &mut self.regions[low as usize];
        kept.pixels += lost.pixels;
        kept.color += lost.color;
        kept.lowest = kept.lowest.min(lost.lowest);
        kept.highest = kept.highest.max(lost.highest);
        kept.perimeter += lost.perimeter - 2.0 * between.edges;
        kept.support_edges += lost.support_edges;
        kept.bend_rad += lost.bend_rad;
        kept.bends += lost.bends;
        let mut moved: Vec<(u32, Border)> = Vec::new();
        for other in 0..high {
            if let Some(border) = self.borders[other as usize].remove(&high) {
                moved.push((other, border.swapped()));
            }
        }
        moved.extend(std::mem::take(&mut self.borders[high as usize]));
        // Here the first side of each border is the removed region.
        for (other, border) in moved.into_iter().filter(|(other, _)| *other != low) {
            if low < other {
                self.borders[low as usize].entry(other).or_default().join(&border);
            } else {
                self.borders[other as usize].entry(low).or_default().join(&border.swapped());
            }
        }
    }

    /// Features of two neighbouring regions.
    pub fn features(&self, low: u32, high: u32) -> Features {
        let (one, other) = (&self.regions[low as usize], &self.regions[high as usize]);
        let Some(border) = self.borders[low as usize].get(&high) else { return [0.0; COUNT] };
        let edges = border.edges.max(1.0);
        let color = (one.color / one.pixels - other.color / other.pixels).abs();
        let hue = (chroma(color) / 0.1).min(3.0);
        let along = border.color / edges;
        let (steps, concave, convex) = (border.steps / edges, border.concave / edges, border.convex / edges);
        // See [`FEATURES`] for `out` and `pit`.
        let out =
            (border.first_in_front / one.perimeter.max(1.0)).max(border.second_in_front / other.perimeter.max(1.0));
        let pit =
            (border.second_in_front / one.perimeter.max(1.0)).max(border.first_in_front / other.perimeter.max(1.0));
        let hollow = |region: &Region| (region.bend_rad / region.bends.max(1.0)).clamp(-0.3, 0.3) * 10.0;
        let far = if border.first_in_front >= border.second_in_front { other } else { one };
        let smaller = one.pixels.min(other.pixels);
        let tops = ((one.highest - other.highest).abs() / 0.02).min(2.0);
        let stands = |region: &Region| (4.0 * region.support_edges / region.perimeter.max(1.0)).min(1.0);
        let share = (edges / one.perimeter.max(1.0)).max(edges / other.perimeter.max(1.0));
        [
            1.0,
            steps,
            (border.step_m / edges / 0.02).min(2.0),
            concave,
            border.concave_rad / edges,
            border.steep / edges,
            convex,
            (color.x / 0.1).min(3.0),
            hue,
            hue * steps,
            hue * concave,
            hue * convex,
            chroma(along) / 0.1,
            out * (1.0 - steps),
            pit * (1.0 - steps),
            out * steps,
            pit * steps,
            share,
            (smaller / 50.0).ln().clamp(-2.0, 4.0),
            tops * steps,
            -hollow(far).min(0.0) * (steps + concave),
            (1.0 - stands(far)) * steps,
            stands(one).min(stands(other)) * (steps + concave),
            (edges / 20.0).ln().clamp(-3.0, 2.0) * (steps + concave),
        ]
        .map(f64::from)
    }

    /// Number of regions before merging.
    pub fn count(&self) -> usize {
        self.regions.len()
    }

    /// Area of a region (px).
    pub fn pixels(&self, region: u32) -> f64 {
        f64::from(self.regions[region as usize].pixels)
    }
}

/// Pixel up to `BEND_PX - 1` farther inside a region along an axis.
fn inner(labels: &[u32], index: usize, step: usize, ahead: bool) -> usize {
    let next = |at: usize| if ahead { Some(at + step) } else { at.checked_sub(step) };
    let mut at = index;
    for _ in 1..BEND_PX {
        match next(at).filter(|next| labels.get(*next) == Some(&labels[index])) {
            Some(next) => at = next,
            None => break,
        }
    }
    at
}

/// Probability that two neighbouring regions belong to one object.
pub fn merge_probability(features: &Features) -> f64 {
    1.0 / (1.0 + (-WEIGHTS.iter().zip(features).map(|(weight, feature)| weight * feature).sum::<f64>()).exp())
}

/// Minimum depth discontinuity as a multiple of the distance of neighbouring points.
const STEP_FOOTPRINTS: f32 = 1.5;
/// Minimum angle between normals at a concave or convex edge (rad).
const MIN_BEND_RAD: f32 = 0.26;
/// Distance over which angles between normals are measured (px).
const BEND_PX: usize = 3;
/// Maximum vertical component of the normal of a steep surface.
const MAX_STEEP_NORMAL_Z: f32 = 0.35;

impl Border {
    /// Adds one pixel edge. `pixels` are adjacent to the border, `inside` lie farther from it, where normals are
    /// undisturbed.
    fn add(
        &mut self,
        cloud: &OrganizedCloud,
        colors: &[Vec3],
        heights: &[f32],
        pixels: [usize; 2],
        inside: [usize; 2],
    ) {
        let [first, second] = inside;
        self.edges += 1.0;
        self.color += (colors[first] - colors[second]).abs();
        let [a, b] = pixels.map(|pixel| cloud.points[pixel]);
        let [normal_a, normal_b] = inside.map(|pixel| cloud.normals[pixel]);
        let step = (b - a).dot(normal_a).abs().min((b - a).dot(normal_b).abs());
        let min = (STEP_FOOTPRINTS * cloud.footprint_m(a)).max(4.0 * cloud.depth_noise_m(a));
        if step > min {
            self.steps += 1.0;
            self.step_m += step.min(0.1);
            if a.distance_squared(cloud.camera) < b.distance_squared(cloud.camera) {
                self.first_in_front += 1.0;
            } else {
                self.second_in_front += 1.0;
            }
            return;
        }
        let bend = normal_angle(cloud, first, second);
        if bend < -MIN_BEND_RAD {
            self.concave += 1.0;
            self.concave_rad -= bend;
            self.steep += f32::from(u8::from(normal_a.z.abs().max(normal_b.z.abs()) < MAX_STEEP_NORMAL_Z));
            if heights[first] > heights[second] {
                self.first_in_front += 1.0;
            } else {
                self.second_in_front += 1.0;
            }
        } else if bend > MIN_BEND_RAD {
            self.convex += 1.0;
        }
    }

    fn join(&mut self, other: &Self) {
        self.edges += other.edges;
        self.steps += other.steps;
        self.step_m += other.step_m;
        self.concave += other.concave;
        self.steep += other.steep;
        self.convex += other.convex;
        self.concave_rad += other.concave_rad;
        self.first_in_front += other.first_in_front;
        self.second_in_front += other.second_in_front;
        self.color += other.color;
    }

    /// The same border with its two sides swapped.
    fn swapped(self) -> Self {
        Self { first_in_front: self.second_in_front, second_in_front: self.first_in_front, ..self }
    }
}
