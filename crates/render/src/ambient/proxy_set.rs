//! AO and reflection proxies of all bodies of a frame.

use genmanip_core::CameraMount;
use glam::{Vec3, Vec3A};

use super::cavity::{Cavity, cavity_of, enclose, entering};
use super::proxies::{AoProxy, FULLNESS, LEAST, THINNEST_M, occlude, placed, stretched, unoccluded_lamp};
use super::reflection_proxies::{ReflectionProxy, held, in_gripper};
use crate::gbuffer::points::Points;
use crate::job::FrameState;
use crate::scene::assets::{Pad, RenderAssets};
use crate::scene::body_shape::BodyShape;
use crate::scene::material::Material;
use crate::simd::BatchColumn;

/// Share of the key light that a body and the surface around it lose in full shadow of other bodies. Fitted to
/// path-traced images.
const SHADED: f32 = 0.55;

/// AO proxies of all bodies of a frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct AoProxies {
    bodies: Vec<AoProxy>,
    /// Finger pads, for wrist cameras.
    pads: Vec<(usize, ReflectionProxy)>,
    /// True if bodies occlude each other. Only for wrist cameras, which are close to objects, below the gripper, and
    /// never continue a frame.
    count: bool,
}

impl AoProxies {
    /// Places the proxies of a frame, with mean colours by body, for a camera mount and a light direction; transparent
    /// bodies do not occlude.
    pub fn place(
        &mut self,
        assets: &RenderAssets,
        colors: &[Vec3A],
        frame: &FrameState,
        mount: CameraMount,
        to_light: Vec3A,
    ) {
        self.count = mount == CameraMount::Hand;
        self.bodies.clear();
        for (body, pose) in frame.body_poses.iter().enumerate() {
            let Some(&BodyShape { low, high, is_box, has_inside, is_concave }) = assets.shape_of(body) else {
                continue;
            };
            let half = ((high - low) * (0.5 * FULLNESS)).max(Vec3::splat(THINNEST_M));
            let middle = (low + high) * 0.5;
            let (center, axes) = placed(pose, middle, half);
            let volume = half.x * half.y * half.z;
            // At a distance a body covers at most its largest cross-section.
            let reach = (volume / half.min_element() / LEAST).sqrt();
            let color = colors.get(body).copied().unwrap_or(Vec3A::ZERO).to_array();
            self.bodies.push(AoProxy {
                body,
                center,
                axes,
                volume,
                color,
                reach,
                middle,
                to_lamp: stretched(axes, to_light).to_array(),
                lit: 1.0,
                entering: 0.0,
                is_box,
                has_inside,
                is_concave,
                in_gripper: 0.0,
            });
        }
        self.pads.clear();
        if self.count {
            let at_pose = |pad: &Pad| (pad.body, ReflectionProxy::pad(pad, &frame.body_poses[pad.body]));
            self.pads.extend(assets.pads().iter().map(at_pose));
        }
        for index in 0..self.bodies.len() {
            let own = &self.bodies[index];
            let (robot, others) = (self.robot(assets.robot_bodies()), if self.count { &*self.bodies } else { &[] });
            let is_free = self.count && own.body >= assets.robot_bodies();
            let (entering, in_gripper) = (entering(own, others), if is_free { in_gripper(own, robot) } else { 0.0 });
            // Arm and held object hang in the light, whatever shadows their proxies cast on each other.
            let is_arm = own.body < assets.robot_bodies() || in_gripper > 0.0;
            let lit = if is_arm { 1.0 } else { self.lit(own.body, own.center()) };
            let lit = 1.0 - SHADED * (1.0 - lit);
            let own = &mut self.bodies[index];
            (own.lit, own.entering, own.in_gripper) = (lit, entering, in_gripper);
        }
    }

    fn of_body(&self, body: usize) -> Option<&AoProxy> {
        // Proxies are sorted by body.
        let index = self.bodies.binary_search_by_key(&body, |proxy| proxy.body).ok()?;
        Some(&self.bodies[index])
    }

    /// All proxies.
    pub fn bodies(&self) -> &[AoProxy] {
        &self.bodies
    }

    /// Share of the key light at a position that the other bodies leave.
    fn lit(&self, but: usize, place: Vec3A) -> f32 {
        unoccluded_lamp(if self.count { &self.bodies } else { &[] }, but, place.to_array())
    }

    /// Share of the key light on a body and the surface around it that other bodies leave.
    pub fn lit_of(&self, body: usize) -> f32 {
        self.of_body(body).map_or(1.0, |own| own.lit)
    }

    /// True if bodies occlude each other.
    pub fn count(&self) -> bool {
        self.count
    }

    /// True if ambient light at resting points may differ from that of another frame.
    pub fn differ(&self, before: &Self) -> bool {
        (self.count || before.count) && self != before
    }

    /// Multiplies ambient shares at points of a body by the occlusion by other bodies and by its own cavity.
    pub fn darken(&self, points: &Points, of_body: Option<usize>, share: &mut BatchColumn) {
        if let Some(own) = of_body.and_then(|body| self.of_body(body)) {
            enclose(own, points, share);
        }
        if !self.count {
            return;
        }
        let (mut low, mut high) = (Vec3A::INFINITY, Vec3A::NEG_INFINITY);
        for i in 0..points.count {
            let place = Vec3A::new(points.place[0][i], points.place[1][i], points.place[2][i]);
            (low, high) = (low.min(place), high.max(place));
        }
        for proxy in self.bodies.iter().filter(|proxy| Some(proxy.body) != of_body) {
            let center = proxy.center();
            if proxy.reaches(center.distance_squared(center.clamp(low, high))) {
                occlude(proxy, points, share);
            }
        }
    }

    /// Proxies of the robot, whose bodies come first.
    fn robot(&self, robot_bodies: usize) -> &[AoProxy] {
        &self.bodies[..self.bodies.partition_point(|other| other.body < robot_bodies)]
    }

    /// The lit cavity of a body, if light enters it.
    pub fn cavity_of(&self, body: usize) -> Option<Cavity> {
        cavity_of(self.of_body(body)?)
    }

    /// Share of a body's bounce light that returns to it: less in the dark gripper, all of it inside a cavity.
    pub fn bounce_of(&self, body: usize) -> f32 {
        self.of_body(body).filter(|own| !own.is_concave).map_or(1.0, |own| 1.0 - own.in_gripper)
    }

    /// Reflection proxies for the metal of a robot's body, the farther first: the held object and the finger's pad.
    pub fn reflection_proxies_of(&self, body: usize) -> [Option<ReflectionProxy>; 2] {
        [held(&self.bodies), self.pads.iter().find(|(own, _)| *own == body).map(|(_, pad)| *pad)]
    }
}

/// Area-weighted mean linear colours of the bodies' opaque parts.
pub(crate) fn colors_of(assets: &RenderAssets, surfaces: &[Material]) -> Vec<Vec3A> {
    let mut sums = vec![(Vec3A::ZERO, 1e-12); assets.body_count()];
    for (part, surface) in assets.parts.iter().zip(surfaces) {
        let Some((color, area)) = part.body.and_then(|body| sums.get_mut(body)) else { continue };
        if surface.opacity >= 1.0 {
            let own = part.mesh.area();
            *color += surface.mean_color() * own;
            *area += own;
        }
    }
    sums.into_iter().map(|(color, area)| color / area).collect()
}
