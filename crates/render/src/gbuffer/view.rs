//! Camera views: placement of parts, projection of vertices and rasterisation of parts.

use genmanip_core::{Camera, Pose};
use glam::{Mat3A, Vec2, Vec3, Vec3A};
use multiversion::multiversion;

use crate::error::RenderError;
use crate::gbuffer::static_layer::{Motion, Rectangle, TILE};
use crate::job::{FrameState, ViewJob};
use crate::raster::{Block, Corner, Sides, VisibilityBuffer, draw_mesh, extremes};
use crate::scene::assets::{Part, RenderAssets, TRIANGLE_BITS};
use crate::scene::mesh::{ERRORS_M, Mesh};

/// Distance of the near plane (m).
pub(crate) const NEAR_M: f32 = 0.01;

/// Pinhole camera at a pose, in single precision.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CameraView {
    /// Width of the image (px).
    pub width: usize,
    /// Height of the image (px).
    pub height: usize,
    /// Focal lengths (px).
    pub focal: Vec2,
    /// Principal point (px).
    pub center: Vec2,
    /// Pose of the camera's optical frame in the world.
    pub world_from_camera: Pose,
    /// Optical centre in the world (m).
    pub viewpoint: Vec3A,
    /// Rotation from camera axes to the world.
    pub turn: Mat3A,
}

/// All parts as seen by a camera; a part at rest keeps its placement from the last frame.
#[derive(Debug, Default)]
pub(crate) struct View {
    pub camera: CameraView,
    pub parts: Vec<PartView>,
    /// Motion of each part since the last [`View::place`].
    pub motions: Vec<Motion>,
    /// True if a transparent part may be visible.
    pub has_transparent: bool,
}

/// Part as placed in front of a camera.
#[derive(Clone, Debug, Default)]
pub(crate) struct PartView {
    pose: Pose,
    /// World z of the support surface below the part's centre (m); `None` if there is none.
    pub ground: Option<f32>,
    pub visible: bool,
    /// Level of detail of the mesh, see [`Mesh::at_level`].
    pub level: usize,
    /// Rotation from the body's frame to the world.
    pub world_from_body: Mat3A,
    /// Rotation from camera axes to the body's frame.
    pub body_from_camera: Mat3A,
    /// Optical centre in the body's frame (m).
    pub viewpoint_in_body: Vec3A,
    /// Projected vertices (px) with reversed z = 1 / depth.
    corners: Vec<Corner>,
    /// True if the part crosses the near plane or lies partly behind the camera.
    is_cut: bool,
}

/// Longer side from which on images show meshes in full detail (px).
const FULL_DETAIL_PX: usize = 256;
/// Largest surface error of a level of detail in the image (px). Measured: at 0.35 px, images of 64×64 and 128×72
/// differ from full detail by 0.7 and 0.5 levels of 255 on average.
const LEVEL_PX: f32 = 0.35;

impl CameraView {
    /// Validates frame and camera of a job, and places the camera.
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

    /// Validates and places a camera.
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

    /// True if a sphere may intersect the view frustum; its centre is given in camera axes (m).
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
    /// Places all parts of a frame; returns true if the camera is the same as in the last frame.
    ///
    /// With the same camera, parts at rest keep their placement.
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
                placed.ground = assets.ground_below(pose.transform_point(part.mesh.bounds_center.as_dvec3()));
            }
            self.has_transparent |= placed.visible && part.is_transparent();
        }
        follows
    }

    /// Rasterises the given sides (front, back) of a part, if it is visible.
    pub fn draw(&self, assets: &RenderAssets, index: usize, sides: Sides, target: &mut VisibilityBuffer) {
        let (part, placed) = (&assets.parts[index], &self.parts[index]);
        if !placed.visible {
            return;
        }
        let first_id = (index as u32 + 1) << TRIANGLE_BITS;
        match placed.is_cut {
            true => draw_clipped(placed.mesh(part), placed, &self.camera, sides, first_id, target),
            false => draw_triangles(placed.mesh(part), placed, sides, first_id, target),
        }
    }

    /// Rasterises an opaque part, with back-face culling where possible.
    pub fn draw_opaque(&self, assets: &RenderAssets, index: usize, target: &mut VisibilityBuffer) {
        let part = &assets.parts[index];
        if !part.is_transparent() {
            let hides_back = part.hides_back(self.parts[index].mesh(part));
            self.draw(assets, index, [true, !hides_back], target);
        }
    }

    /// Rasterises all visible sides of a part, opaque or transparent.
    pub fn draw_whole(&self, assets: &RenderAssets, index: usize, target: &mut VisibilityBuffer) {
        match assets.parts[index].is_transparent() {
            true => self.draw(assets, index, [true, true], target),
            false => self.draw_opaque(assets, index, target),
        }
    }

    /// Rasterises the given sides (front, back) of all transparent parts.
    pub fn draw_transparent(&self, assets: &RenderAssets, sides: Sides, target: &mut VisibilityBuffer) {
        for index in (0..assets.parts.len()).filter(|&index| assets.parts[index].is_transparent()) {
            self.draw(assets, index, sides, target);
        }
    }

    /// Rasterises the back faces of transparent parts with complemented reversed z ([`complement_z`]), so that the
    /// farthest face wins the depth test. Parts that cross the near plane are skipped.
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
}

