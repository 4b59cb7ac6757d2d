//! A camera over a frame: what is in view, where its corners fall, and which surface each sample sees.

use genmanip_core::{Camera, Pose};
use glam::{Mat3A, Vec2, Vec3A};

use crate::assets::{Part, RenderAssets, TRIANGLE_BITS};
use crate::error::RenderError;
use crate::job::FrameState;
use crate::raster::{Corner, Target};

/// Nothing nearer than this is drawn, metres.
pub(crate) const NEAR_M: f32 = 0.01;

/// A pinhole at a place, single precision, ready for drawing.
#[derive(Clone, Debug, Default)]
pub(crate) struct Lens {
    pub width: usize,
    pub height: usize,
    pub focal: Vec2,
    pub center: Vec2,
    pub world_from_camera: Pose,
    /// World coordinates of the optical centre.
    pub eye: Vec3A,
    /// World axes of the camera.
    pub turn: Mat3A,
}

/// Corners of all parts seen through a lens.
#[derive(Debug, Default)]
pub(crate) struct View {
    pub lens: Lens,
    pub parts: Vec<PartView>,
    pub corners: Vec<ProjectedCorner>,
    /// Whether anything in view is transparent.
    pub has_transparent: bool,
    /// First and last column and row, `[[x, y], [x, y]]`, where anything transparent can be.
    pub glass_bounds: [[usize; 2]; 2],
}

/// A part at its place.
#[derive(Clone, Debug)]
pub(crate) struct PartView {
    pub visible: bool,
    /// Index of its first corner in [`View::corners`].
    pub first_corner: usize,
    /// Rotation from the body's frame to the world.
    pub world_from_body: Mat3A,
    /// Rotation from camera axes to the body's frame.
    pub body_from_camera: Mat3A,
    /// The optical centre in the body's frame.
    pub eye_in_body: Vec3A,
}

/// A corner on the image plane at one sample per pixel.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ProjectedCorner {
    pub x: f32,
    pub y: f32,
    /// 1 / depth.
    pub nearness: f32,
    pub depth: f32,
}

/// Which sides of which parts to draw.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Layer {
    /// Opaque parts; closed ones without their invisible back faces.
    Opaque,
    /// Transparent parts, both sides.
    Transparent,
    /// Sides of transparent parts that face the viewer.
    TransparentFront,
    /// Sides of transparent parts that face away.
    TransparentBack,
}

impl Lens {
    /// Checks a camera and places it.
    pub fn new(camera: &Camera, world_from_hand: &Pose) -> Result<Self, RenderError> {
        let k = &camera.intrinsics;
        let bad = |problem: String| RenderError::BadCamera { camera: camera.name.clone(), problem };
        if k.width == 0 || k.height == 0 || k.width > 8192 || k.height > 8192 {
            return Err(bad(format!("the image is {}×{}, expected 1 to 8192 pixels each way", k.width, k.height)));
        }
        if !(k.fx > 0.0 && k.fy > 0.0 && k.fx.is_finite() && k.fy.is_finite() && k.cx.is_finite() && k.cy.is_finite()) {
            return Err(bad(format!(
                "fx {}, fy {}, cx {}, cy {}: focal lengths must be positive",
                k.fx, k.fy, k.cx, k.cy
            )));
        }
        let world_from_camera = camera.world_from_camera(world_from_hand);
        check_finite(&world_from_camera, || format!("the pose of camera `{}`", camera.name))?;
        Ok(Self {
            width: k.width as usize,
            height: k.height as usize,
            focal: Vec2::new(k.fx as f32, k.fy as f32),
            center: Vec2::new(k.cx as f32, k.cy as f32),
            world_from_camera,
            eye: world_from_camera.position.as_vec3a(),
            turn: rotation(&world_from_camera),
        })
    }

    /// Direction through a pixel in camera axes, 1 along the optical axis.
    #[inline]
    pub fn ray(&self, x: f32, y: f32) -> Vec3A {
        Vec3A::new((x - self.center.x) / self.focal.x, (y - self.center.y) / self.focal.y, 1.0)
    }

