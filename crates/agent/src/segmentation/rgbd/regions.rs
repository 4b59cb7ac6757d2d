//! Small regions of one surface and one colour: the image cut finer than its things.
//!
//! After Felzenszwalb and Huttenlocher, "Efficient graph-based image segmentation", IJCV 2004: neighbouring pixels are
//! joined from the most alike on, as long as they differ little more than the pixels of either region do among each other.

use glam::Vec3;

use super::surface::Surface;

/// How pixels become regions.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct RegionSettings {
    /// Step out of the tangent plane that counts as one difference, m.
    pub step_m: f32,
    /// The same as standard deviations of the depth.
    pub step_noises: f32,
    /// Angle of a concave edge that counts as one, rad.
    pub concave_rad: f32,
    /// Angle of a convex edge that counts as one, rad.
    pub convex_rad: f32,
    /// Difference of brightness that counts as one.
    pub brightness: f32,
    /// Difference of hue and saturation that counts as one.
    pub hue: f32,
    /// How much more regions of a pixel may differ, times the number of pixels.
    pub scale: f32,
    /// Regions with fewer pixels join the neighbour that is most alike.
    pub least_px: u32,
}

impl Default for RegionSettings {
    fn default() -> Self {
        Self {
            step_m: 0.004,
            step_noises: 4.0,
            concave_rad: 0.4,
            convex_rad: 0.9,
            brightness: 0.16,
            hue: 0.10,
            scale: 8.0,
            least_px: 12,
        }
    }
}

/// Marks pixels of no region.
pub(super) const NONE: u32 = u32::MAX;

/// Region of each pixel, numbered from 0 in the order of their first pixels, and how many there are.
pub(super) fn regions(
    surface: &Surface,
    colors: &[Vec3],
    is_asked: &[bool],
    settings: &RegionSettings,
) -> (Vec<u32>, usize) {
    let (width, count) = (surface.width, surface.points.len());
    let mut edges: Vec<(f32, u32, u32)> = Vec::new();
    for index in (0..count).filter(|index| is_asked[*index]) {
        let right = (index % width + 1 < width).then_some(index + 1);
        let below = (index + width < count).then_some(index + width);
        for other in [right, below].into_iter().flatten().filter(|other| is_asked[*other]) {
            edges.push((difference(surface, colors, index, other, settings), index as u32, other as u32));
        }
    }
    edges.sort_unstable_by(|one, other| one.0.total_cmp(&other.0).then(one.1.cmp(&other.1)).then(one.2.cmp(&other.2)));
    let mut forest = Forest::new(count);
    let mut inner = vec![0.0_f32; count];
    for &(weight, one, other) in &edges {
        let (one, other) = (forest.root(one), forest.root(other));
        if one == other {
            continue;
        }
        let bound = |root: u32| inner[root as usize] + settings.scale / forest.size[root as usize] as f32;
        if weight <= bound(one).min(bound(other)).min(1.0) {
            let root = forest.join(one, other);
            inner[root as usize] = weight;
        }
    }
    for &(_, one, other) in &edges {
        let (one, other) = (forest.root(one), forest.root(other));
        let is_small = |root: u32| forest.size[root as usize] < settings.least_px;
        if one != other && (is_small(one) || is_small(other)) {
            forest.join(one, other);
        }
    }
    let mut number_of = vec![NONE; count];
    let mut labels = vec![NONE; count];
    let mut regions = 0;
    for index in (0..count).filter(|index| is_asked[*index]) {
        let root = forest.root(index as u32) as usize;
        if number_of[root] == NONE {
            number_of[root] = regions;
            regions += 1;
        }
        labels[index] = number_of[root];
    }
    (labels, regions as usize)
}

/// How unlike two neighbouring pixels are; 1 looks like an edge between things.
fn difference(surface: &Surface, colors: &[Vec3], one: usize, other: usize, settings: &RegionSettings) -> f32 {
    let step_m = settings.step_m.max(settings.step_noises * surface.depth_noise_m(surface.points[one]));
    let step = step_of(surface, one, other) / step_m;
    let bend = bend_of(surface, one, other);
    let bend = if bend < 0.0 { -bend / settings.concave_rad } else { bend / settings.convex_rad };
    let color = colors[one] - colors[other];
    let brightness = color.x.abs() / settings.brightness;
    let hue = hue_of(color) / settings.hue;
    (step * step).max(bend * bend).min(4.0) + brightness * brightness + hue * hue
}

/// Distance of one point from the tangent plane of the other, m; the smaller one of both.
fn step_of(surface: &Surface, one: usize, other: usize) -> f32 {
    let apart = surface.points[other] - surface.points[one];
    apart.dot(surface.normals[one]).abs().min(apart.dot(surface.normals[other]).abs())
}

/// Angle between the normals, rad; negative where the surface is concave.
pub(super) fn bend_of(surface: &Surface, one: usize, other: usize) -> f32 {
    let (a, b) = (surface.normals[one], surface.normals[other]);
    let angle = a.dot(b).clamp(-1.0, 1.0).acos();
    let apart = surface.points[other] - surface.points[one];
    if (b - a).dot(apart) < 0.0 { -angle } else { angle }
}

/// Length of what is not brightness in a difference of colours.
pub(super) fn hue_of(difference: Vec3) -> f32 {
    difference.y.hypot(difference.z)
}

/// Disjoint sets.
struct Forest {
    parent: Vec<u32>,
    size: Vec<u32>,
}

impl Forest {
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

    /// Joins two roots; the larger one stays.
    fn join(&mut self, one: u32, other: u32) -> u32 {
        let (low, high) = if self.size[one as usize] < self.size[other as usize] { (one, other) } else { (other, one) };
        self.parent[low as usize] = high;
        self.size[high as usize] += self.size[low as usize];
        high
    }
}
