//! Canonical bytes of what physics depends on, hashed.

use sha2::{Digest, Sha256};

use crate::{MassProperties, Piece, Pose, Shape};

/// A hash under way. Every entry is preceded by its kind and length, so that no two sequences look alike.
#[derive(Clone, Debug)]
pub(crate) struct Fingerprint(Sha256);

impl Fingerprint {
    /// A hash of something of a kind.
    pub fn new(kind: &str) -> Self {
        let mut print = Self(Sha256::new());
        print.text(kind);
        print
    }

    /// A text.
    pub fn text(&mut self, text: &str) -> &mut Self {
        self.0.update([b't']);
        self.0.update((text.len() as u64).to_le_bytes());
        self.0.update(text.as_bytes());
        self
    }

    /// A number, rounded to a billionth.
    pub fn number(&mut self, value: f64) -> &mut Self {
        self.numbers(&[value])
    }

    /// Numbers, each rounded to a billionth.
    pub fn numbers(&mut self, values: &[f64]) -> &mut Self {
        self.0.update([b'n']);
        self.0.update((values.len() as u64).to_le_bytes());
        for value in values {
            self.0.update(((value * 1e9).round() as i64).to_le_bytes());
        }
        self
    }

    /// A pose.
    pub fn pose(&mut self, pose: &Pose) -> &mut Self {
        self.numbers(&pose.position.to_array()).numbers(&pose.to_wxyz_array())
    }

    /// Mass, its centre and inertia.
    pub fn mass(&mut self, mass: &MassProperties) -> &mut Self {
        self.number(mass.mass_kg).numbers(&mass.center.to_array()).numbers(&mass.inertia.to_cols_array())
    }

    /// Convex bodies with their poses.
    pub fn pieces(&mut self, pieces: &[Piece]) -> &mut Self {
        self.number(pieces.len() as f64);
        for piece in pieces {
            self.pose(&piece.link_from_piece);
            match &piece.shape {
                Shape::Box { half_extents } => self.text("box").numbers(&half_extents.to_array()),
                Shape::Sphere { radius } => self.text("sphere").number(*radius),
                Shape::Ellipsoid { radii } => self.text("ellipsoid").numbers(&radii.to_array()),
                Shape::Cylinder { radius, half_height } => self.text("cylinder").numbers(&[*radius, *half_height]),
                Shape::Capsule { radius, half_length } => self.text("capsule").numbers(&[*radius, *half_length]),
                Shape::Hull { points } => {
                    let numbers: Vec<f64> = points.iter().flat_map(|point| point.to_array()).collect();
                    self.text("hull").numbers(&numbers)
                }
            };
        }
        self
    }

    /// Twelve hexadecimal digits.
    pub fn finish(self) -> String {
        self.0.finalize().iter().take(6).map(|byte| format!("{byte:02x}")).collect()
    }
}
