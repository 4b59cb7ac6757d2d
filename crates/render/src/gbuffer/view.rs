//! A camera over a frame: what is in view, where its corners fall, and which surface each sample sees.

use genmanip_core::{Camera, Pose};
use glam::{Mat3A, Vec2, Vec3A};
use multiversion::multiversion;

use crate::error::RenderError;
use crate::gbuffer::static_layer::{Motion, Rectangle};
use crate::job::{FrameState, ViewJob};
use crate::raster::{Corner, Sides, Viewpoint, VisibilityBuffer, area_of, draw_mesh};
use crate::scene::assets::{Part, RenderAssets, TRIANGLE_BITS};
use crate::scene::mesh::{ERRORS_M, Mesh};

/// Nothing nearer than this is drawn, metres.
pub(crate) const NEAR_M: f32 = 0.01;

/// A pinhole at a place, single precision, ready for drawing.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CameraView {
    pub width: usize,
    pub height: usize,
    pub focal: Vec2,
    pub center: Vec2,
    pub world_from_camera: Pose,
    /// World coordinates of the optical centre.
    pub viewpoint: Vec3A,
    /// World axes of the camera.
    pub turn: Mat3A,
}

/// All parts seen through a camera; remembers what it saw before.
#[derive(Debug, Default)]
pub(crate) struct View {
    pub camera: CameraView,
    pub parts: Vec<PartView>,
    /// What became of each part at the last [`View::place`].
    pub motions: Vec<Motion>,
    /// Whether anything in view is transparent.
    pub has_transparent: bool,
}

/// A part at its place.
#[derive(Clone, Debug, Default)]
pub(crate) struct PartView {
    pose: Pose,
    pub visible: bool,
    /// Level of detail, see [`Mesh::at_level`].
    pub level: usize,
    /// Rotation from the body's frame to the world.
    pub world_from_body: Mat3A,
    /// Rotation from camera axes to the body's frame.
    pub body_from_camera: Mat3A,
    /// The optical centre in the body's frame.
    pub viewpoint_in_body: Vec3A,
    /// On the image plane at one sample per pixel; the reversed_z is 1 / depth.
    corners: Vec<Corner>,
    /// Whether some corner is before the near plane.
    is_cut: bool,
}

/// Smallest size of an image, along its longer side, that shows meshes in full detail.
const FULL_DETAIL_PX: usize = 256;
/// By how much surfaces may move at a level of detail, pixels. Measured: with a third of a pixel, pictures of 64 × 64 and
/// 128 × 72 differ from those in full detail by 0.7 and 0.5 levels of 255 on average.
const LEVEL_PX: f32 = 0.35;

impl CameraView {
    /// Checks a job and places its camera.
    pub fn of(assets: &RenderAssets, job: &ViewJob<'_>) -> Result<Self, RenderError> {
        let (expected, got) = (assets.body_count(), job.frame.body_poses.len());
        if expected != got {
            return Err(RenderError::BodyCount { expected, got });
        }
        for (index, pose) in job.frame.body_poses.iter().enumerate() {
            check_finite(pose, || format!("the pose of body {index}"))?;
        }
        Self::new(job.camera, &assets.world_from_hand(job.frame))
    }

