//! Ray casting through a union of convex pieces.

use genmanip_core::{Piece, Shape};
use glam::{DMat3, DVec3};

use crate::collision::GeometryError;
use crate::hull::convex_hull;
use crate::rigid::Rigid;

/// An object as a union of convex pieces, for ray casting.
pub(crate) struct Solid {
    pieces: Vec<RayPiece>,
}

/// An interval of the line `origin + t * direction` inside the solid: `t` and outward unit normals where it enters and
/// leaves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Chord {
    pub(crate) enter: f64,
    pub(crate) leave: f64,
    pub(crate) enter_normal: DVec3,
    pub(crate) leave_normal: DVec3,
}

struct RayPiece {
    piece_from_object: Rigid,
    object_from_piece: DMat3,
    surface: Surface,
}

/// Surface of a piece in its own frame; cylinders and capsules lie along z.
enum Surface {
    /// Outward unit normals and distances from the origin (m).
    Planes(Vec<(DVec3, f64)>),
    /// Semi-axes along x, y and z (m).
    Ellipsoid(DVec3),
    Cylinder {
        radius: f64,
        half_height: f64,
    },
    Capsule {
        radius: f64,
        half_length: f64,
    },
}

/// Minimum hull volume [m³]: 1 mm² times 1 µm.
const MIN_VOLUME_M3: f64 = 1e-12;

impl Solid {
    /// Builds the solid from pieces in the object frame; a piece without volume is an error.
    pub(crate) fn new(pieces: &[Piece]) -> Result<Self, GeometryError> {
        let ray_piece = |(index, piece): (usize, &Piece)| {
            let object_from_piece = Rigid::from(&piece.link_from_piece);
            let flat = || GeometryError { owner: "object".into(), index, what: "its corners span no volume".into() };
            Ok(RayPiece {
                piece_from_object: object_from_piece.inverse(),
                object_from_piece: object_from_piece.rotation,
                surface: Surface::new(&piece.shape).ok_or_else(flat)?,
            })
        };
        Ok(Self { pieces: pieces.iter().enumerate().map(ray_piece).collect::<Result<_, _>>()? })
    }

    /// Intervals of a line inside the solid, in order; intervals closer than `gap`, in the line's
    /// parameter, are merged.
    pub(crate) fn chords(&self, origin: DVec3, direction: DVec3, gap: f64) -> Vec<Chord> {
        let mut chords: Vec<Chord> = self.pieces.iter().filter_map(|piece| piece.chord(origin, direction)).collect();
        chords.sort_by(|a, b| a.enter.total_cmp(&b.enter));
        let mut joined: Vec<Chord> = Vec::new();
        for chord in chords {
            match joined.last_mut() {
                Some(last) if chord.enter <= last.leave + gap => {
                    if chord.leave > last.leave {
                        (last.leave, last.leave_normal) = (chord.leave, chord.leave_normal);
                    }
                }
                _ => joined.push(chord),
            }
        }
        joined
    }
}

impl RayPiece {
    fn chord(&self, origin: DVec3, direction: DVec3) -> Option<Chord> {
        let from = self.piece_from_object.point(origin);
        let along = self.piece_from_object.rotation * direction;
        let chord = self.surface.chord(from, along)?;
        (chord.leave - chord.enter > 1e-6).then(|| Chord {
            enter_normal: self.object_from_piece * chord.enter_normal,
            leave_normal: self.object_from_piece * chord.leave_normal,
            ..chord
        })
    }
}

impl Surface {
    fn new(shape: &Shape) -> Option<Self> {
        let axes = [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z];
        Some(match shape {
            Shape::Box { half_extents } => {
                Self::Planes(axes.iter().map(|axis| (*axis, axis.abs().dot(*half_extents))).collect())
            }
            Shape::Sphere { radius } => Self::Ellipsoid(DVec3::splat(*radius)),
            Shape::Ellipsoid { radii } => Self::Ellipsoid(*radii),
            Shape::Cylinder { radius, half_height } => Self::Cylinder { radius: *radius, half_height: *half_height },
            Shape::Capsule { radius, half_length } => Self::Capsule { radius: *radius, half_length: *half_length },
            Shape::Hull { points } => {
                let (corners, triangles) = convex_hull(points).ok()?;
                let middle = corners.iter().sum::<DVec3>() / corners.len().max(1) as f64;
                let volume = |triangle: &[u32; 3]| {
                    let [a, b, c] = triangle.map(|index| corners[index as usize] - middle);
                    a.dot(b.cross(c)).abs() / 6.0
                };
                if triangles.iter().map(volume).sum::<f64>() < MIN_VOLUME_M3 {
                    return None;
                }
                let plane = |triangle: &[u32; 3]| {
                    let [a, b, c] = triangle.map(|index| corners[index as usize]);
                    let normal = (b - a).cross(c - a).try_normalize()?;
                    let normal = if normal.dot(a - middle) < 0.0 { -normal } else { normal };
                    Some((normal, normal.dot(a)))
                };
                Self::Planes(triangles.iter().filter_map(plane).collect())
            }
        })
    }

