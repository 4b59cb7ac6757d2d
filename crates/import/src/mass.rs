//! Mass properties: the file's values if plausible, otherwise typical values of the category.

use genmanip_assets::solid::{Moments, Solid};
use genmanip_core::{MassProperties, Piece, Shape};
use glam::{DMat3, DVec3};

use crate::collision::hull::convex_hull;
use crate::collision::piece_volume;
use crate::raw::RawLink;
use crate::report::Guess;
use crate::typical_sizes::Prior;

/// Mean density of household objects of unknown category, hollow ones included, kg/m³. Chosen by hand.
const DENSITY: f64 = 450.0;
/// Plausible range of a link's mass, kg. Chosen by hand.
const MASS_KG: [f64; 2] = [0.001, 60.0];
/// Maximum factor between an estimated mass and the typical mass of the category, in either direction. Chosen by hand.
const UNUSUAL: f64 = 3.0;
/// Maximum plausible factor between a stated inertia and that of a body of uniform density, in either direction. Chosen
/// by hand.
const INERTIA_OFF: f64 = 8.0;

/// Mass properties of each link.
pub fn masses(
    links: &[RawLink],
    bodies: &[&[Piece]],
    size: DVec3,
    prior: Option<&Prior>,
    guesses: &mut Vec<Guess>,
) -> Vec<MassProperties> {
    let volumes: Vec<f64> =
        bodies.iter().map(|pieces| pieces.iter().map(piece_volume).sum::<f64>().max(1e-9)).collect();
    let whole: f64 = volumes.iter().sum();
    let total = prior.map_or(DENSITY * whole, |prior| {
        let by_size = prior.bounds_density * size.element_product();
        by_size.clamp(prior.mass_kg / UNUSUAL, prior.mass_kg * UNUSUAL)
    });
    let mut masses = Vec::new();
    for (index, link) in links.iter().enumerate() {
        let uniform = moments(bodies[index]);
        let name = if links.len() == 1 { "mass".to_owned() } else { format!("mass of {}", link.name) };
        let guessed = (total * volumes[index] / whole).clamp(MASS_KG[0], MASS_KG[1]);
        let (mass_kg, because) = match (&link.mass, prior) {
            (Some(mass), _) if (MASS_KG[0]..=MASS_KG[1]).contains(&mass.mass_kg) => (mass.mass_kg, None),
            (Some(mass), _) => (guessed, Some(format!("the files' {} kg are implausible", mass.mass_kg))),
            (None, Some(prior)) => {
                (guessed, Some(format!("a {} usually weighs {:.3} kg", prior.category, prior.mass_kg)))
            }
            (None, None) => (guessed, Some(format!("{DENSITY} kg/m³, the average of household objects"))),
        };
        guesses.extend(because.map(|because| Guess::new(name.clone(), format!("{mass_kg:.3} kg"), because)));
        let uniform = uniform.with_mass(mass_kg);
        let own = link.mass.as_ref().filter(|mass| mass.mass_kg == mass_kg);
        masses.push(match own {
            Some(own) if is_plausible(own, &uniform) => *own,
            Some(own) if own.inertia == DMat3::ZERO => uniform,
            Some(_) => {
                guesses.push(Guess::new(
                    name.replace("mass", "inertia"),
                    "uniform density",
                    "the files' is implausible",
                ));
                uniform
            }
            None => uniform,
        });
    }
    masses
}

/// True if mass properties are consistent with a body about as large as the pieces.
fn is_plausible(mass: &MassProperties, uniform: &MassProperties) -> bool {
    let diagonal = |inertia: &DMat3| DVec3::new(inertia.x_axis.x, inertia.y_axis.y, inertia.z_axis.z);
    let (own, usual) = (diagonal(&mass.inertia), diagonal(&uniform.inertia));
    let ratio = own / usual;
    // A physical body has non-negative second moments along every axis, i.e. its inertia satisfies the triangle
    // inequality. The second moment across a flat plate vanishes, up to rounding.
    let trace = own.element_sum();
    let second = DMat3::from_diagonal(DVec3::splat((0.5 + 1e-9) * trace)) - mass.inertia;
    let reach = (usual.max_element() / uniform.mass_kg).sqrt();
    is_positive(&mass.inertia)
        && is_positive(&second)
        && ratio.min_element() > 1.0 / INERTIA_OFF
        && ratio.max_element() < INERTIA_OFF
        && mass.center.distance(uniform.center) < 2.0 * reach
}

/// True if a symmetric matrix is positive definite, by its leading minors (Sylvester's criterion).
fn is_positive(m: &DMat3) -> bool {
    m.x_axis.x > 0.0 && m.x_axis.x * m.y_axis.y > m.x_axis.y * m.x_axis.y && m.determinant() > 0.0
}

/// Combined moments of all pieces.
fn moments(pieces: &[Piece]) -> Moments {
    let each: Vec<Moments> = pieces.iter().filter_map(of_piece).collect();
    if each.is_empty() {
        return Solid::cuboid(genmanip_core::Pose::IDENTITY, DVec3::splat(0.01)).moments;
    }
    Moments::sum(each.iter())
}

/// Moments of a piece in the link's frame; `None` for a hull without volume.
pub fn of_piece(piece: &Piece) -> Option<Moments> {
    let pose = piece.link_from_piece;
    let ellipsoid = |radii: DVec3| {
        let volume = piece_volume(piece);
        let rotation = DMat3::from_quat(pose.rotation);
        let second = rotation * DMat3::from_diagonal(radii * radii * (volume / 5.0)) * rotation.transpose();
        Moments { volume, center: pose.position, second }
    };
    let along = |half: f64| [pose.transform_point(DVec3::Z * -half), pose.transform_point(DVec3::Z * half)];
    Some(match &piece.shape {
        Shape::Box { half_extents } => Solid::cuboid(pose, *half_extents).moments,
        Shape::Sphere { radius } => ellipsoid(DVec3::splat(*radius)),
        Shape::Ellipsoid { radii } => ellipsoid(*radii),
        Shape::Cylinder { radius, half_height } => {
            let [from, to] = along(*half_height);
            Solid::cylinder(from, to, *radius).moments
        }
        Shape::Capsule { radius, half_length } => {
            let [from, to] = along(*half_length);
            Solid::capsule(from, to, *radius).moments
        }
        Shape::Hull { points } => {
            let (corners, triangles) = convex_hull(points)?;
            let placed: Vec<DVec3> = corners.iter().map(|corner| pose.transform_point(*corner)).collect();
            let loose: Vec<[DVec3; 3]> = triangles.iter().map(|t| t.map(|index| placed[index as usize])).collect();
            Moments::of_surface(&loose)
        }
    })
}
