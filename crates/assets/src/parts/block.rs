use std::collections::BTreeMap;
use std::f64::consts::FRAC_PI_4;

use genmanip_core::{Pose, Seed, TriMesh};
use glam::{DQuat, DVec2, DVec3};
use serde::Deserialize;

use super::visual::surface;
use crate::finish::Finish;
use crate::link_builder::LinkBuilder;
use crate::solid::Solid;
use crate::surface::{Detail, rounded_rectangle};

/// Box with sharp or rounded edges, standing on the centre of its base: carton, book, cube, loaf.
///
/// Collision: an exact box for rounding up to 4 mm, otherwise a hull of bevelled rings.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Block {
    /// Name of the visual part.
    #[serde(default = "body")]
    pub name: String,
    /// Extent along the x, y and z axes, m.
    pub size: DVec3,
    /// Centre of the base in the object's frame, m.
    #[serde(default)]
    pub at: DVec3,
    /// Rotation about the centre of the base: roll, pitch and yaw about the fixed x, y and z axes, degrees.
    #[serde(default)]
    pub turn_deg: [f64; 3],
    /// Radius of the edges, m; 0 for sharp ones.
    #[serde(default)]
    pub round: f64,
    /// Fraction of the rounding that the vertical edges of the collider keep at its top and bottom, 0-1; with 0 a
    /// corner is a single vertex.
    /// Small roundings crowd vertices: the physics engine keeps four contacts per face, and an object whose contacts
    /// all lie at two opposite corners never stops rocking.
    #[serde(default = "corner")]
    pub corner: f64,
    /// True for a part that is rendered but does not collide.
    #[serde(default)]
    pub ghost: bool,
    /// Finish of all sides that `faces` does not list.
    pub finish: Finish,
    /// Finish of single sides instead of `finish`.
    #[serde(default)]
    pub faces: BTreeMap<Face, Finish>,
}

/// Side of a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Face {
    /// Side at -x, towards the robot.
    Front,
    /// Side at +x, away from the robot.
    Far,
    /// Side at +y, the robot's left.
    Left,
    /// Side at -y, the robot's right.
    Right,
    /// Side at +z.
    Top,
    /// Side at -z.
    Bottom,
}

impl Face {
    const ALL: [Self; 6] = [Self::Front, Self::Far, Self::Left, Self::Right, Self::Top, Self::Bottom];

    /// Directions of the texture's u (right) and v (down), and the outward normal.
    fn axes(self) -> [DVec3; 3] {
        let (u, v) = match self {
            Self::Front => (DVec3::NEG_Y, DVec3::NEG_Z),
            Self::Far => (DVec3::Y, DVec3::NEG_Z),
            Self::Left => (DVec3::NEG_X, DVec3::NEG_Z),
            Self::Right => (DVec3::X, DVec3::NEG_Z),
            Self::Top => (DVec3::NEG_Y, DVec3::NEG_X),
            Self::Bottom => (DVec3::NEG_Y, DVec3::X),
        };
        [u, v, v.cross(u)]
    }
}

impl Block {
    pub(super) fn add_to(&self, link: &mut LinkBuilder, seed: Seed) {
        let half = self.size / 2.0;
        let [roll, pitch, yaw] = self.turn_deg.map(f64::to_radians);
        let turn = DQuat::from_rotation_z(yaw) * DQuat::from_rotation_y(pitch) * DQuat::from_rotation_x(roll);
        let object_from_block = Pose::new(self.at, turn) * Pose::from_position(DVec3::Z * half.z);
        let round = self.round.min(half.min_element());
        let side = |face: Face, detail: Detail| {
            // Edges of a single chord are as thin as a pixel, and look dotted.
            let steps = detail.chords(ROUND_STEPS, round, FRAC_PI_4).max(2);
            face_mesh(face, half, round, steps, &object_from_block)
        };
        for (&face, finish) in &self.faces {
            let name = format!("{}_{}", self.name, format!("{face:?}").to_lowercase());
            link.visual.push(surface(&name, |detail| side(face, detail), finish, seed.fork(&name)));
        }
        let plain: Vec<Face> = Face::ALL.into_iter().filter(|face| !self.faces.contains_key(face)).collect();
        if !plain.is_empty() {
            let mesh = |detail| {
                plain.iter().fold(TriMesh::default(), |mut mesh, &face| {
                    append(&mut mesh, &side(face, detail));
                    mesh
                })
            };
            link.visual.push(surface(&self.name, mesh, &self.finish, seed));
        }
        if !self.ghost {
            link.solids.push(self.solid(&object_from_block));
        }
    }

