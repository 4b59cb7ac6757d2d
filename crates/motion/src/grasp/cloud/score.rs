//! Features of a grasp and its success probability.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::filter::Cloud;
use super::points::Local;
use crate::grasp::Gripper;

/// Points within this distance of the outermost one are in contact (m).
const CONTACT_M: f64 = 0.0015;
/// Points within this distance of the outermost one determine the contact's slope (m).
const SLOPE_M: f64 = 0.004;

/// Contact patch of one pad.
#[derive(Clone, Copy, Debug)]
pub(super) struct Patch {
    /// Position along the closing direction (m).
    pub(super) c: f64,
    /// Lateral offset of the patch from the pad's centre (m).
    h: f64,
    /// Distance of the patch's centre behind the tips (m).
    depth: f64,
    /// Extents of the patch across and along the finger (m).
    size: [f64; 2],
    /// Tangent of the angle between surface and pad, from a plane fit near the contact.
    slope: f64,
    /// Share of estimated points among the points in contact, 0-1.
    guessed: f64,
}

/// Contact patches of both pads.
#[derive(Clone, Copy, Debug)]
pub(super) struct Contacts {
    pub(super) low: Patch,
    pub(super) high: Patch,
}

impl Contacts {
    /// Contacts of flat pads closed on points between them, sorted along the closing direction; pads centred at `h`
    /// across, tips at `tip` along the approach.
    pub(super) fn of(points: &[Local], [low, high]: [f64; 2], h: f64, tip: f64) -> Self {
        // Each pad uses at most its own half of the distance between the pads, so that no point counts for both.
        let reach = |distance: f64| distance.min((high - low) / 2.0).max(0.0005);
        let below = |limit: f64| points.partition_point(|p| f64::from(p.c) <= low + reach(limit));
        let above = |limit: f64| points.partition_point(|p| f64::from(p.c) < high - reach(limit));
        let patch = |c: f64, contact: &[Local], near: &[Local]| Patch::of(contact, near, [c, h, tip]);
        Self {
            low: patch(low, &points[..below(CONTACT_M)], &points[..below(SLOPE_M)]),
            high: patch(high, &points[above(CONTACT_M)..], &points[above(SLOPE_M)..]),
        }
    }
}

impl Patch {
    /// Patch from the points in contact and those nearby, for a pad at `c`, centred at `h`, tip at `tip`.
    fn of(contact: &[Local], near: &[Local], [c, h, tip]: [f64; 3]) -> Self {
        let count = contact.len().max(1) as f64;
        let mut sums = [0.0; 3];
        let mut least = [f64::INFINITY; 2];
        let mut most = [f64::NEG_INFINITY; 2];
        for point in contact {
            let place = [f64::from(point.h) - h, tip - f64::from(point.a)];
            sums = [sums[0] + place[0], sums[1] + place[1], sums[2] + f64::from(point.guessed)];
            for axis in [0, 1] {
                least[axis] = least[axis].min(place[axis]);
                most[axis] = most[axis].max(place[axis]);
            }
        }
        let [h_mean, depth, guessed] = sums.map(|sum| sum / count);
        let size = [0, 1].map(|axis| (most[axis] - least[axis]).max(0.0));
        Self { c, h: h_mean, depth, size, slope: slope(near, [c, h, tip]), guessed }
    }
}

/// Tangent of the angle between pad and the least-squares plane of points, regularised towards 0; the last argument is
/// any nearby point, to which coordinates are relative.
fn slope(points: &[Local], [c0, h0, a0]: [f64; 3]) -> f64 {
    let count = points.len().max(1) as f64;
    let mut means = [0.0; 3];
    let mut products = [0.0; 5];
    for point in points {
        let (c, h, a) = (f64::from(point.c) - c0, f64::from(point.h) - h0, f64::from(point.a) - a0);
        means = [means[0] + c, means[1] + h, means[2] + a];
        let [hh, aa, ha, hc, ac] = products;
        products = [hh + h * h, aa + a * a, ha + h * a, hc + h * c, ac + a * c];
    }
    let [c, h, a] = means.map(|sum| sum / count);
    let [hh, aa, ha, hc, ac] = products.map(|sum| sum / count);
    // Regularisation of the fit: a variance corresponding to 1 mm standard deviation (m²).
    let pull = 1e-6;
    let (hh, aa, ha) = (hh - h * h + pull, aa - a * a + pull, ha - h * a);
    let (hc, ac) = (hc - h * c, ac - a * c);
    let determinant = hh * aa - ha * ha;
    let (along_h, along_a) = ((hc * aa - ac * ha) / determinant, (ac * hh - hc * ha) / determinant);
    along_h.hypot(along_a)
}

