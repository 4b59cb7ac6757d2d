//! Pixels of one part as points of its surface, a chunk at a time, one component of all points beside each other:
//! loops over them are compiled for the widest registers of the machine, and give the same bits on all.

#![allow(clippy::needless_range_loop, reason = "loops over lanes and axes by index are compiled for wide registers")]

use multiversion::multiversion;

use crate::assets::{Part, TRIANGLE_BITS};
use crate::raster::Target;
use crate::view::{Lens, PartView};

/// Points at a time: several of the widest registers, and all components of a chunk fit the first cache.
pub(crate) const CHUNK: usize = 64;

/// Points of one part and the planes they lie in.
#[derive(Clone)]
pub(crate) struct Points {
    pub count: usize,
    pub pixel: [u32; CHUNK],
    /// How a pixel's taps are turned.
    pub turn: [u8; CHUNK],
    /// World frame.
    pub place: [[f32; CHUNK]; 3],
    /// Unit normals of the triangles, towards the viewer, world frame.
    pub normal: [[f32; CHUNK]; 3],
    /// Camera axes.
    pub place_in_camera: [[f32; CHUNK]; 3],
    pub normal_in_camera: [[f32; CHUNK]; 3],
    depth: [f32; CHUNK],
    column: [f32; CHUNK],
    row: [f32; CHUNK],
    plane: [[f32; 4]; CHUNK],
}

impl Default for Points {
    fn default() -> Self {
        let (zero, zeros) = ([0.0; CHUNK], [[0.0; CHUNK]; 3]);
        Self {
            count: 0,
            pixel: [0; CHUNK],
            turn: [0; CHUNK],
            place: zeros,
            normal: zeros,
            place_in_camera: zeros,
            normal_in_camera: zeros,
            depth: zero,
            column: zero,
            row: zero,
            plane: [[0.0; 4]; CHUNK],
        }
    }
}

impl Points {
    /// Becomes the centres of pixels that show a part.
    pub fn fill(
        &mut self,
        pixels: &[u32],
        part: &Part,
        placed: &PartView,
        lens: &Lens,
        opaque: &Target,
        depth: &[f32],
    ) {
        let (width, scale) = (lens.width as u32, opaque.scale);
        let faces = &placed.mesh(part).faces;
        self.count = pixels.len().min(CHUNK);
        for (i, &pixel) in pixels.iter().enumerate().take(CHUNK) {
            let (column, row) = (pixel % width, pixel / width);
            let sample = (row as usize * scale) * opaque.width + column as usize * scale;
            let triangle = (opaque.ids[sample] & ((1 << TRIANGLE_BITS) - 1)) as usize;
            self.pixel[i] = pixel;
            self.turn[i] = PATTERN[row as usize % 4][column as usize % 4];
            self.column[i] = column as i32 as f32;
            self.row[i] = row as i32 as f32;
            self.depth[i] = depth[pixel as usize];
            self.plane[i] = faces[triangle].plane.to_array();
        }
        locate(self, placed, lens);
    }
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl", "x86_64+avx2"))]
fn locate(points: &mut Points, placed: &PartView, lens: &Lens) {
    let camera_from_body = placed.body_from_camera.transpose();
    let columns = [camera_from_body.x_axis, camera_from_body.y_axis, camera_from_body.z_axis].map(|c| c.to_array());
    let turn = [lens.turn.x_axis, lens.turn.y_axis, lens.turn.z_axis].map(|column| column.to_array());
    let eye = lens.eye.to_array();
    let (inverse_x, inverse_y) = (1.0 / lens.focal.x, 1.0 / lens.focal.y);
    for i in 0..CHUNK {
        let depth = points.depth[i];
        let ray = [(points.column[i] - lens.center.x) * inverse_x, (points.row[i] - lens.center.y) * inverse_y, 1.0];
        let plane = points.plane[i];
        let turned = |row: usize| columns[0][row] * plane[0] + columns[1][row] * plane[1] + columns[2][row] * plane[2];
        let normal = [turned(0), turned(1), turned(2)];
        let along = normal[0] * ray[0] + normal[1] * ray[1] + normal[2] * ray[2];
        let side = if along > 0.0 { -1.0 } else { 1.0 };
        let normal = [normal[0] * side, normal[1] * side, normal[2] * side];
        let place = [ray[0] * depth, ray[1] * depth, depth];
        for axis in 0..3 {
            points.place_in_camera[axis][i] = place[axis];
            points.normal_in_camera[axis][i] = normal[axis];
            points.place[axis][i] =
                turn[0][axis] * place[0] + turn[1][axis] * place[1] + turn[2][axis] * place[2] + eye[axis];
            points.normal[axis][i] = turn[0][axis] * normal[0] + turn[1][axis] * normal[1] + turn[2][axis] * normal[2];
        }
    }
}

/// Order of the sixteen turns of the taps within a block: neighbours get far-apart turns.
const PATTERN: [[u8; 4]; 4] = [[0, 8, 2, 10], [12, 4, 14, 6], [3, 11, 1, 9], [15, 7, 13, 5]];
