//! What stands around the robot: a table, and on request a floor.

use std::sync::{Arc, OnceLock};

use genmanip_core::{Material, Pose, Texture, TriMesh, VisualPart};
use glam::{Vec2, Vec3};
use serde::{Deserialize, Serialize};

/// The surroundings. The table's top is the plane z = 0.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Environment {
    /// Whether there is a table.
    pub table: bool,
    /// Extent of the table's top along x, metres, world frame.
    pub table_x: [f32; 2],
    /// Extent along y.
    pub table_y: [f32; 2],
    /// Thickness of the top.
    pub table_thickness_m: f32,
    /// Radius of its rounded edges and corners.
    pub edge_radius_m: f32,
    /// Whether there is a floor below; without it the background shows.
    pub floor: bool,
    /// Height of the floor.
    pub floor_z: f32,
}

impl Default for Environment {
    fn default() -> Self {
        Self {
            table: true,
            table_x: [-0.30, 1.10], // carries the robot's base and the usable area 0.2-0.9 with a margin
            table_y: [-0.75, 0.75], // usable area ±0.5 with a margin
            table_thickness_m: 0.04,
            edge_radius_m: 0.012,
            floor: false, // the benchmark's background is plain white
            floor_z: -0.74,
        }
    }
}

/// Surfaces to draw, in the world frame.
pub(crate) fn visuals(environment: &Environment) -> Vec<VisualPart> {
    let part = |name: &str, mesh: TriMesh, material: Material| VisualPart {
        name: name.into(),
        mesh: Arc::new(mesh),
        material,
        link_from_part: Pose::IDENTITY,
    };
    let mut parts = Vec::new();
    if environment.table {
        let wood = Material { texture: Some(wood()), ..Material::plain([1.0; 3], 0.55) };
        parts.push(part("table", table_top(environment), wood));
        parts.push(part("legs", table_legs(environment), Material::plain([0.32, 0.33, 0.35], 0.5)));
    }
    if environment.floor {
        parts.push(part("floor", floor(environment.floor_z), Material::plain([0.72, 0.71, 0.70], 0.8)));
    }
    parts
}

/// Metres of wood covered by one repetition of the texture.
const WOOD_SIZE_M: f32 = 1.5;

/// A slab with rounded vertical corners and rounded upper and lower edges: rings of the outline, closed by fans.
fn table_top(environment: &Environment) -> TriMesh {
    const QUARTER: usize = 8;
    let radius = environment.edge_radius_m.min(environment.table_thickness_m / 2.0).max(1e-4);
    let corner_radius = radius * 2.5;
    let (low, high) = (
        Vec2::new(environment.table_x[0], environment.table_y[0]),
        Vec2::new(environment.table_x[1], environment.table_y[1]),
    );
    let quarter_angle = |step: usize| step as f32 / QUARTER as f32 * std::f32::consts::FRAC_PI_2;
    let outline: Vec<(Vec2, Vec2)> = [(1.0, 1.0, 0.0), (-1.0, 1.0, 1.0), (-1.0, -1.0, 2.0), (1.0, -1.0, 3.0)]
        .iter()
        .flat_map(|&(sx, sy, quarter)| {
            let x = if sx > 0.0 { high.x - corner_radius } else { low.x + corner_radius };
            let y = if sy > 0.0 { high.y - corner_radius } else { low.y + corner_radius };
            (0..=QUARTER).map(move |step| {
                let outward = Vec2::from_angle(quarter * std::f32::consts::FRAC_PI_2 + quarter_angle(step));
                (Vec2::new(x, y), outward)
            })
        })
        .collect();
    // Rings from the upper face over the edge to the lower face: (inset from the side, z, slope of the normal).
    let upper = (0..=QUARTER).map(|step| (quarter_angle(step), -radius));
    let lower = (0..=QUARTER).map(|step| (quarter_angle(step + QUARTER), radius - environment.table_thickness_m));
    let mut mesh = TriMesh::default();
    let mut push = |position: Vec3, normal: Vec3| {
        // The lower side and the edge continue the picture of the top.
        let along = if normal.z.abs() > 0.5 { 0.0 } else { position.z };
        mesh.positions.push(position);
        mesh.normals.push(normal);
        mesh.uvs.push(Vec2::new(position.x + along, position.y + along) / WOOD_SIZE_M);
    };
    let count = outline.len() as u32;
    let mut rings = 0;
    for (angle, center_z) in upper.chain(lower) {
        let (out, up) = (angle.sin(), angle.cos());
        for &(center, outward) in &outline {
            let flat = center + outward * (corner_radius - radius + radius * out);
            push(flat.extend(center_z + radius * up), (outward * out).extend(up));
        }
        rings += 1;
    }
    let middle = (low + high) * 0.5;
    push(middle.extend(0.0), Vec3::Z);
    push(middle.extend(-environment.table_thickness_m), Vec3::NEG_Z);
    let (top, bottom) = (rings * count, rings * count + 1);
    let last = (rings - 1) * count;
    for i in 0..count {
        let next = (i + 1) % count;
        mesh.triangles.push([top, i, next]);
        mesh.triangles.push([bottom, last + next, last + i]);
        for ring in 0..rings - 1 {
            let (a, b) = (ring * count, (ring + 1) * count);
            mesh.triangles.push([a + i, b + i, b + next]);
            mesh.triangles.push([a + i, b + next, a + next]);
        }
    }
    mesh
}

