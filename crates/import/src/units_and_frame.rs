//! Unit and frame: converts an object from the file's unit, up axis and origin to metres, +z up, origin at the centre
//! of the base.

use genmanip_core::{Aabb, Joint, JointKind, MassProperties, Piece, Pose, Shape};
use glam::{DMat4, DQuat, DVec3};

use crate::raw::{RawCollision, RawObject, Unit, Up};
use crate::report::Guess;
use crate::typical_sizes::Prior;

/// Plausible longest side of a tabletop object, m: from a chess piece to a tall cabinet.
const TABLETOP_M: [f64; 2] = [0.03, 1.0];
/// Plausible longest side in a format whose unit is metres, m. Chosen by hand.
const METRIC_M: [f64; 2] = [0.004, 3.0];
/// Maximum plausible factor between an object's size and the typical size of its category, in either direction. Chosen
/// by hand.
const UNUSUAL: f64 = 2.5;
/// Longest side assigned to an object without a typical size, m. Chosen by hand.
const FALLBACK_M: f64 = 0.12;
/// Units written by modelling programs, in metres, most likely first.
const UNITS: [(&str, f64); 4] = [("metres", 1.0), ("centimetres", 0.01), ("millimetres", 0.001), ("inches", 0.0254)];
/// Longest side of an articulated object with normalised size, m: one that an arm on the same table can open.
const NORMALISED_M: f64 = 0.35;

/// Difference below which two footprint fractions count as equal. Chosen by hand.
const EQUAL_MARGIN: f64 = 0.15;

/// The user's choices for unit, up axis and category of a file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Given {
    /// Metres per unit of the file; `None` to guess.
    pub scale: Option<f64>,
    /// Up axis of the file; `None` to guess.
    pub up: Option<Up>,
    /// Category of the object, in lower case, singular; `None` to guess.
    pub category: Option<String>,
    /// Direction that points up when the object has toppled and come to rest, in the frame in which the object stands
    /// otherwise. Found by simulation, not given by the user; `None` if the object does not topple.
    pub tipped_up: Option<DVec3>,
}

/// Scales an object to metres.
pub fn to_metres(raw: &mut RawObject, given: Option<f64>, prior: Option<&Prior>, guesses: &mut Vec<Guess>) {
    let longest = bounds(raw).size().max_element();
    let (scale, value, because) = match given {
        Some(scale) => (scale, format!("{scale} m per unit"), "given".to_owned()),
        None if raw.unit == Unit::Normalised => {
            let wanted = prior.map_or(NORMALISED_M, |prior| prior.longest_m);
            let scale = wanted / longest.max(1e-12);
            (scale, format!("{scale:.5} m"), format!("sizes are normalised; scaled to {wanted:.3} m"))
        }
        None => unit(longest, raw.unit == Unit::Metre, prior),
    };
    guesses.push(Guess::new("unit", value, because));
    scale_by(raw, scale);
}

/// Metres per unit, description, and reason.
fn unit(longest: f64, is_metric: bool, prior: Option<&Prior>) -> (f64, String, String) {
    let within = |metres: f64, [low, high]: [f64; 2]| (low..=high).contains(&metres);
    if is_metric && within(longest, METRIC_M) {
        return (1.0, "metres".into(), format!("the format says so; the longest side is {longest:.3} m"));
    }
    let usual = prior.map(|prior| [prior.longest_m / UNUSUAL, prior.longest_m * UNUSUAL]);
    let plausible = usual.unwrap_or(TABLETOP_M);
    if let Some((name, scale)) = UNITS.iter().find(|(_, scale)| within(longest * scale, plausible)) {
        let why = match prior {
            Some(prior) => format!("a {} is usually {:.3} m long", prior.category, prior.longest_m),
            None => format!("tabletop objects are {} to {} m long", TABLETOP_M[0], TABLETOP_M[1]),
        };
        return (*scale, (*name).to_owned(), format!("{why}; the longest side becomes {:.3} m", longest * scale));
    }
    let wanted = prior.map_or(FALLBACK_M, |prior| prior.longest_m);
    let why = format!("no unit makes its longest side of {longest:.3} plausible; scaled to {wanted:.3} m");
    (wanted / longest.max(1e-12), format!("{:.5} m", wanted / longest.max(1e-12)), why)
}

/// Rotates an object so that its up axis is +z, and adds a guess if the axis was not given.
pub fn upright(raw: &mut RawObject, given: Option<Up>, prior: Option<&Prior>, guesses: &mut Vec<Guess>) {
    let (up, because) = match (given, raw.up) {
        (Some(up), _) => (up, "given".to_owned()),
        (None, Up::Unknown) => more_stable_up(raw, prior),
        (None, known) => (known, "the format says so".to_owned()),
    };
    guesses.push(Guess::new("up", if up == Up::Y { "+y" } else { "+z" }, because));
    if up == Up::Y {
        move_root(raw, &Pose { position: DVec3::ZERO, rotation: DQuat::from_rotation_x(std::f64::consts::FRAC_PI_2) });
    }
}