/// Features of the success model, in [0, 1] unless stated otherwise; larger is worse unless stated otherwise.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Features {
    /// Mean slope of the surface against the pads (tangent).
    pub slope: f64,
    /// Offset of the contacts: tangent of the angle between their line and the closing direction.
    pub offset: f64,
    /// Lateral offset of the worse contact as a share of the pad's half width, to the fourth power: only the pad's
    /// border is bad.
    pub off_pad: f64,
    /// Proximity of the worse contact to the tips, as a share of 9 mm, to the third power; 0 in the middle of the pad.
    pub at_tip: f64,
    /// Area of the smaller contact as a share of the pad's; larger is better.
    pub area: f64,
    /// Horizontal distance from the target's centre to the closing line [0.1 m].
    pub lever: f64,
    /// Contact distance as a share of the maximum opening.
    pub width: f64,
    /// One minus the cosine of the approach tilt.
    pub tilt: f64,
    /// Share of estimated points of the less certain contact.
    pub guessed: f64,
    /// Height of the tips above the target's centre [0.1 m].
    pub below: f64,
    /// Distance from the target's centre to the closing line [0.1 m] times the target's RMS radius [0.05 m]: a proxy of
    /// weight times lever.
    pub torque: f64,
    /// 1 with minimal pad clearance, 0 with plenty.
    pub tight: f64,
    /// Share of the pads' space that other objects hide from all cameras.
    pub unseen: f64,
    /// Share of estimated points of the more certain contact.
    pub both_guessed: f64,
}

impl Features {
    pub(super) fn new(
        cloud: &Cloud,
        gripper: &Gripper,
        contacts: &Contacts,
        tcp: DVec3,
        approach: DVec3,
        closing: DVec3,
        clearance: f64,
    ) -> Self {
        let Contacts { low, high } = contacts;
        let width = high.c - low.c;
        let pad = gripper.pad_size;
        let share = |value: f64| value.clamp(0.0, 1.0);
        let area = |patch: &Patch| (patch.size[0] / pad.y * (patch.size[1] / pad.z)).sqrt();
        let at_tip = |patch: &Patch| 1.0 - patch.depth / (pad.z / 2.0);
        let to_center = cloud.center - tcp;
        let level = DVec3::new(to_center.x, to_center.y, 0.0);
        let along = DVec3::new(closing.x, closing.y, 0.0).normalize_or_zero();
        let lever = (level - along * level.dot(along)).length() / 0.1;
        Self {
            slope: share((low.slope + high.slope) / 2.0),
            offset: share((low.h - high.h).hypot(low.depth - high.depth) / width.max(0.01)),
            off_pad: share(low.h.abs().max(high.h.abs()) / (pad.y / 2.0)).powi(4),
            at_tip: share(at_tip(low).max(at_tip(high))).powi(3),
            area: share(area(low).min(area(high))),
            lever,
            torque: to_center.cross(closing).length() / 0.1 * cloud.spread / 0.05,
            width: width / gripper.max_width,
            tilt: 1.0 + approach.z,
            guessed: share(low.guessed.max(high.guessed)),
            below: (-to_center.z).max(0.0) / 0.1,
            tight: share(1.0 - (clearance - 0.002) / 0.006),
            unseen: 0.0,
            both_guessed: share(low.guessed.min(high.guessed)),
        }
    }
}

/// Logistic regression: probability = 1 / (1 + exp(-(bias + Σ weight · feature))).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Weights {
    /// Constant term of the logit.
    pub bias: f64,
    /// Weight of [`Features::slope`].
    pub slope: f64,
    /// Weight of [`Features::offset`].
    pub offset: f64,
    /// Weight of [`Features::off_pad`].
    pub off_pad: f64,
    /// Weight of [`Features::at_tip`].
    pub at_tip: f64,
    /// Weight of [`Features::area`].
    pub area: f64,
    /// Weight of [`Features::lever`].
    pub lever: f64,
    /// Weight of [`Features::width`].
    pub width: f64,
    /// Weight of [`Features::tilt`].
    pub tilt: f64,
    /// Weight of [`Features::guessed`].
    pub guessed: f64,
    /// Weight of [`Features::below`].
    pub below: f64,
    /// Weight of [`Features::torque`].
    pub torque: f64,
    /// Weight of [`Features::tight`].
    pub tight: f64,
    /// Weight of [`Features::unseen`].
    pub unseen: f64,
    /// Weight of [`Features::both_guessed`].
    pub both_guessed: f64,
}

impl Default for Weights {
    fn default() -> Self {
        Self {
            bias: 1.75,
            slope: -1.55,
            offset: 2.36,
            off_pad: -2.40,
            at_tip: -3.16,
            area: 2.32,
            lever: 0.06,
            width: 0.51,
            tilt: -0.11,
            guessed: -0.05,
            below: -0.94,
            torque: -0.70,
            tight: -0.57,
            unseen: -2.32,
            both_guessed: -1.10,
        }
    }
}

impl Weights {
    /// Success probability of a grasp with these features.
    pub fn chance(&self, features: &Features) -> f64 {
        let f = features;
        let sum = self.bias
            + self.slope * f.slope
            + self.offset * f.offset
            + self.off_pad * f.off_pad
            + self.at_tip * f.at_tip
            + self.area * f.area
            + self.lever * f.lever
            + self.width * f.width
            + self.tilt * f.tilt
            + self.guessed * f.guessed
            + self.below * f.below
            + self.torque * f.torque
            + self.tight * f.tight
            + self.unseen * f.unseen
            + self.both_guessed * f.both_guessed;
        1.0 / (1.0 + (-sum).exp())
    }
}