    /// Checks a camera and places it.
    fn new(camera: &Camera, world_from_hand: &Pose) -> Result<Self, RenderError> {
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
            viewpoint: world_from_camera.position.as_vec3a(),
            turn: rotation(&world_from_camera),
        })
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
    /// Places all parts of a frame before a camera; says whether it is the camera of the last time.
    ///
    /// What did not move before a camera that did not move is left as it is.
    pub fn place(&mut self, assets: &RenderAssets, frame: &FrameState, camera: CameraView) -> bool {
        let follows = self.camera == camera && self.parts.len() == assets.parts.len();
        self.camera = camera;
        self.parts.resize_with(assets.parts.len(), PartView::default);
        self.motions.resize_with(assets.parts.len(), Motion::default);
        self.has_transparent = false;
        let camera_from_world = self.camera.world_from_camera.inverse();
        for ((part, placed), motion) in assets.parts.iter().zip(&mut self.parts).zip(&mut self.motions) {
            let pose = part.body.map_or(Pose::IDENTITY, |body| frame.body_poses[body]);
            motion.moved = !follows || placed.pose != pose;
            motion.before.clone_from(&motion.now);
            if motion.moved {
                motion.now = placed.place(part, pose, &camera_from_world, &self.camera);
            }
            self.has_transparent |= placed.visible && part.is_transparent();
        }
        follows
    }

    /// Unit normal in the world of the triangle of a visibility id, towards the viewer; `None` for no triangle.
    pub fn normal_of(&self, assets: &RenderAssets, id: u32) -> Option<Vec3A> {
        let (part, triangle) = part_and_triangle(id)?;
        let placed = &self.parts[part];
        let mesh = placed.mesh(&assets.parts[part]);
        let plane = Vec3A::from_vec4(mesh.faces[triangle].plane);
        let corner = Vec3A::from(mesh.positions[mesh.triangles[triangle][0] as usize]);
        let towards = if plane.dot(corner - placed.viewpoint_in_body) > 0.0 { -plane } else { plane };
        Some(placed.world_from_body * towards)
    }

    /// Draws one part over what the target holds.
    pub fn draw(&self, assets: &RenderAssets, index: usize, sides: Sides, target: &mut VisibilityBuffer) {
        let (part, placed) = (&assets.parts[index], &self.parts[index]);
        if !placed.visible {
            return;
        }
        let mesh = placed.mesh(part);
        let first_id = (index as u32 + 1) << TRIANGLE_BITS;
        let mut cut = Vec::new();
        if placed.is_cut {
            draw_beyond(mesh, &placed.corners, sides, first_id, target, &mut cut);
        } else {
            draw_triangles(mesh, placed, sides, first_id, target);
        }
        for triangle in cut {
            self.draw_clipped(placed, mesh, triangle as usize, sides, first_id, target);
        }
    }

    /// Draws one opaque part without the sides that can never be seen.
    pub fn draw_opaque(&self, assets: &RenderAssets, index: usize, target: &mut VisibilityBuffer) {
        let part = &assets.parts[index];
        if !part.is_transparent() {
            let hides_back = part.hides_back(self.parts[index].mesh(part));
            self.draw(assets, index, [true, !hides_back], target);
        }
    }

    /// Draws a part, opaque or transparent, with all sides that can be seen.
    pub fn draw_whole(&self, assets: &RenderAssets, index: usize, target: &mut VisibilityBuffer) {
        match assets.parts[index].is_transparent() {
            true => self.draw(assets, index, [true, true], target),
            false => self.draw_opaque(assets, index, target),
        }
    }

    /// Draws all transparent parts.
    pub fn draw_transparent(&self, assets: &RenderAssets, sides: Sides, target: &mut VisibilityBuffer) {
        for index in (0..assets.parts.len()).filter(|&index| assets.parts[index].is_transparent()) {
            self.draw(assets, index, sides, target);
        }
    }

    /// Draws the sides of transparent parts that face away, the farthest of each sample: their reversed_z is
    /// [`complement_z`] of what is drawn. Parts that reach before the near plane are left out.
    pub fn draw_far_sides(&self, assets: &RenderAssets, target: &mut VisibilityBuffer) {
        let is_whole = |index: &usize| {
            let placed = &self.parts[*index];
            placed.visible && !placed.is_cut && assets.parts[*index].is_transparent()
        };
        for index in (0..assets.parts.len()).filter(is_whole) {
            let (part, placed) = (&assets.parts[index], &self.parts[index]);
            let turned = |corner: &Corner| Corner { reversed_z: complement_z(corner.reversed_z), ..*corner };
            let turned = PartView { corners: placed.corners.iter().map(turned).collect(), ..placed.clone() };
            draw_triangles(turned.mesh(part), &turned, [false, true], (index as u32 + 1) << TRIANGLE_BITS, target);
        }
    }

    /// A triangle that crosses the near plane: what lies beyond it, as a fan.
    #[cold]
    fn draw_clipped(
        &self,
        placed: &PartView,
        mesh: &Mesh,
        triangle: usize,
        sides: Sides,
        first_id: u32,
        target: &mut VisibilityBuffer,
    ) {
        let in_camera = |index: u32| {
            placed.body_from_camera.transpose()
                * (Vec3A::from(mesh.positions[index as usize]) - placed.viewpoint_in_body)
        };
        let corners = mesh.triangles[triangle].map(in_camera);
        let scale = target.scale as f32;
        let mut polygon: Vec<Corner> = Vec::with_capacity(4);
        for (from, to) in [(0, 1), (1, 2), (2, 0)] {
            let (from, to) = (corners[from], corners[to]);
            if from.z >= NEAR_M {
                polygon.push(self.camera.project(from).scaled(scale));
            }
            if (from.z >= NEAR_M) != (to.z >= NEAR_M) {
                // Always from the visible corner, so that neighbours cut their common edge at the same point.
                let (inside, outside) = if from.z >= NEAR_M { (from, to) } else { (to, from) };
                let cut = inside + (outside - inside) * ((NEAR_M - inside.z) / (outside.z - inside.z));
                polygon.push(self.camera.project(cut.with_z(NEAR_M)).scaled(scale));
            }
        }
        draw_fan(&polygon, sides, first_id + triangle as u32, target);
    }
}