fn table_legs(environment: &Environment) -> TriMesh {
    let half = 0.03;
    let inset = 0.08;
    let top = -environment.table_thickness_m;
    let mut mesh = TriMesh::default();
    for x in [environment.table_x[0] + inset, environment.table_x[1] - inset] {
        for y in [environment.table_y[0] + inset, environment.table_y[1] - inset] {
            push_box(&mut mesh, Vec3::new(x - half, y - half, environment.floor_z), Vec3::new(x + half, y + half, top));
        }
    }
    mesh
}

fn floor(z: f32) -> TriMesh {
    let mut mesh = TriMesh::default();
    push_box(&mut mesh, Vec3::new(-6.0, -6.0, z - 0.1), Vec3::new(6.0, 6.0, z));
    mesh
}

/// A box with flat faces.
pub(crate) fn push_box(mesh: &mut TriMesh, low: Vec3, high: Vec3) {
    for axis in 0..3 {
        for sign in [-1.0_f32, 1.0] {
            let mut normal = Vec3::ZERO;
            normal[axis] = sign;
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            let first = mesh.positions.len() as u32;
            for (at_u, at_v) in [(0, 0), (1, 0), (1, 1), (0, 1)] {
                let mut corner = if sign > 0.0 { high } else { low };
                corner[u] = if at_u == 0 { low[u] } else { high[u] };
                corner[v] = if at_v == 0 { low[v] } else { high[v] };
                mesh.positions.push(corner);
                mesh.normals.push(normal);
                mesh.uvs.push(Vec2::ZERO);
            }
            let quad = if sign > 0.0 { [[0, 1, 2], [0, 2, 3]] } else { [[0, 2, 1], [0, 3, 2]] };
            mesh.triangles.extend(quad.map(|triangle| triangle.map(|index| first + index)));
        }
    }
}

/// A calm light wood: long fibres along y, wide soft bands, low contrast, so that objects stand out.
///
/// Repeats without a seam. Made once per process.
fn wood() -> Arc<Texture> {
    static WOOD: OnceLock<Arc<Texture>> = OnceLock::new();
    let make = || {
        const SIZE: u32 = 1024;
        let (light, dark) = (Vec3::new(222.0, 209.0, 190.0), Vec3::new(194.0, 176.0, 152.0));
        let mut rgb = Vec::with_capacity((SIZE * SIZE * 3) as usize);
        for y in 0..SIZE {
            for x in 0..SIZE {
                let (u, v) = (x as f32 / SIZE as f32, y as f32 / SIZE as f32);
                let bend = tiling_noise(u, v, 4, 3) * 0.10 + tiling_noise(u, v, 10, 4) * 0.03;
                let band = ((u + bend) * std::f32::consts::TAU * 9.0).sin() * 0.5 + 0.5;
                let fibre = tiling_noise(u, v, 400, 12) * 0.6 + tiling_noise(u, v, 160, 5) * 0.4;
                let patch = tiling_noise(u, v, 3, 2);
                let mix = (0.18 + 0.22 * band + 0.34 * fibre + 0.16 * patch).clamp(0.0, 1.0);
                rgb.extend(light.lerp(dark, mix).to_array().map(|value| value as u8));
            }
        }
        Arc::new(Texture { width: SIZE, height: SIZE, rgb })
    };
    Arc::clone(WOOD.get_or_init(make))
}

/// Value noise in 0-1 on a grid of `columns` × `rows` cells that repeats after one unit.
fn tiling_noise(u: f32, v: f32, columns: u32, rows: u32) -> f32 {
    let (x, y) = (u * columns as f32, v * rows as f32);
    let (x0, y0) = (x as u32, y as u32);
    let smooth = |t: f32| t * t * (3.0 - 2.0 * t);
    let (fx, fy) = (smooth(x - x0 as f32), smooth(y - y0 as f32));
    let value = |column: u32, row: u32| {
        let cell = (column % columns) + (row % rows) * columns + columns * 7919 + rows * 104_729;
        let mut hash = cell.wrapping_mul(0x9E37_79B1);
        hash = (hash ^ (hash >> 15)).wrapping_mul(0x85EB_CA77);
        hash = (hash ^ (hash >> 13)).wrapping_mul(0xC2B2_AE3D);
        (hash >> 8) as f32 / 16_777_216.0
    };
    let upper = value(x0, y0) + (value(x0 + 1, y0) - value(x0, y0)) * fx;
    let lower = value(x0, y0 + 1) + (value(x0 + 1, y0 + 1) - value(x0, y0 + 1)) * fx;
    upper + (lower - upper) * fy
}
