//! Refraction of view rays by solid transparent objects.

#![allow(clippy::needless_range_loop, reason = "loops over lanes and axes by index are compiled for wide registers")]

use multiversion::multiversion;

use super::interface::Interface;
use crate::gbuffer::static_layer::TILE;
use crate::gbuffer::view::CameraView;
use crate::lights::lighting::Lighting;
use crate::matched::look::Look;
use crate::shading::tone_map::tone_map;
use crate::simd::{BatchColumn, CHUNK, Column, dot, nearest_integer, within};

/// Largest displacement of a refracted ray in the image (px): at most the distance by which dirty tiles spread.
const MOST_BENT: f32 = (TILE - 1) as f32;
/// Cosine between the ray inside and the ray behind an object below which the environment is mixed in, and the smaller
/// one below which the environment replaces the image. Both apply only where refraction at the far interface displaces
/// the ray on the opaque surface by more than [`MOST_BENT`] px, and in full from twice that distance. Chosen by hand.
const ASIDE: [f32; 2] = [0.97, 0.85];

/// Batch of refracted view rays.
#[derive(Debug, Default)]
pub(super) struct RefractedRays {
    /// Index of the pixel that shows what each ray hits.
    pub pixel: Column<u32>,
    /// Linear display colour of the environment in the direction of each ray, written only if a weight is above 0, and
    /// its weight (0-1): above 0 where the image cannot show what the ray hits.
    pub around: [BatchColumn; 3],
    pub share: BatchColumn,
    /// Distance along the optical axis from the far interface to the opaque surface (m).
    pub gap: BatchColumn,
    /// True if the rays are refracted, as by a solid object; false if they pass straight.
    pub are_bent: bool,
}

/// Refracts view rays at the near and far interfaces of a solid object; its thickness is the distance between the two.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
pub(super) fn refract(
    [far, near]: &[Interface; 2],
    index_of_refraction: f32,
    camera: &CameraView,
    lighting: &Lighting,
    look: Option<&Look<'_>>,
    out: &mut RefractedRays,
) {
    let lanes = [BatchColumn::default(); 3];
    let (mut first, mut inside, mut behind, mut leaving, mut depth) =
        (lanes, lanes, lanes, lanes, BatchColumn::default());
    let turn = [camera.turn.x_axis, camera.turn.y_axis, camera.turn.z_axis].map(|column| column.to_array());
    let (viewpoint, focal, center) = (camera.viewpoint.to_array(), camera.focal.to_array(), camera.center.to_array());
    for i in 0..CHUNK {
        let place = point_at([near.place[0][i], near.place[1][i]], near.depth[i], [focal, center], &turn, viewpoint);
        let last = point_at([far.place[0][i], far.place[1][i]], far.depth[i], [focal, center], &turn, viewpoint);
        depth[i] = length(less(place, last));
        put(&mut first, i, place);
    }
    let inner = 1.0 / index_of_refraction;
    for i in 0..CHUNK {
        let ray = normalized(less(at(&first, i), viewpoint), [0.0, 0.0, 1.0]);
        put(&mut inside, i, refracted(ray, at(&near.normal, i), inner));
    }
    for i in 0..CHUNK {
        for axis in 0..3 {
            behind[axis][i] = first[axis][i] + inside[axis][i] * depth[i] - viewpoint[axis];
        }
    }
    let last = [camera.width as f32 - 1.0, camera.height as f32 - 1.0];
    let mut pixel = [Column::of(0); 2];
    for axis in 0..2 {
        for i in 0..CHUNK {
            let behind = at(&behind, i);
            let reversed_z = 1.0 / dot(turn[2], behind);
            let place = near.place[axis][i];
            let aside = focal[axis] * dot(turn[axis], behind) * reversed_z + center[axis] - place;
            pixel[axis][i] = nearest_integer(within(place + within(aside, -MOST_BENT, MOST_BENT), 0.0, last[axis]));
        }
    }
    let width = camera.width as u32;
    for i in 0..CHUNK {
        out.pixel[i] = pixel[1][i] * width + pixel[0][i];
    }
    let mut is_aside = false;
    for i in 0..CHUNK {
        let inside = at(&inside, i);
        let after = refracted(inside, at(&far.normal, i), index_of_refraction);
        let cosine = dot(inside, after);
        let share = within((cosine - ASIDE[0]) / (ASIDE[1] - ASIDE[0]), 0.0, 1.0);
        let off = out.gap[i] * (1.0 - cosine * cosine).max(0.0).sqrt() / (cosine.max(0.1) * far.depth[i]) * focal[0];
        let share = share * within(off / MOST_BENT - 1.0, 0.0, 1.0);
        out.share[i] = share;
        is_aside |= share > 0.0;
        put(&mut leaving, i, after);
    }
    if is_aside {
        let glossy = lighting.sky.glossy(0.0);
        for i in 0..CHUNK {
            let light = glossy.at(at(&leaving, i));
            let exposed = [light[0] * lighting.exposure, light[1] * lighting.exposure, light[2] * lighting.exposure];
            let shown = match look {
                Some(look) => look.display(exposed.into()).to_array(),
                None => tone_map(exposed),
            };
            put(&mut out.around, i, shown);
        }
    }
}

#[inline(always)]
fn at(lanes: &[BatchColumn; 3], i: usize) -> [f32; 3] {
    [lanes[0][i], lanes[1][i], lanes[2][i]]
}

#[inline(always)]
fn put(lanes: &mut [BatchColumn; 3], i: usize, [x, y, z]: [f32; 3]) {
    (lanes[0][i], lanes[1][i], lanes[2][i]) = (x, y, z);
}

/// World position (m) of a pixel at a depth along the optical axis (m).
#[inline(always)]
fn point_at(
    pixel: [f32; 2],
    depth: f32,
    [focal, center]: [[f32; 2]; 2],
    turn: &[[f32; 3]; 3],
    viewpoint: [f32; 3],
) -> [f32; 3] {
    let [x, y] = [(pixel[0] - center[0]) / focal[0] * depth, (pixel[1] - center[1]) / focal[1] * depth];
    let mut point = viewpoint;
    for axis in 0..3 {
        point[axis] += turn[0][axis] * x + turn[1][axis] * y + turn[2][axis] * depth;
    }
    point
}

/// Refracted ray of a unit direction at a unit normal; the reflected ray in case of total internal reflection. `ratio`
/// is the index of refraction before the interface divided by that behind it.
#[inline(always)]
fn refracted(along: [f32; 3], normal: [f32; 3], ratio: f32) -> [f32; 3] {
    let facing = -dot(along, normal);
    let behind = 1.0 - ratio * ratio * (1.0 - facing * facing);
    let [on, across] = if behind > 0.0 { [ratio, ratio * facing - behind.sqrt()] } else { [1.0, 2.0 * facing] };
    let mut bent = along;
    for axis in 0..3 {
        bent[axis] = along[axis] * on + normal[axis] * across;
    }
    normalized(bent, along)
}

#[inline(always)]
fn less(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
fn length(vector: [f32; 3]) -> f32 {
    dot(vector, vector).sqrt()
}

/// Normalised vector, or a fallback for zero length.
#[inline(always)]
fn normalized(vector: [f32; 3], otherwise: [f32; 3]) -> [f32; 3] {
    let inverse = 1.0 / length(vector);
    let has_length = inverse > 0.0 && inverse < f32::INFINITY;
    let mut out = otherwise;
    for axis in 0..3 {
        out[axis] = if has_length { vector[axis] * inverse } else { otherwise[axis] };
    }
    out
}