    /// Whether any of a ball, in camera axes, may be in view.
    fn sees(&self, center: Vec3A, radius: f32) -> bool {
        let outside = |slope: f32, offset: f32| (offset - slope * center.z) > radius * (1.0 + slope * slope).sqrt();
        let left = (self.center.x + 0.5) / self.focal.x;
        let right = (self.width as f32 - 0.5 - self.center.x) / self.focal.x;
        let top = (self.center.y + 0.5) / self.focal.y;
        let bottom = (self.height as f32 - 0.5 - self.center.y) / self.focal.y;
        center.z + radius > NEAR_M
            && !outside(left, -center.x)
            && !outside(right, center.x)
            && !outside(top, -center.y)
            && !outside(bottom, center.y)
    }
}

impl View {
    /// Places all parts of a frame before a lens and projects the corners of those in view.
    pub fn place(&mut self, assets: &RenderAssets, frame: &FrameState, lens: Lens) {
        let camera_from_world = lens.world_from_camera.inverse();
        self.parts.clear();
        self.corners.clear();
        self.has_transparent = false;
        self.glass_bounds = [[usize::MAX; 2], [0; 2]];
        for part in &assets.parts {
            let world_from_body = part.body.map_or(Pose::IDENTITY, |body| frame.body_poses[body]);
            let camera_from_body = camera_from_world * world_from_body;
            let (turn, shift) = (rotation(&camera_from_body), camera_from_body.position.as_vec3a());
            let visible = lens.sees(turn * Vec3A::from(part.bounds_center) + shift, part.bounds_radius);
            self.parts.push(PartView {
                visible,
                first_corner: self.corners.len(),
                world_from_body: rotation(&world_from_body),
                body_from_camera: turn.transpose(),
                eye_in_body: camera_from_body.inverse().position.as_vec3a(),
            });
            if visible {
                self.corners
                    .extend(part.positions.iter().map(|&position| lens.project(turn * Vec3A::from(position) + shift)));
                if part.is_transparent() {
                    self.has_transparent = true;
                    let first_corner = self.corners.len() - part.positions.len();
                    include_corners(&mut self.glass_bounds, &self.corners[first_corner..], &lens);
                }
            }
        }
        self.lens = lens;
    }

    /// Draws one layer at `scale` × `scale` samples per pixel over what the target holds.
    pub fn draw(&self, assets: &RenderAssets, layer: Layer, scale: usize, target: &mut Target) {
        for (index, (part, placed)) in assets.parts.iter().zip(&self.parts).enumerate() {
            if placed.visible && part.is_transparent() == (layer != Layer::Opaque) {
                let first_id = (index as u32 + 1) << TRIANGLE_BITS;
                self.draw_part(part, placed, layer, scale as f32, first_id, target);
            }
        }
    }

    fn draw_part(&self, part: &Part, placed: &PartView, layer: Layer, scale: f32, first_id: u32, target: &mut Target) {
        let corners = &self.corners[placed.first_corner..placed.first_corner + part.positions.len()];
        let keep_front = layer != Layer::TransparentBack;
        let keep_back = layer != Layer::TransparentFront && !part.closed;
        for (&triangle, id) in part.triangles.iter().zip(first_id..) {
            let (a, b, c) =
                (corners[triangle[0] as usize], corners[triangle[1] as usize], corners[triangle[2] as usize]);
            if a.depth.min(b.depth).min(c.depth) < NEAR_M {
                if a.depth.max(b.depth).max(c.depth) >= NEAR_M {
                    self.draw_clipped(part, placed, triangle, [keep_front, keep_back], scale, id, target);
                }
                continue;
            }
            draw_facing(
                [a.on_target(scale), b.on_target(scale), c.on_target(scale)],
                [keep_front, keep_back],
                id,
                target,
            );
        }
    }