    fn solid(&self, object_from_block: &Pose) -> Solid {
        let half = self.size / 2.0;
        if self.round <= 0.004 {
            return Solid::cuboid(*object_from_block, half);
        }
        let round = self.round.min(half.min_element());
        let flat = DVec2::new(half.x, half.y);
        let step = round * (1.0 - std::f64::consts::FRAC_1_SQRT_2);
        let rings: Vec<Vec<DVec3>> = [
            (round, -half.z),
            (step, -half.z + step),
            (0.0, -half.z + round),
            (0.0, half.z - round),
            (step, half.z - step),
            (round, half.z),
        ]
        .into_iter()
        .filter(|&(inset, z)| !(inset == 0.0 && z > 0.0 && half.z - round < 1e-4))
        .map(|(inset, z)| {
            let corner = (round - inset).max(round * self.corner);
            let ring = rounded_rectangle(flat - inset, corner, z, 3);
            ring.into_iter().map(|point| object_from_block.transform_point(point)).collect()
        })
        .collect();
        Solid::loft(&rings)
    }
}

/// Number of chords of half a rounded edge (an eighth of a circle) in full detail.
const ROUND_STEPS: usize = 3;

/// Mesh of one side with the adjacent halves of its rounded edges, each in `steps` chords; planar texture coordinates.
fn face_mesh(face: Face, half: DVec3, round: f64, steps: usize, object_from_block: &Pose) -> TriMesh {
    let [u, v, normal] = face.axes();
    let (half_u, half_v, half_n) = (u.abs().dot(half), v.abs().dot(half), normal.abs().dot(half));
    let knots = |extent: f64| {
        if round <= 0.0 {
            return vec![-extent, extent];
        }
        let core = extent - round;
        // Points at equal angles on an eighth of a circle, projected from the centre of the rounding onto the plane of
        // the side.
        let bend = |i: usize| core + round * (FRAC_PI_4 * i as f64 / steps as f64).tan();
        let mut knots: Vec<f64> = (0..=steps).rev().map(|i| -bend(i)).collect();
        knots.extend((0..=steps).map(bend));
        knots
    };
    let (columns, rows) = (knots(half_u), knots(half_v));
    let mut mesh = TriMesh::default();
    for &b in &rows {
        for &a in &columns {
            let on_cube = u * a + v * b + normal * half_n;
            let core = on_cube.clamp(-(half - round), half - round);
            let direction = if round > 0.0 { (on_cube - core).normalize_or(normal) } else { normal };
            let position = if round > 0.0 { core + direction * round } else { on_cube };
            mesh.positions.push(object_from_block.transform_point(position).as_vec3());
            mesh.normals.push(object_from_block.transform_vector(direction).as_vec3());
            mesh.uvs.push(DVec2::new(0.5 + a / half_u / 2.0, 0.5 + b / half_v / 2.0).as_vec2());
        }
    }
    let width = columns.len() as u32;
    for row in 0..rows.len() as u32 - 1 {
        for column in 0..width - 1 {
            let i = row * width + column;
            mesh.triangles.push([i, i + width, i + width + 1]);
            mesh.triangles.push([i, i + width + 1, i + 1]);
        }
    }
    mesh
}

fn append(mesh: &mut TriMesh, other: &TriMesh) {
    let offset = mesh.positions.len() as u32;
    mesh.positions.extend(&other.positions);
    mesh.normals.extend(&other.normals);
    mesh.uvs.extend(&other.uvs);
    mesh.triangles.extend(other.triangles.iter().map(|triangle| triangle.map(|index| index + offset)));
}

/// Default of [`Block::corner`].
pub(super) const CORNER: f64 = 0.05;

fn corner() -> f64 {
    CORNER
}

fn body() -> String {
    "body".into()
}
