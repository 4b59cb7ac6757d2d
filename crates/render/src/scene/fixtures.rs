//! Fixtures of a world: slabs of the support surfaces with their boards and legs.

use genmanip_core::{Material, SupportSurface, TriMesh, VisualPart, World};
use glam::{Vec2, Vec3};

use crate::scene::table_tops::{TOP_SIZE_M, TableTop};

/// Radius of a slab's rounded edges (m).
const EDGE_RADIUS_M: f32 = 0.012;
/// Half width of a leg, and distance of its centre from the slab's edges (m).
const LEG_HALF_M: f32 = 0.03;
const LEG_INSET_M: f32 = 0.08;

/// Visual part that is fixed in the world.
#[derive(Debug)]
pub struct Fixture {
    /// Mesh and material; `link_from_part` is the pose in the world.
    pub visual: VisualPart,
    /// True if the part is the slab of a support surface, not a board or its legs.
    pub is_slab: bool,
    /// True if the part casts shadows; false for all parts of the first support surface, since nothing below it is
    /// visible.
    pub casts_shadow: bool,
}

/// Fixtures of all support surfaces, in the world frame.
pub fn visuals(world: &World) -> Vec<Fixture> {
    let mut fixed = Vec::new();
    for (index, surface) in world.surfaces.iter().enumerate() {
        let is_first = index == 0;
        let mut add = |mesh: TriMesh, material: Material, is_slab: bool| {
            fixed.push(Fixture {
                visual: VisualPart::new(surface.id.as_str(), mesh, material, surface.world_from_surface()),
                is_slab,
                casts_shadow: !is_first,
            });
        };
        let paint = || Material::plain([0.80, 0.81, 0.82], 0.5);
        add(slab(surface), if is_first { TableTop::default().material() } else { paint() }, true);
        for board in &surface.boards {
            let (center, half) = (board.center_m.as_vec3(), board.size_m.as_vec3() * 0.5);
            let mut mesh = TriMesh::default();
            push_box(&mut mesh, center - half, center + half);
            add(mesh, paint(), false);
        }
        if surface.legs {
            add(legs(surface, world.floor_z_m), Material::plain([0.32, 0.33, 0.35], 0.5), false);
        }
    }
    fixed
}

/// Slab with rounded vertical corners and rounded edges, in the surface's frame: rings of the outline and flat faces.
/// Texture coordinates are world x and y in units of [`TOP_SIZE_M`] if the slab is not rotated.
fn slab(surface: &SupportSurface) -> TriMesh {
    const QUARTER: usize = 8;
    let size = surface.size_m.as_vec3();
    let radius = EDGE_RADIUS_M.min(size.min_element() / 5.0).max(1e-4);
    let corner_radius = radius * 2.5;
    let (low, high) = (size.truncate() * -0.5, size.truncate() * 0.5);
    let texture_offset = surface.top_center_m.as_vec3().truncate();
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
    // Rings from the upper face over the edge to the lower face: angle of the normal from the vertical, and z of the
    // centre of the rounding.
    let upper = (0..=QUARTER).map(|step| (quarter_angle(step), -radius));
    let lower = (0..=QUARTER).map(|step| (quarter_angle(step + QUARTER), radius - size.z));
    let mut mesh = TriMesh::default();
    let mut push = |position: Vec3, normal: Vec3| {
        // On vertical faces, z is added to the texture coordinates, so that the texture continues around the edge.
        let along = if normal.z.abs() > 0.5 { 0.0 } else { position.z };
        mesh.positions.push(position);
        mesh.normals.push(normal);
        mesh.uvs.push((position.truncate() + along + texture_offset) / TOP_SIZE_M);
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
    let last = (rings - 1) * count;
    for [a, b, c] in face(QUARTER as u32 + 1) {
        mesh.triangles.push([a, b, c]);
        mesh.triangles.push([last + a, last + c, last + b]);
    }
    for i in 0..count {
        let next = (i + 1) % count;
        for ring in 0..rings - 1 {
            let (a, b) = (ring * count, (ring + 1) * count);
            mesh.triangles.push([a + i, b + i, b + next]);
            mesh.triangles.push([a + i, b + next, a + next]);
        }
    }
    mesh
}

/// Triangulation of an outline of four round corners with `corner` vertices each: two large triangles inside, which
/// meet in a diagonal, the others along the border, so that no other edge crosses the inside.
fn face(corner: u32) -> Vec<[u32; 3]> {
    let mut triangles = Vec::new();
    for first in [0, corner, 2 * corner, 3 * corner] {
        triangles.extend((first + 1..first + corner - 1).map(|point| [first, point, point + 1]));
        triangles.push([first, first + corner - 1, (first + corner) % (4 * corner)]);
    }
    triangles.extend([[0, corner, 2 * corner], [0, 2 * corner, 3 * corner]]);
    triangles
}

/// Four legs from the slab to the floor, in the surface's frame.
fn legs(surface: &SupportSurface, floor_z_m: f64) -> TriMesh {
    let half_size = surface.size_m.as_vec3() * 0.5;
    let bottom = (floor_z_m - surface.top_center_m.z) as f32;
    let inset = LEG_INSET_M.min(half_size.x.min(half_size.y) * 0.5);
    let mut mesh = TriMesh::default();
    for x in [inset - half_size.x, half_size.x - inset] {
        for y in [inset - half_size.y, half_size.y - inset] {
            let (low, high) = (Vec2::new(x, y) - LEG_HALF_M, Vec2::new(x, y) + LEG_HALF_M);
            push_box(&mut mesh, low.extend(bottom), high.extend(-2.0 * half_size.z));
        }
    }
    mesh
}

/// Appends a box between two corners, with one normal per face.
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
