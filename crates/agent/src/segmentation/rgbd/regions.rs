//! Oversegmentation into small regions of one surface and one colour.
//!
//! After Felzenszwalb and Huttenlocher, "Efficient graph-based image segmentation", IJCV 2004: neighbouring pixels are
//! merged by ascending dissimilarity while it exceeds the internal variation of either region by little.

use glam::Vec3;

use super::cloud::OrganizedCloud;

/// Scales of the dissimilarity of pixels, and sizes of regions.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct RegionSettings {
    /// Distance from the tangent plane with dissimilarity 1 (m).
    pub step_m: f32,
    /// Distance from the tangent plane with dissimilarity 1, in standard deviations of the depth; the larger of both
    /// distances counts.
    pub step_sigmas: f32,
    /// Concave angle with dissimilarity 1 (rad).
    pub concave_rad: f32,
    /// Convex angle with dissimilarity 1 (rad).
    pub convex_rad: f32,
    /// Brightness difference with dissimilarity 1.
    pub brightness: f32,
    /// Chroma difference with dissimilarity 1.
    pub hue: f32,
    /// Scale parameter `k` of the paper: larger values give larger regions.
    pub scale: f32,
    /// Regions with fewer pixels are merged into their most similar neighbour.
    pub min_px: u32,
}

impl Default for RegionSettings {
    fn default() -> Self {
        Self {
            step_m: 0.004,
            step_sigmas: 4.0,
            concave_rad: 0.4,
            convex_rad: 0.9,
            brightness: 0.16,
            hue: 0.10,
            scale: 8.0,
            min_px: 12,
        }
    }
}

/// Label of pixels without a region.
pub(super) const NONE: u32 = u32::MAX;

/// Region of each pixel, numbered from 0 in the order of their first pixels, and the number of regions.
pub(super) fn regions(
    cloud: &OrganizedCloud,
    colors: &[Vec3],
    is_foreground: &[bool],
    settings: &RegionSettings,
) -> (Vec<u32>, usize) {
    let (width, count) = (cloud.width, cloud.points.len());
    let mut edges: Vec<(f32, u32, u32)> = Vec::new();
    for index in (0..count).filter(|index| is_foreground[*index]) {
        let right = (index % width + 1 < width).then_some(index + 1);
        let below = (index + width < count).then_some(index + width);
        for other in [right, below].into_iter().flatten().filter(|other| is_foreground[*other]) {
            edges.push((dissimilarity(cloud, colors, index, other, settings), index as u32, other as u32));
        }
    }
    edges.sort_unstable_by(|one, other| one.0.total_cmp(&other.0).then(one.1.cmp(&other.1)).then(one.2.cmp(&other.2)));
    let mut forest = DisjointSets::new(count);
    let mut internal_difference = vec![0.0_f32; count];
    for &(weight, one, other) in &edges {
        let (one, other) = (forest.root(one), forest.root(other));
        if one == other {
            continue;
        }
        let bound = |root: u32| internal_difference[root as usize] + settings.scale / forest.size[root as usize] as f32;
        if weight <= bound(one).min(bound(other)).min(1.0) {
            let root = forest.join(one, other);
            internal_difference[root as usize] = weight;
        }
    }
    for &(_, one, other) in &edges {
        let (one, other) = (forest.root(one), forest.root(other));
        let is_small = |root: u32| forest.size[root as usize] < settings.min_px;
        if one != other && (is_small(one) || is_small(other)) {
            forest.join(one, other);
        }
    }
    let mut number_of = vec![NONE; count];
    let mut labels = vec![NONE; count];
    let mut regions = 0;
    for index in (0..count).filter(|index| is_foreground[*index]) {
        let root = forest.root(index as u32) as usize;
        if number_of[root] == NONE {
            number_of[root] = regions;
            regions += 1;
        }
        labels[index] = number_of[root];
    }
    (labels, regions as usize)
}

/// Dissimilarity of two neighbouring pixels; 1 corresponds to an object edge.
fn dissimilarity(cloud: &OrganizedCloud, colors: &[Vec3], one: usize, other: usize, settings: &RegionSettings) -> f32 {
    let step_m = settings.step_m.max(settings.step_sigmas * cloud.depth_noise_m(cloud.points[one]));
    let step = tangent_distance_m(cloud, one, other) / step_m;
    let bend = normal_angle(cloud, one, other);
    let bend = if bend < 0.0 { -bend / settings.concave_rad } else { bend / settings.convex_rad };
    let color = colors[one] - colors[other];
    let brightness = color.x.abs() / settings.brightness;
    let hue = chroma(color) / settings.hue;
    (step * step).max(bend * bend).min(4.0) + brightness * brightness + hue * hue
}

/// Smaller distance of either point from the other's tangent plane (m).
fn tangent_distance_m(cloud: &OrganizedCloud, one: usize, other: usize) -> f32 {
    let apart = cloud.points[other] - cloud.points[one];
    apart.dot(cloud.normals[one]).abs().min(apart.dot(cloud.normals[other]).abs())
}

/// Angle between the normals (rad); negative if concave.
pub(super) fn normal_angle(cloud: &OrganizedCloud, one: usize, other: usize) -> f32 {
    let (a, b) = (cloud.normals[one], cloud.normals[other]);
    let angle = a.dot(b).clamp(-1.0, 1.0).acos();
    let apart = cloud.points[other] - cloud.points[one];
    if (b - a).dot(apart) < 0.0 { -angle } else { angle }
}

/// Chroma difference: norm of the non-brightness components.
pub(super) fn chroma(dissimilarity: Vec3) -> f32 {
    dissimilarity.y.hypot(dissimilarity.z)
}

/// Disjoint-set forest.
struct DisjointSets {
    parent: Vec<u32>,
    size: Vec<u32>,
}

impl DisjointSets {
    fn new(count: usize) -> Self {
        Self { parent: (0..count as u32).collect(), size: vec![1; count] }
    }

    fn root(&mut self, mut node: u32) -> u32 {
        while self.parent[node as usize] != node {
            let up = self.parent[self.parent[node as usize] as usize];
            self.parent[node as usize] = up;
            node = up;
        }
        node
    }

    /// Unites two roots; returns the root of the larger set.
    fn join(&mut self, one: u32, other: u32) -> u32 {
        let (low, high) = if self.size[one as usize] < self.size[other as usize] { (one, other) } else { (other, one) };
        self.parent[low as usize] = high;
        self.size[high as usize] += self.size[low as usize];
        high
    }
}
