//! Exact evaluation of grasp proposals: clearance, contacts and score.

use genmanip_core::{Grasp, Pose};
use glam::DVec3;

use super::gripper::Gripper;
use super::propose::Proposal;
use super::settings::GraspSettings;
use super::target::{GraspTarget, squareness};
use crate::collision::GeometryError;
use crate::collision::convex::{self, Convex, Separation};
use crate::rigid::Rigid;

/// Object, table and gripper for exact checks, object frame.
pub(super) struct GraspEvaluator<'a> {
    target: &'a GraspTarget<'a>,
    gripper: &'a Gripper,
    settings: &'a GraspSettings,
    object: Vec<Convex>,
    /// Unit vector up from the table.
    up: DVec3,
    /// Support height: value of `up · point` on the table (m).
    table: f64,
}

impl<'a> GraspEvaluator<'a> {
    pub(super) fn new(
        target: &'a GraspTarget<'a>,
        gripper: &'a Gripper,
        settings: &'a GraspSettings,
    ) -> Result<Self, GeometryError> {
        let object = Convex::all("object", target.pieces)?;
        let up = (target.world_from_object.rotation.inverse() * DVec3::Z).normalize();
        let table = target.table_height - target.world_from_object.position.z;
        Ok(Self { target, gripper, settings, object, up, table })
    }

    /// Evaluates a proposal after closing the fingers; `None` without clearance or contact.
    pub(super) fn assess(&self, proposal: &Proposal) -> Option<Grasp> {
        let mut tcp = Rigid::from(&proposal.object_from_tcp);
        let approach = tcp.rotation.z_axis;
        let opening = (proposal.width + 2.0 * self.settings.opening_clearance).min(self.gripper.max_width);
        // Move out of the table as long as the contacts stay on the pads.
        let lift = self.settings.table_clearance - (self.lowest(&tcp, opening) - self.table);
        if lift > 0.0 {
            let back = lift / -approach.dot(self.up).min(-0.05);
            if back > self.gripper.pad_size.z / 2.0 - 0.001 {
                return None;
            }
            tcp.translation -= approach * back;
        }
        if !self.fits(&tcp, opening) {
            return None;
        }
        let (left, right) = (self.touch(&tcp, 0, opening)?, self.touch(&tcp, 1, opening)?);
        tcp.translation += tcp.rotation.y_axis * (0.25 * (left - right));
        let width = 0.5 * (left + right);
        let fits_again = (left - right).abs() < 0.002 || self.fits(&tcp, opening);
        if width > self.gripper.max_width - self.settings.width_clearance || !fits_again {
            return None;
        }
        let contact = self.contact(&tcp, width, proposal.antipodality);
        let cone = (1.0 + self.settings.friction * self.settings.friction).sqrt().recip();
        if contact.antipodality < cone {
            return None;
        }
        let score = self.score(&tcp, width, &contact);
        let pose = Pose::from_axes(tcp.translation, tcp.rotation.x_axis, tcp.rotation.y_axis, tcp.rotation.z_axis);
        Some(Grasp { pose, width, score })
    }

    /// Quick rejection: a surface point is inside the bounds of the hand.
    pub(super) fn palm_is_blocked(&self, proposal: &Proposal) -> bool {
        let tcp = Rigid::from(&proposal.object_from_tcp).inverse();
        let hand = &self.gripper.hand_bounds;
        // The hand may still be raised off the table by up to half a pad.
        let low = hand.max.z - self.gripper.pad_size.z / 2.0;
        let stride = (self.target.surface.len() / 200).max(1);
        self.target.surface.iter().step_by(stride).any(|(point, _)| {
            let p = tcp.point(*point);
            p.z < low && p.z > hand.min.z && p.x.abs() < hand.max.x * 0.9 && p.y.abs() < hand.max.y * 0.9
        })
    }

    /// True if the approach angle of a grasp is allowed at the object's pose.
    pub(super) fn is_upright(&self, grasp: &Grasp) -> bool {
        let top = self.object.iter().map(|piece| piece.support(self.up).dot(self.up)).fold(f64::NEG_INFINITY, f64::max);
        -grasp.approach().dot(self.up) >= self.settings.largest_tilt(top - self.table).cos()
    }

    /// True if the open gripper has clearance at a grasp.
    pub(super) fn is_clear(&self, grasp: &Grasp) -> bool {
        let opening = self.gripper.opening_for(grasp, self.settings.opening_clearance);
        self.fits(&Rigid::from(&grasp.pose), opening)
    }

    /// Lowest `up · point` of hand and open fingers (m).
    fn lowest(&self, object_from_tcp: &Rigid, opening: f64) -> f64 {
        let gripper = self.gripper;
        let fingers = gripper.fingers.iter().map(|finger| (&finger.pieces, finger.place(opening)));
        let groups = std::iter::once((&gripper.hand, gripper.tcp_from_hand)).chain(fingers);
        let mut lowest = f64::INFINITY;
        for (pieces, tcp_from_group) in groups {
            let object_from_group = *object_from_tcp * tcp_from_group;
            let down = object_from_group.rotation.transpose() * -self.up;
            for piece in pieces {
                lowest = lowest.min(object_from_group.point(piece.support(down)).dot(self.up));
            }
        }
        lowest
    }