impl PartView {
    /// Mesh of the part at this view's level of detail.
    pub fn mesh<'a>(&self, part: &'a Part) -> &'a Mesh {
        part.mesh.at_level(self.level)
    }

    /// Places the part at a pose and projects its vertices; returns its bounds in the image (px), empty if invisible.
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
        let (low, high) = extremes(self.corners.iter().copied());
        // Reversed z is negative behind the camera.
        self.is_cut = low.reversed_z < 0.0 || high.reversed_z > 1.0 / NEAR_M;
        if self.is_cut {
            return Rectangle { columns: 0..camera.width, rows: 0..camera.height };
        }
        Rectangle::around([low.x, low.y], [high.x, high.y], camera.width, camera.height)
    }
}

impl CameraView {
    /// Coarsest level of detail with a surface error below [`LEVEL_PX`] at a distance; 0 in large images.
    fn level(&self, distance_m: f32) -> usize {
        // Rounded up to whole tiles, so that images with and without padding get the same level.
        if self.width.max(self.height).next_multiple_of(TILE) >= FULL_DETAIL_PX {
            return 0;
        }
        let pixel_m = distance_m / self.focal.x;
        ERRORS_M.iter().take_while(|&&error| error < LEVEL_PX * pixel_m).count()
    }

    /// Same view with width and height rounded up to whole tiles.
    pub(crate) fn in_whole_tiles(self) -> Self {
        let [width, height] = [self.width, self.height].map(|size| size.next_multiple_of(TILE));
        Self { width, height, ..self }
    }

    /// World position (m) of a pixel at a depth along the optical axis (m).
    pub fn point_at(&self, pixel: Vec2, depth: f32) -> Vec3A {
        let flat = (pixel - self.center) / self.focal;
        self.viewpoint + self.turn * (Vec3A::from(flat.extend(1.0)) * depth)
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

/// Reverses the order of reversed z, so that the farthest surface has the largest value.
#[inline(always)]
pub(crate) fn complement_z(reversed_z: f32) -> f32 {
    1.0 / NEAR_M - reversed_z
}

/// Rasterises a mesh that lies entirely beyond the near plane.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn draw_triangles(mesh: &Mesh, placed: &PartView, sides: Sides, first_id: u32, target: &mut VisibilityBuffer) {
    draw_mesh::<true>(&mesh.triangles, &placed.corners, sides, first_id, target);
}

/// Rasterises a mesh that crosses the near plane, at which its triangles are clipped.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn draw_clipped(
    mesh: &Mesh,
    placed: &PartView,
    camera: &CameraView,
    sides: Sides,
    first_id: u32,
    target: &mut VisibilityBuffer,
) {
    let mut block = Block::default();
    let is_beyond = |corner: &Corner| corner.reversed_z > 0.0 && corner.reversed_z <= 1.0 / NEAR_M;
    for (triangle, id) in mesh.triangles.iter().zip(first_id..) {
        let corners = triangle.map(|corner| placed.corners[corner as usize]);
        match corners.iter().filter(|corner| is_beyond(corner)).count() {
            0 => {}
            3 => block.push::<true>(id, corners.each_ref(), sides, target),
            _ => {
                let polygon = clipped(triangle.map(|corner| mesh.positions[corner as usize]), placed, camera);
                for pair in polygon.get(1..).unwrap_or_default().windows(2) {
                    block.push::<true>(id, [&polygon[0], &pair[0], &pair[1]], sides, target);
                }
            }
        }
    }
    block.draw::<true>(sides, target);
}

/// Projected polygon of the part of a triangle (vertices in the body's frame) that lies beyond the near plane.
#[cold]
fn clipped(triangle: [Vec3; 3], placed: &PartView, camera: &CameraView) -> Vec<Corner> {
    let camera_from_body = placed.body_from_camera.transpose();
    let corners = triangle.map(|corner| camera_from_body * (Vec3A::from(corner) - placed.viewpoint_in_body));
    let mut polygon: Vec<Corner> = Vec::with_capacity(4);
    for (from, to) in [(0, 1), (1, 2), (2, 0)] {
        let (from, to) = (corners[from], corners[to]);
        if from.z >= NEAR_M {
            polygon.push(camera.project(from));
        }
        if (from.z >= NEAR_M) != (to.z >= NEAR_M) {
            // The interpolation always starts at the vertex beyond the near plane, so that adjacent triangles clip
            // their common edge at the same point.
            let (inside, outside) = if from.z >= NEAR_M { (from, to) } else { (to, from) };
            let cut = inside + (outside - inside) * ((NEAR_M - inside.z) / (outside.z - inside.z));
            polygon.push(camera.project(cut.with_z(NEAR_M)));
        }
    }
    polygon
}

/// Rotation matrix of a pose.
pub fn rotation(pose: &Pose) -> Mat3A {
    Mat3A::from(glam::DMat3::from_quat(pose.rotation).as_mat3())
}

/// Returns an error for a pose that is not finite; `what` names the pose.
fn check_finite(pose: &Pose, what: impl Fn() -> String) -> Result<(), RenderError> {
    if pose.position.is_finite() && pose.rotation.is_finite() {
        Ok(())
    } else {
        Err(RenderError::NotFinite { what: what() })
    }
}

/// Surface number of a visibility id: part number plus one, 0 for the background.
#[inline(always)]
pub(crate) fn surface_of(id: u32) -> u32 {
    id >> TRIANGLE_BITS
}

/// Part and triangle of a visibility id; `None` for the background.
#[inline]
pub(crate) fn part_and_triangle(id: u32) -> Option<(usize, usize)> {
    let part = (id >> TRIANGLE_BITS).checked_sub(1)?;
    Some((part as usize, (id & ((1 << TRIANGLE_BITS) - 1)) as usize))
}
