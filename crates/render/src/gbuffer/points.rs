//! Surface points of one part in batches: positions and normals of pixels in the world and in camera axes.

#![allow(clippy::needless_range_loop, reason = "loops over lanes and axes by index are compiled for wide registers")]

use multiversion::multiversion;

use crate::gbuffer::view::{CameraView, PartView};
use crate::scene::assets::{Part, TRIANGLE_BITS};
use crate::simd::{BatchColumn, CHUNK, Column, dot, nearest_integer, turned, whole_registers};

/// Pixel as one number: column in the low half of the bits, row in the high half.
#[inline(always)]
pub(crate) fn packed(column: usize, row: usize) -> u32 {
    column as u32 | (row as u32) << 16
}

/// Column and row of a [`packed`] pixel.
#[inline(always)]
pub(crate) fn unpacked(place: u32) -> [u32; 2] {
    [place & 0xffff, place >> 16]
}

/// Visible opaque surface at each pixel centre of an image.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PixelCenters<'a> {
    /// Width of the image (px).
    pub width: usize,
    /// Visibility id per pixel, row by row; 0 for the background.
    pub ids: &'a [u32],
    /// Depth per pixel along the optical axis (m), row by row; 0 for the background.
    pub depth: &'a [f32],
}

/// Batch of pixels that show one part.
#[derive(Clone, Debug, Default)]
pub(crate) struct Pixels {
    pub count: usize,
    pub pixel: Column<u32>,
    pub column: BatchColumn,
    pub row: BatchColumn,
    pub depth: BatchColumn,
    /// Triangles, as indices into the faces of the part's mesh.
    pub triangle: Column<u32>,
    /// True if all pixels of the batch show the same triangle.
    pub is_flat: bool,
}

/// Mask of the bits of a visibility id that hold the triangle index.
pub(crate) const TRIANGLE: u32 = (1 << TRIANGLE_BITS) - 1;

impl Pixels {
    /// Replaces the batch by [`packed`] pixels, at most `CHUNK`.
    pub fn load(&mut self, places: &[u32], centers: PixelCenters<'_>) {
        self.count = places.len().min(CHUNK);
        place_pixels(self, &places[..self.count], centers.width as u32);
        for i in 0..self.count {
            let pixel = self.pixel[i] as usize;
            (self.depth[i], self.triangle[i]) = (centers.depth[pixel], centers.ids[pixel] & TRIANGLE);
        }
        let first = self.triangle[0];
        self.is_flat = self.triangle[..self.count].iter().fold(0, |differ, &other| differ | (other ^ first)) == 0;
    }
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn place_pixels(pixels: &mut Pixels, places: &[u32], width: u32) {
    for (i, &place) in places.iter().enumerate().take(CHUNK) {
        let [column, row] = unpacked(place);
        pixels.pixel[i] = row * width + column;
        (pixels.column[i], pixels.row[i]) = (column as i32 as f32, row as i32 as f32);
    }
}

/// Batch of surface points of one part.
#[derive(Clone, Debug, Default)]
pub(crate) struct Points {
    pub count: usize,
    pub pixel: Column<u32>,
    pub column: BatchColumn,
    pub row: BatchColumn,
    /// Positions in the world (m).
    pub place: [BatchColumn; 3],
    /// Unit normals of the triangles in the world, on the side of the camera.
    pub normal: [BatchColumn; 3],
    /// Positions (m) and normals in camera axes.
    pub place_in_camera: [BatchColumn; 3],
    pub normal_in_camera: [BatchColumn; 3],
    plane: [BatchColumn; 3],
}

impl Points {
    /// Computes positions and normals of the surface points at `pixels`, which show `part`.
    pub fn fill(&mut self, pixels: &Pixels, part: &Part, placed: &PartView, camera: &CameraView) {
        let faces = &placed.mesh(part).faces;
        self.count = pixels.count;
        self.pixel = pixels.pixel;
        (self.column, self.row) = (pixels.column, pixels.row);
        if pixels.is_flat {
            let [x, y, z, _] = faces[pixels.triangle[0] as usize].plane.to_array();
            self.plane = [x, y, z].map(BatchColumn::of);
        } else {
            for (i, &triangle) in pixels.triangle.iter().enumerate().take(pixels.count) {
                let [x, y, z, _] = faces[triangle as usize].plane.to_array();
                (self.plane[0][i], self.plane[1][i], self.plane[2][i]) = (x, y, z);
            }
        }
        locate(self, &pixels.depth, placed, camera);
    }

    /// Rotation of a point's sampling pattern, in sixteenths of a turn; may exceed 15.
    #[inline(always)]
    pub fn turn(&self, point: usize) -> u8 {
        let pixel = |lane: &BatchColumn| nearest_integer(lane[point]) as usize;
        let (row, column) = (pixel(&self.row), pixel(&self.column));
        PATTERN[row / 2 % 4][column / 2 % 4] + WITHIN[row % 2][column % 2]
    }
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn locate(points: &mut Points, depths: &BatchColumn, placed: &PartView, camera: &CameraView) {
    let camera_from_body = placed.body_from_camera.transpose();
    let columns = [camera_from_body.x_axis, camera_from_body.y_axis, camera_from_body.z_axis].map(|c| c.to_array());
    let turn = [camera.turn.x_axis, camera.turn.y_axis, camera.turn.z_axis].map(|column| column.to_array());
    let viewpoint = camera.viewpoint.to_array();
    let (inverse_x, inverse_y) = (1.0 / camera.focal.x, 1.0 / camera.focal.y);
    for i in 0..whole_registers(points.count) {
        let depth = depths[i];
        let ray =
            [(points.column[i] - camera.center.x) * inverse_x, (points.row[i] - camera.center.y) * inverse_y, 1.0];
        let plane = [points.plane[0][i], points.plane[1][i], points.plane[2][i]];
        let normal = [turned(&columns, 0, plane), turned(&columns, 1, plane), turned(&columns, 2, plane)];
        let side = if dot(normal, ray) > 0.0 { -1.0 } else { 1.0 };
        let normal = [normal[0] * side, normal[1] * side, normal[2] * side];
        let place = [ray[0] * depth, ray[1] * depth, depth];
        for axis in 0..3 {
            points.place_in_camera[axis][i] = place[axis];
            points.normal_in_camera[axis][i] = normal[axis];
            points.place[axis][i] = turned(&turn, axis, place) + viewpoint[axis];
            points.normal[axis][i] = turned(&turn, axis, normal);
        }
    }
}

/// 4×4 Bayer matrix over blocks of 2×2 pixels: rotation of the sampling pattern in sixteenths of a turn, by row and
/// column of the block. Neighbouring blocks differ much, and all sixteen rotations occur.
pub(crate) const PATTERN: [[u8; 4]; 4] = [[0, 8, 2, 10], [12, 4, 14, 6], [3, 11, 1, 9], [15, 7, 13, 5]];
/// Sixteenths of a turn added to the rotation of a block, by row and column of the pixel within it. Modulo 16, an
/// aligned tile of 4×4 pixels contains all rotations; a checkerboard of its pixels, which the shadow pass samples on a
/// single surface, contains every second one.
const WITHIN: [[u8; 2]; 2] = [[0, 1], [3, 2]];