    /// True if hand and open fingers have clearance to object and table.
    fn fits(&self, object_from_tcp: &Rigid, opening: f64) -> bool {
        let gripper = self.gripper;
        let clearance = self.settings.object_clearance;
        self.lowest(object_from_tcp, opening) >= self.table + 0.5 * self.settings.table_clearance
            && gripper
                .fingers
                .iter()
                .all(|finger| !self.touches(&finger.pieces, &(*object_from_tcp * finger.place(opening)), clearance))
            && !self.touches(&gripper.hand, &(*object_from_tcp * gripper.tcp_from_hand), clearance)
    }

    fn touches(&self, pieces: &[Convex], object_from_pieces: &Rigid, margin: f64) -> bool {
        pieces.iter().any(|piece| {
            let center = object_from_pieces.point(piece.ball.center);
            self.object.iter().any(|other| {
                let reach = piece.ball.radius + other.ball.radius + margin;
                center.distance_squared(other.ball.center) <= reach * reach
                    && convex::closer_than(other, piece, &Rigid::IDENTITY, object_from_pieces, margin)
            })
        })
    }

    /// Opening (m) at which a closing finger touches the object; `None` if it never does.
    ///
    /// Conservative advancement: each step closes by the free distance, so thin walls are not skipped.
    fn touch(&self, object_from_tcp: &Rigid, finger: usize, opening: f64) -> Option<f64> {
        const CONTACT: f64 = 1e-4;
        let finger = &self.gripper.fingers[finger];
        let mut width = opening;
        for _ in 0..40 {
            let distance = self.distance(&finger.pieces, &(*object_from_tcp * finger.place(width)), width / 2.0)?;
            if distance < CONTACT {
                return Some(width);
            }
            // A finger moves by half the change of opening.
            width -= 2.0 * distance;
            if width <= 0.0 {
                return None;
            }
        }
        Some(width)
    }

    /// Distance of pieces to the object (m) if it is at most `limit`; otherwise `None`.
    fn distance(&self, pieces: &[Convex], object_from_pieces: &Rigid, limit: f64) -> Option<f64> {
        let mut nearest = limit;
        let mut found = false;
        for piece in pieces {
            let center = object_from_pieces.point(piece.ball.center);
            for other in &self.object {
                let reach = piece.ball.radius + other.ball.radius + nearest;
                if center.distance_squared(other.ball.center) <= reach * reach
                    && let Separation::Within(distance) =
                        convex::separation(other, piece, &Rigid::IDENTITY, object_from_pieces, nearest)
                {
                    (nearest, found) = (distance, true);
                }
            }
        }
        found.then_some(nearest)
    }

    /// Contact quality from the surface samples under the pads.
    fn contact(&self, object_from_tcp: &Rigid, width: f64, antipodality: f64) -> Contact {
        let tcp_from_object = object_from_tcp.inverse();
        let half = self.gripper.pad_size * 0.5;
        // Per side: sum of alignment, count, lowest and highest position along the finger.
        let mut sides = [(0.0, 0_u32, f64::INFINITY, f64::NEG_INFINITY); 2];
        for (point, normal) in self.target.surface {
            let p = tcp_from_object.point(*point);
            let off_pad = (p.y.abs() - width / 2.0).abs();
            if p.x.abs() <= half.y && p.z.abs() <= half.z && off_pad <= 0.0015 {
                let squareness = (tcp_from_object.rotation * *normal).y * p.y.signum();
                if squareness > 0.0 {
                    let side = &mut sides[usize::from(p.y < 0.0)];
                    *side = (side.0 + squareness, side.1 + 1, side.2.min(p.z), side.3.max(p.z));
                }
            }
        }
        let seen = sides.iter().all(|side| side.1 >= 3);
        let squareness = sides.iter().map(|side| side.0 / f64::from(side.1.max(1))).fold(1.0, f64::min);
        let depth = sides.iter().map(|side| ((side.3 - side.2) / self.gripper.pad_size.z).max(0.0)).fold(1.0, f64::min);
        Contact { antipodality: if seen { squareness } else { antipodality }, depth: if seen { depth } else { 0.1 } }
    }

    fn score(&self, tcp: &Rigid, width: f64, contact: &Contact) -> f64 {
        let (w, s) = (&self.settings.weights, self.settings);
        let widest = self.gripper.max_width - s.width_clearance;
        let to_center = self.target.center_of_mass - tcp.translation;
        let lever = (to_center - tcp.rotation.y_axis * to_center.dot(tcp.rotation.y_axis)).length();
        let terms = [
            (w.antipodality, squareness(contact.antipodality, s.friction)),
            (w.contact_depth, contact.depth),
            (w.width_margin, (widest - width) / 0.01),
            (w.lever, 1.0 - lever / s.longest_lever),
            (w.downward, -tcp.rotation.z_axis.dot(self.up)),
        ];
        let total: f64 = terms.iter().map(|(weight, _)| weight).sum();
        terms.iter().map(|(weight, term)| weight * term.clamp(0.0, 1.0)).sum::<f64>() / total.max(1e-12)
    }
}

struct Contact {
    antipodality: f64,
    depth: f64,
}