impl PartView {
    /// The mesh at the level of detail.
    pub fn mesh<'a>(&self, part: &'a Part) -> &'a Mesh {
        part.mesh.at_level(self.level)
    }

    /// Moves to a pose; returns the pixels that the part may cover.
    fn place(&mut self, part: &Part, pose: Pose, camera_from_world: &Pose, camera: &CameraView) -> Rectangle {
        let camera_from_body = *camera_from_world * pose;
        let (turn, shift) = (rotation(&camera_from_body), camera_from_body.position.as_vec3a());
        let center = turn * Vec3A::from(part.mesh.bounds_center) + shift;
        self.pose = pose;
        self.visible = camera.sees(center, part.mesh.bounds_radius);
        self.world_from_body = rotation(&pose);
        self.body_from_camera = turn.transpose();
        self.viewpoint_in_body = camera_from_body.inverse().position.as_vec3a();
        self.corners.clear();
        if !self.visible {
            return Rectangle::default();
        }
        self.level = camera.level(center.z - part.mesh.bounds_radius);
        let positions = &self.mesh(part).positions;
        let mut corners = std::mem::take(&mut self.corners);
        corners.extend(positions.iter().map(|&position| camera.project(turn * Vec3A::from(position) + shift)));
        self.corners = corners;
        let first = Corner { x: f32::MAX, y: f32::MAX, reversed_z: f32::MAX };
        let last = Corner { x: f32::MIN, y: f32::MIN, reversed_z: f32::MIN };
        let (low, high) = self.corners.iter().fold((first, last), |(low, high), corner| {
            (
                low.joined(corner, |a, b| if a < b { a } else { b }),
                high.joined(corner, |a, b| if a > b { a } else { b }),
            )
        });
        // Behind the viewpoint it is negative.
        self.is_cut = low.reversed_z < 0.0 || high.reversed_z > 1.0 / NEAR_M;
        if self.is_cut {
            return Rectangle { columns: 0..camera.width, rows: 0..camera.height };
        }
        Rectangle::around([low.x, low.y], [high.x, high.y], camera.width, camera.height)
    }
}

impl CameraView {
    /// The coarsest level of detail whose surfaces move by less than [`LEVEL_PX`] at a distance; 0 in large images.
    fn level(&self, distance_m: f32) -> usize {
        if self.width.max(self.height) >= FULL_DETAIL_PX {
            return 0;
        }
        let pixel_m = distance_m / self.focal.x;
        ERRORS_M.iter().take_while(|&&error| error < LEVEL_PX * pixel_m).count()
    }

    /// The point of the world that is seen at a pixel at a depth.
    pub fn point_at(&self, pixel: Vec2, depth: f32) -> Vec3A {
        let flat = (pixel - self.center) / self.focal;
        self.viewpoint + self.turn * (Vec3A::from(flat.extend(1.0)) * depth)
    }