/// Lays an object down in the pose in which it came to rest after toppling; `up` as in [`Given::tipped_up`].
pub fn lay(raw: &mut RawObject, up: DVec3, guesses: &mut Vec<Guess>) {
    let turn = lying_from_standing(up);
    let angle = turn.to_axis_angle().1.to_degrees();
    let because = "it topples in the file's orientation and rests stably in this one";
    guesses.push(Guess::new("upright", format!("rotated by {angle:.0}°"), because));
    move_root(raw, &Pose { position: DVec3::ZERO, rotation: turn });
}

/// The smallest rotation that maps a direction to +z.
pub fn lying_from_standing(up: DVec3) -> DQuat {
    DQuat::from_rotation_arc(up.normalize_or(DVec3::Z), DVec3::Z)
}

/// Of +y and +z, the axis along which the object stands on the larger fraction of its footprint. If both are equal, the
/// axis that gives the category's typical height; otherwise +y, which modelling programs use in OBJ.
fn more_stable_up(raw: &RawObject, prior: Option<&Prior>) -> (Up, String) {
    let points = raw.all_surfaces().positions;
    let standing = |up: usize| {
        let (along, across) = (|p: &DVec3| p[up], |p: &DVec3| [p[(up + 1) % 3], p[(up + 2) % 3]]);
        let low = points.iter().map(along).fold(f64::INFINITY, f64::min);
        let high = points.iter().map(along).fold(f64::NEG_INFINITY, f64::max);
        let area = |points: &mut dyn Iterator<Item = [f64; 2]>| {
            let bounds = Aabb::from_points(points.map(|[x, y]| DVec3::new(x, y, 0.0))).size();
            if bounds.is_finite() { bounds.x * bounds.y } else { 0.0 }
        };
        let base = area(&mut points.iter().filter(|p| along(p) < low + 0.02 * (high - low)).map(across));
        base / area(&mut points.iter().map(across)).max(1e-12)
    };
    let (y, z) = (standing(1), standing(2));
    let shares =
        format!("it stands on {:.0} % of its footprint with +y up, on {:.0} % with +z up", 100.0 * y, 100.0 * z);
    let size = Aabb::from_points(points.iter().copied()).size() / bounds(raw).size().max_element();
    if let Some(prior) = prior.filter(|_| (z - y).abs() <= EQUAL_MARGIN && (size.y - size.z).abs() > EQUAL_MARGIN) {
        let is_y = (size.y - prior.height_share).abs() <= (size.z - prior.height_share).abs();
        return (if is_y { Up::Y } else { Up::Z }, format!("{shares}; this gives the height of a {}", prior.category));
    }
    if z > y + EQUAL_MARGIN { (Up::Z, shares) } else { (Up::Y, shares) }
}

/// Bounding box of the visual surfaces with joints at 0; of the collision geometry if there are none.
pub fn bounds(raw: &RawObject) -> Aabb {
    let visible = Aabb::from_points(raw.all_surfaces().positions);
    if visible.size().is_finite() && visible.min.x <= visible.max.x {
        return visible;
    }
    raw.links.iter().zip(raw.link_poses()).fold(Aabb::EMPTY, |bounds, (link, pose)| {
        link.collision.iter().fold(bounds, |bounds, collision| match collision {
            RawCollision::Piece(piece) => bounds.union(&Aabb::from_pieces(&pose, [piece])),
            RawCollision::HullOf(points) => points.iter().fold(bounds, |b, p| b.including(pose.transform_point(*p))),
            RawCollision::Mesh(mesh) => {
                mesh.positions.iter().fold(bounds, |b, p| b.including(pose.transform_point(*p)))
            }
        })
    })
}

/// Moves an object so that its bounds are centred above the origin with their lowest point at 0.
pub fn center(raw: &mut RawObject) {
    let bounds = bounds(raw);
    let base = bounds.center().with_z(bounds.min.z);
    move_root(raw, &Pose::from_position(-base));
}

/// Transforms the root link and the joints attached to it.
pub fn move_root(raw: &mut RawObject, new_from_old: &Pose) {
    let transform = DMat4::from_rotation_translation(new_from_old.rotation, new_from_old.position);
    for (index, link) in raw.links.iter_mut().enumerate() {
        if index > 0 {
            if let Some(joint) = link.joint.as_mut().filter(|joint| joint.parent == 0) {
                joint.parent_from_joint = *new_from_old * joint.parent_from_joint;
            }
            continue;
        }
        for surface in &mut link.surfaces {
            surface.mesh = std::mem::take(&mut surface.mesh).transformed(&transform);
        }
        for collision in &mut link.collision {
            match collision {
                RawCollision::Piece(piece) => piece.link_from_piece = *new_from_old * piece.link_from_piece,
                RawCollision::HullOf(points) => points.iter_mut().for_each(|p| *p = new_from_old.transform_point(*p)),
                RawCollision::Mesh(mesh) => *mesh = std::mem::take(mesh).transformed(&transform),
            }
        }
        if let Some(mass) = &mut link.mass {
            *mass = transformed_mass(mass, new_from_old);
        }
    }
}