    /// A triangle that crosses the near plane: what lies beyond it, as a fan.
    #[cold]
    #[expect(clippy::too_many_arguments, reason = "the body of one loop of `draw_part`, out of line")]
    fn draw_clipped(
        &self,
        part: &Part,
        placed: &PartView,
        triangle: [u32; 3],
        keep: [bool; 2],
        scale: f32,
        id: u32,
        target: &mut Target,
    ) {
        let in_camera = |index: u32| {
            placed.body_from_camera.transpose() * (Vec3A::from(part.positions[index as usize]) - placed.eye_in_body)
        };
        let corners = triangle.map(in_camera);
        let mut polygon: Vec<Corner> = Vec::with_capacity(4);
        for (from, to) in [(0, 1), (1, 2), (2, 0)] {
            let (from, to) = (corners[from], corners[to]);
            if from.z >= NEAR_M {
                polygon.push(self.lens.project(from).on_target(scale));
            }
            if (from.z >= NEAR_M) != (to.z >= NEAR_M) {
                // Always from the visible corner, so that neighbours cut their common edge at the same point.
                let (inside, outside) = if from.z >= NEAR_M { (from, to) } else { (to, from) };
                let cut = inside + (outside - inside) * ((NEAR_M - inside.z) / (outside.z - inside.z));
                polygon.push(self.lens.project(cut.with_z(NEAR_M)).on_target(scale));
            }
        }
        for pair in polygon.get(1..).unwrap_or_default().windows(2) {
            draw_facing([polygon[0], pair[0], pair[1]], keep, id, target);
        }
    }
}

impl Lens {
    #[inline]
    fn project(&self, in_camera: Vec3A) -> ProjectedCorner {
        let nearness = 1.0 / in_camera.z;
        ProjectedCorner {
            x: self.focal.x * in_camera.x * nearness + self.center.x,
            y: self.focal.y * in_camera.y * nearness + self.center.y,
            nearness,
            depth: in_camera.z,
        }
    }
}

impl ProjectedCorner {
    /// With `scale` samples per pixel: pixel centres at integers stay between their samples.
    #[inline]
    fn on_target(self, scale: f32) -> Corner {
        Corner { x: (self.x + 0.5) * scale - 0.5, y: (self.y + 0.5) * scale - 0.5, nearness: self.nearness }
    }
}

/// Widens bounds of pixels by projected corners; by everything when a corner is too near to be projected.
fn include_corners(bounds: &mut [[usize; 2]; 2], corners: &[ProjectedCorner], lens: &Lens) {
    let size = [lens.width, lens.height];
    for corner in corners {
        for (axis, place) in [corner.x, corner.y].into_iter().enumerate() {
            let last = size[axis] - 1;
            let (from, to) = if corner.depth < NEAR_M {
                (0, last)
            } else {
                (((place - 1.0).max(0.0)) as usize, (place + 2.0).max(0.0) as usize)
            };
            bounds[0][axis] = bounds[0][axis].min(from);
            bounds[1][axis] = bounds[1][axis].max(to.min(last));
        }
    }
}

/// Draws a triangle if its side is wanted: `keep` = [front, back].
#[inline(always)]
pub(crate) fn draw_facing(corners: [Corner; 3], keep: [bool; 2], id: u32, target: &mut Target) {
    let [a, b, c] = corners;
    let area = (b.x - a.x) * (c.y - a.y) - (c.x - a.x) * (b.y - a.y);
    let wanted = if area < 0.0 { keep[0] } else { keep[1] };
    if wanted {
        target.draw::<true>(corners, area, id);
    }
}

/// Rotation of a pose as a matrix.
pub(crate) fn rotation(pose: &Pose) -> Mat3A {
    Mat3A::from(glam::DMat3::from_quat(pose.rotation).as_mat3())
}

/// Refuses poses with numbers that are not finite.
pub(crate) fn check_finite(pose: &Pose, what: impl Fn() -> String) -> Result<(), RenderError> {
    if pose.position.is_finite() && pose.rotation.is_finite() {
        Ok(())
    } else {
        Err(RenderError::NotFinite { what: what() })
    }
}

/// Part and triangle of a visibility id; `None` where nothing is seen.
#[inline]
pub(crate) fn part_and_triangle(id: u32) -> Option<(usize, usize)> {
    let part = (id >> TRIANGLE_BITS).checked_sub(1)?;
    Some((part as usize, (id & ((1 << TRIANGLE_BITS) - 1)) as usize))
}
