//! Ellipsoids that stand in for the bodies of a frame in ambient occlusion and key-light shadow.

use genmanip_core::CameraMount;
use glam::Vec3A;

use super::cavity::{enclose, entering};
use super::proxies::{Proxy, occlude, unoccluded_lamp, unoccluded_sky};
use crate::gbuffer::points::Points;
use crate::job::FrameState;
use crate::scene::assets::RenderAssets;
use crate::scene::material::Material;
use crate::simd::BatchColumn;

/// Share of the key light that a body and the surface around it lose in full shadow of other bodies. Fitted to
/// path-traced images.
const SHADED: f32 = 0.55;
/// Shares of the sky above a body's centre that the robot occludes: at `BESIDE` or less the body does not count as
/// held, at `BETWEEN` or more it fully does. Chosen by hand: the robot occludes less than 0.15 above objects beside the
/// gripper, more than 0.4 above objects between the fingers.
const BESIDE: f32 = 0.2;
const BETWEEN: f32 = 0.4;

/// Proxies of all bodies of a frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Proxies {
    bodies: Vec<Proxy>,
    /// True for wrist cameras, which are close to objects and below the gripper: there bodies occlude each other. For
    /// fixed cameras they do not, so that unchanged tiles of the last frame can be reused.
    count: bool,
}

impl Proxies {
    /// Places the proxies of a frame; `colors` are mean linear colours by body. Transparent bodies get no proxy, since
    /// they do not occlude.
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
            if let Some(&shape) = assets.shape_of(body) {
                let color = colors.get(body).copied().unwrap_or(Vec3A::ZERO);
                self.bodies.push(Proxy::new(body, shape, pose, color, to_light));
            }
        }
        for index in 0..self.bodies.len() {
            let own = &self.bodies[index];
            let (robot, others) = (self.robot(assets.robot_bodies()), if self.count { &*self.bodies } else { &[] });
            let is_free = self.count && own.body >= assets.robot_bodies();
            let (entering, held) = (entering(own, others), if is_free { held(own, robot) } else { 0.0 });
            // Arm and held object count as fully lit, since shadows between their coarse ellipsoids would be wrong.
            let is_arm = own.body < assets.robot_bodies() || held > 0.0;
            let lit = if is_arm { 1.0 } else { self.lit(own.body, own.center()) };
            let lit = 1.0 - SHADED * (1.0 - lit);
            let own = &mut self.bodies[index];
            (own.lit, own.entering, own.held) = (lit, entering, held);
        }
    }

    fn of_body(&self, body: usize) -> Option<&Proxy> {
        // Proxies are sorted by body.
        let index = self.bodies.binary_search_by_key(&body, |proxy| proxy.body).ok()?;
        Some(&self.bodies[index])
    }

    /// Proxies of all bodies, sorted by body index.
    pub fn bodies(&self) -> &[Proxy] {
        &self.bodies
    }

    /// Share of the key light at a position that no body except `but` occludes; 1 for fixed cameras.
    fn lit(&self, but: usize, place: Vec3A) -> f32 {
        unoccluded_lamp(if self.count { &self.bodies } else { &[] }, but, place.to_array())
    }

    /// Share of the key light on a body and the surface around it that other bodies do not occlude; 1 without a proxy.
    pub fn lit_of(&self, body: usize) -> f32 {
        self.of_body(body).map_or(1.0, |own| own.lit)
    }

    /// True if bodies occlude each other, which is so for wrist cameras.
    pub fn count(&self) -> bool {
        self.count
    }

    /// True if the occlusion by proxies may differ from that of another frame.
    pub fn differ(&self, before: &Self) -> bool {
        (self.count || before.count) && self != before
    }

    /// Multiplies the unoccluded shares at points of a body by the occlusion of its own cavity and, for wrist cameras,
    /// of other bodies; `None` is a fixture.
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

    /// Proxies of the robot, which precede those of objects.
    fn robot(&self, robot_bodies: usize) -> &[Proxy] {
        &self.bodies[..self.bodies.partition_point(|other| other.body < robot_bodies)]
    }

    /// Proxy of a body with a cavity that light enters; `None` for other bodies.
    pub fn cavity_of(&self, body: usize) -> Option<&Proxy> {
        self.of_body(body).filter(|own| own.entering > 0.0)
    }

    /// Factor 0-1 on the albedo in multi-bounce ambient occlusion: less for a body in the dark gripper, 1 in a cavity.
    pub fn bounce_of(&self, body: usize) -> f32 {
        self.of_body(body).filter(|own| !own.shape.is_concave).map_or(1.0, |own| 1.0 - own.held)
    }
}

/// Degree to which a body counts as held, 0-1: it grows from 0 to 1 as the share of the sky above the body's centre
/// that the robot occludes goes from [`BESIDE`] to [`BETWEEN`].
fn held(own: &Proxy, robot: &[Proxy]) -> f32 {
    let above = 1.0 - unoccluded_sky(robot, own.body, own.center, [0.0, 0.0, 1.0]);
    ((above - BESIDE) / (BETWEEN - BESIDE)).clamp(0.0, 1.0)
}

/// Area-weighted mean linear colour of each body's opaque parts, by body index.
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