/// Transforms mass properties to another frame.
pub fn transformed_mass(mass: &MassProperties, new_from_old: &Pose) -> MassProperties {
    let rotation = glam::DMat3::from_quat(new_from_old.rotation);
    MassProperties {
        mass_kg: mass.mass_kg,
        center: new_from_old.transform_point(mass.center),
        inertia: rotation * mass.inertia * rotation.transpose(),
    }
}

fn scale_by(raw: &mut RawObject, scale: f64) {
    if scale == 1.0 {
        return;
    }
    let transform = DMat4::from_scale(DVec3::splat(scale));
    for link in &mut raw.links {
        if let Some(Joint { kind, parent_from_joint, range, spring_reference, .. }) = &mut link.joint {
            parent_from_joint.position *= scale;
            if *kind == JointKind::Prismatic {
                *range = range.map(|value| value * scale);
                *spring_reference *= scale;
            }
        }
        for surface in &mut link.surfaces {
            surface.mesh = std::mem::take(&mut surface.mesh).transformed(&transform);
        }
        for collision in &mut link.collision {
            match collision {
                RawCollision::Piece(piece) => scale_piece(piece, scale),
                RawCollision::HullOf(points) => points.iter_mut().for_each(|point| *point *= scale),
                RawCollision::Mesh(mesh) => *mesh = std::mem::take(mesh).transformed(&transform),
            }
        }
        // A mass stated for another size is invalid after scaling.
        link.mass = None;
    }
}

fn scale_piece(piece: &mut Piece, scale: f64) {
    piece.link_from_piece.position *= scale;
    match &mut piece.shape {
        Shape::Box { half_extents } => *half_extents *= scale,
        Shape::Sphere { radius } => *radius *= scale,
        Shape::Ellipsoid { radii } => *radii *= scale,
        Shape::Cylinder { radius, half_height } => (*radius, *half_height) = (*radius * scale, *half_height * scale),
        Shape::Capsule { radius, half_length } => (*radius, *half_length) = (*radius * scale, *half_length * scale),
        Shape::Hull { points } => points.iter_mut().for_each(|point| *point *= scale),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clean::tests::{cuboid, object};
    use crate::typical_sizes;

    #[test]
    fn units_are_found_from_sizes() {
        let mug = typical_sizes::of_name("mug");
        for (longest, is_metric, prior, scale) in [
            (0.1, true, None, 1.0),
            (10.0, false, mug, 0.01),
            (100.0, false, mug, 0.001),
            (0.11, false, mug, 1.0),
            (20.0, false, None, 0.01),
            (250.0, false, None, 0.001),
            (0.75, false, None, 1.0),
        ] {
            assert_eq!(unit(longest, is_metric, prior).0, scale, "{longest} {is_metric}");
        }
        // A normalised size becomes the typical size of the category.
        let (scale, ..) = unit(1.9, false, mug);
        assert!((1.9 * scale - mug.unwrap().longest_m).abs() < 1e-9 || UNITS.iter().any(|(_, unit)| *unit == scale));
    }

    #[test]
    fn objects_stand_on_their_base_at_the_origin() {
        // A stack with its broad end at -y stands with +y up.
        let mut mesh = cuboid(DVec3::new(-1.0, -1.0, -1.0), DVec3::new(1.0, -0.5, 1.0));
        mesh.append(&cuboid(DVec3::new(-0.2, -0.5, -0.2), DVec3::new(0.2, 1.0, 0.2)));
        let mut raw = object(mesh);
        raw.up = Up::Unknown;
        let mut guesses = Vec::new();
        upright(&mut raw, None, None, &mut guesses);
        center(&mut raw);
        let bounds = bounds(&raw);
        assert!(bounds.min.abs_diff_eq(DVec3::new(-1.0, -1.0, 0.0), 1e-9), "{bounds:?}");
        assert!(bounds.max.abs_diff_eq(DVec3::new(1.0, 1.0, 2.0), 1e-9), "{bounds:?}");
        assert_eq!(guesses[0].value, "+y");
        // A carton lies as stably as it stands: the typical height decides.
        let mut carton = object(cuboid(DVec3::ZERO, DVec3::new(0.07, 0.07, 0.2)));
        carton.up = Up::Unknown;
        upright(&mut carton, None, typical_sizes::of_name("milk carton"), &mut guesses);
        assert_eq!(guesses[1].value, "+z", "{guesses:?}");
    }
}