    /// Heights in the world of the points that are seen at pixels beside each other at depths.
    #[inline(always)]
    pub fn heights_at<const N: usize>(&self, [column, row]: [usize; 2], depths: &[f32; N]) -> [f32; N] {
        let [x, y, z] = [self.turn.x_axis.z, self.turn.y_axis.z, self.turn.z_axis.z];
        let (slope, first) = (x / self.focal.x, column as f32 - self.center.x);
        let rest = (row as f32 - self.center.y) / self.focal.y * y + z;
        std::array::from_fn(|step| self.viewpoint.z + ((first + step as f32) * slope + rest) * depths[step])
    }

    #[inline(always)]
    fn project(&self, in_camera: Vec3A) -> Corner {
        let reversed_z = 1.0 / in_camera.z;
        Corner {
            x: self.focal.x * in_camera.x * reversed_z + self.center.x,
            y: self.focal.y * in_camera.y * reversed_z + self.center.y,
            reversed_z,
        }
    }
}

/// Turns the nearest into the farthest, and back.
#[inline(always)]
pub(crate) fn complement_z(reversed_z: f32) -> f32 {
    1.0 / NEAR_M - reversed_z
}

/// Draws a mesh that lies beyond the near plane.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn draw_triangles(mesh: &Mesh, placed: &PartView, sides: Sides, first_id: u32, target: &mut VisibilityBuffer) {
    let viewpoint = Viewpoint::At(placed.viewpoint_in_body.to_array());
    draw_mesh::<true>(&mesh.triangles, &placed.corners, &mesh.planes, viewpoint, sides, first_id, target);
}

/// Draws the triangles of a mesh that lie beyond the near plane; lists those that cross it.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn draw_beyond(
    mesh: &Mesh,
    corners: &[Corner],
    sides: Sides,
    first_id: u32,
    target: &mut VisibilityBuffer,
    cut: &mut Vec<u32>,
) {
    let scale = target.scale as f32;
    let is_beyond = |corner: &Corner| corner.reversed_z > 0.0 && corner.reversed_z <= 1.0 / NEAR_M;
    for (triangle, id) in mesh.triangles.iter().zip(first_id..) {
        let triangle = triangle.map(|corner| corners[corner as usize]);
        match triangle.iter().filter(|corner| is_beyond(corner)).count() {
            0 => {}
            3 => draw_facing(triangle.map(|corner| corner.scaled(scale)), sides, id, target),
            _ => cut.push(id - first_id),
        }
    }
}

/// Draws the sides that are wanted of triangles around the first of some corners.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn draw_fan(polygon: &[Corner], sides: Sides, id: u32, target: &mut VisibilityBuffer) {
    for pair in polygon.get(1..).unwrap_or_default().windows(2) {
        draw_facing([polygon[0], pair[0], pair[1]], sides, id, target);
    }
}

/// Draws a triangle if its side is wanted.
#[inline(always)]
fn draw_facing(corners: [Corner; 3], sides: Sides, id: u32, target: &mut VisibilityBuffer) {
    let [a, b, c] = corners;
    let area = area_of([a.x, a.y], [b.x, b.y], [c.x, c.y]);
    let wanted = if area < 0.0 { sides[0] } else { sides[1] };
    if wanted {
        target.draw::<true>(corners, id);
    }
}

/// Rotation of a pose as a matrix.
pub fn rotation(pose: &Pose) -> Mat3A {
    Mat3A::from(glam::DMat3::from_quat(pose.rotation).as_mat3())
}

/// Refuses poses with numbers that are not finite.
fn check_finite(pose: &Pose, what: impl Fn() -> String) -> Result<(), RenderError> {
    if pose.position.is_finite() && pose.rotation.is_finite() {
        Ok(())
    } else {
        Err(RenderError::NotFinite { what: what() })
    }
}

/// The part of a visibility id, plus one.
#[inline(always)]
pub(crate) fn surface_of(id: u32) -> u32 {
    id >> TRIANGLE_BITS
}

/// Part and triangle of a visibility id; `None` where nothing is seen.
#[inline]
pub(crate) fn part_and_triangle(id: u32) -> Option<(usize, usize)> {
    let part = (id >> TRIANGLE_BITS).checked_sub(1)?;
    Some((part as usize, (id & ((1 << TRIANGLE_BITS) - 1)) as usize))
}