    fn chord(&self, from: DVec3, along: DVec3) -> Option<Chord> {
        match self {
            Self::Planes(planes) => clip_planes(planes, from, along),
            Self::Ellipsoid(radii) => {
                let (enter, leave) = clip_unit_sphere(from / *radii, along / *radii)?;
                let normal = |t: f64| ((from + along * t) / (*radii * *radii)).normalize_or_zero();
                Some(Chord { enter, leave, enter_normal: normal(enter), leave_normal: normal(leave) })
            }
            Self::Cylinder { radius, half_height } => {
                let caps = [(DVec3::Z, *half_height), (DVec3::NEG_Z, *half_height)];
                let ends = clip_planes(&caps, from, along)?;
                let tube = clip_cylinder(*radius, from, along)?;
                intersect(ends, tube)
            }
            Self::Capsule { radius, half_length } => {
                let caps = [(DVec3::Z, *half_length), (DVec3::NEG_Z, *half_length)];
                let tube = clip_planes(&caps, from, along).zip(clip_cylinder(*radius, from, along));
                let tube = tube.and_then(|(ends, tube)| intersect(ends, tube));
                let ball = |z: f64| {
                    let center = DVec3::Z * z;
                    let (enter, leave) = clip_unit_sphere((from - center) / *radius, along / *radius)?;
                    let normal = |t: f64| (from + along * t - center).normalize_or_zero();
                    Some(Chord { enter, leave, enter_normal: normal(enter), leave_normal: normal(leave) })
                };
                [tube, ball(*half_length), ball(-half_length)].into_iter().flatten().reduce(|a, b| {
                    let (first, last) =
                        (if a.enter <= b.enter { a } else { b }, if a.leave >= b.leave { a } else { b });
                    Chord { leave: last.leave, leave_normal: last.leave_normal, ..first }
                })
            }
        }
    }
}

fn clip_planes(planes: &[(DVec3, f64)], from: DVec3, along: DVec3) -> Option<Chord> {
    let mut chord =
        Chord { enter: f64::NEG_INFINITY, leave: f64::INFINITY, enter_normal: DVec3::ZERO, leave_normal: DVec3::ZERO };
    for (normal, offset) in planes {
        let (speed, left) = (normal.dot(along), offset - normal.dot(from));
        if speed.abs() < 1e-12 {
            if left < 0.0 {
                return None;
            }
        } else if speed > 0.0 && left / speed < chord.leave {
            (chord.leave, chord.leave_normal) = (left / speed, *normal);
        } else if speed < 0.0 && left / speed > chord.enter {
            (chord.enter, chord.enter_normal) = (left / speed, *normal);
        }
    }
    (chord.enter < chord.leave).then_some(chord)
}

fn clip_cylinder(radius: f64, from: DVec3, along: DVec3) -> Option<Chord> {
    let flat = DVec3::new(1.0, 1.0, 0.0);
    let (a, b) = (from * flat / radius, along * flat / radius);
    if b.length_squared() < 1e-18 {
        let inside = a.length_squared() < 1.0;
        return inside.then_some(Chord {
            enter: f64::NEG_INFINITY,
            leave: f64::INFINITY,
            enter_normal: DVec3::ZERO,
            leave_normal: DVec3::ZERO,
        });
    }
    let (enter, leave) = clip_unit_sphere(a, b)?;
    let normal = |t: f64| (a + b * t).normalize_or_zero();
    Some(Chord { enter, leave, enter_normal: normal(enter), leave_normal: normal(leave) })
}

fn clip_unit_sphere(from: DVec3, along: DVec3) -> Option<(f64, f64)> {
    let (a, b, c) = (along.length_squared(), from.dot(along), from.length_squared() - 1.0);
    let root = b * b - a * c;
    (root > 0.0 && a > 0.0).then(|| ((-b - root.sqrt()) / a, (-b + root.sqrt()) / a))
}

fn intersect(a: Chord, b: Chord) -> Option<Chord> {
    let (enter, enter_normal) = if a.enter >= b.enter { (a.enter, a.enter_normal) } else { (b.enter, b.enter_normal) };
    let (leave, leave_normal) = if a.leave <= b.leave { (a.leave, a.leave_normal) } else { (b.leave, b.leave_normal) };
    (enter < leave).then_some(Chord { enter, leave, enter_normal, leave_normal })
}
