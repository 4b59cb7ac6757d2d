//! Mass properties of bodies, in the order of precedence of UsdPhysics: stated by the body, or the sum over its
//! colliders, each by its own mass, its own density, the body's density or the density of its physics material.

use genmanip_assets::solid::Moments;
use genmanip_core::{MassProperties, Pose};
use glam::{DMat3, DMat4, DVec3};

use super::geometry::rigid;
use super::units::Units;
use super::value::At;
use crate::collision::hull::convex_hull;
use crate::formats::urdf::combined;
use crate::mass::of_piece;
use crate::raw::{RawCollision, RawMesh};
use crate::units_and_frame::transformed_mass;

/// Density of a collider for which none is stated although others of the body state theirs, as UsdPhysics says: water,
/// kg/m³.
const WATER: f64 = 1000.0;

/// Mass, centre and inertia that a prim states (`PhysicsMassAPI`); `None` for what it does not.
#[derive(Clone, Copy, Default)]
pub struct StatedMass {
    mass_kg: Option<f64>,
    /// Density, kg/m³.
    density: Option<f64>,
    /// Centre of mass in the world frame, m.
    center: Option<DVec3>,
    /// Inertia about the centre of mass along the axes of the world, kg·m².
    inertia: Option<DMat3>,
}

/// Statements about the mass of a collider.
pub struct Collider {
    /// Those of its own prim.
    pub stated: StatedMass,
    /// Density of its physics material, kg/m³; `None` if unstated.
    pub material_density: Option<f64>,
}

impl StatedMass {
    /// Reads the attributes of a prim at `world` (`world_from_prim`, with the world in metres).
    pub fn read(at: &At, world: &DMat4, units: Units) -> Self {
        let Units { metres, kilograms } = units;
        let moments = at.vector("physics:diagonalInertia").filter(|moments| moments.min_element() > 0.0);
        let inertia = moments.map(|moments| {
            let axes = DMat3::from_quat(at.rotation("physics:principalAxes").unwrap_or_default());
            let moments = DMat3::from_diagonal(moments * kilograms * metres * metres);
            let about =
                MassProperties { mass_kg: 1.0, center: DVec3::ZERO, inertia: axes * moments * axes.transpose() };
            transformed_mass(&about, &Pose { position: DVec3::ZERO, ..rigid(world) }).inertia
        });
        Self {
            mass_kg: at.positive("physics:mass").map(|mass| mass * kilograms),
            density: at.positive("physics:density").map(|density| units.density(density)),
            center: at.vector("physics:centerOfMass").map(|center| world.transform_point3(center)),
            inertia,
        }
    }

    /// True if a prim states anything that determines masses.
    pub fn is_stated(&self) -> bool {
        self.mass_kg.is_some() || self.density.is_some()
    }

    /// These properties where they are stated, and otherwise those of a shape, scaled to the stated mass.
    fn or(&self, shape: &MassProperties) -> MassProperties {
        let mass_kg = self.mass_kg.unwrap_or(shape.mass_kg);
        let center = self.center.unwrap_or(shape.center);
        let inertia = self.inertia.unwrap_or_else(|| {
            // The shape's inertia, about the stated centre.
            shape.inertia * (mass_kg / shape.mass_kg) + about(mass_kg, center - shape.center)
        });
        MassProperties { mass_kg, center, inertia }
    }
}

/// Inertia of a point mass at this distance from the axes, kg·m².
fn about(mass_kg: f64, offset: DVec3) -> DMat3 {
    let outer = DMat3::from_cols(offset * offset.x, offset * offset.y, offset * offset.z);
    (DMat3::from_diagonal(DVec3::splat(offset.length_squared())) - outer) * mass_kg
}

/// Mass properties of a body in the world frame; `None` if neither it nor its colliders state a mass or density.
/// `shapes` are those of the colliders, and `origin` is the position of the body's prim, in place of a centre where
/// there is no shape.
pub fn of_body(
    stated: &StatedMass,
    colliders: &[Collider],
    shapes: &[RawCollision],
    origin: DVec3,
) -> Option<MassProperties> {
    let is_stated = |collider: &Collider| collider.stated.is_stated() || collider.material_density.is_some();
    if !stated.is_stated() && !colliders.iter().any(is_stated) {
        return None;
    }
    let each = colliders.iter().zip(shapes).filter_map(|(collider, shape)| {
        let shape = moments(shape)?;
        let density = collider.stated.density.or(stated.density).or(collider.material_density).unwrap_or(WATER);
        Some(collider.stated.or(&shape.with_mass(density * shape.volume)))
    });
    match each.reduce(|sum, one| combined(&sum, &one)) {
        Some(whole) => Some(stated.or(&whole)),
        None => {
            let (center, inertia) = (stated.center.unwrap_or(origin), stated.inertia.unwrap_or(DMat3::ZERO));
            stated.mass_kg.map(|mass_kg| MassProperties { mass_kg, center, inertia })
        }
    }
}

/// Moments of a collision shape; those of its convex hull if it is a mesh that encloses no volume.
fn moments(collision: &RawCollision) -> Option<Moments> {
    let found = match collision {
        RawCollision::Piece(piece) => of_piece(piece),
        RawCollision::HullOf(points) => hull(points),
        RawCollision::Mesh(mesh) => enclosed(mesh).or_else(|| hull(&mesh.positions)),
    };
    found.filter(|moments| moments.volume.is_finite() && moments.volume > 0.0)
}

fn hull(points: &[DVec3]) -> Option<Moments> {
    let (corners, triangles) = convex_hull(points)?;
    let loose: Vec<[DVec3; 3]> = triangles.iter().map(|t| t.map(|index| corners[index as usize])).collect();
    Some(Moments::of_surface(&loose))
}

/// Moments of the interior of a closed mesh; `None` if an edge has not one triangle on either side.
fn enclosed(mesh: &RawMesh) -> Option<Moments> {
    let mut edges: Vec<[u32; 2]> = mesh.triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]).collect();
    edges.sort_unstable();
    let is_once = edges.windows(2).all(|pair| pair[0] != pair[1]);
    let has_opposite = edges.iter().all(|&[a, b]| edges.binary_search(&[b, a]).is_ok());
    let moments = (is_once && has_opposite).then(|| Moments::of_surface(&mesh.corners().collect::<Vec<_>>()))?;
    (moments.volume > 0.0).then_some(moments)
}
