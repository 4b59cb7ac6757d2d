//! Light from what is near: the table below, bodies around it, the walls of a hollow, and what metal mirrors.

#![allow(clippy::needless_range_loop, reason = "loops over lanes and axes by index are compiled for wide registers")]

use super::{Light, Reflected, Spots, mirrored};
use crate::lanes::{CHUNK, Lane, dot};
use crate::lighting::Lighting;
use crate::occluders::{Hollow, Mirrored, facing_middle};
use crate::table_light::TableLight;
use crate::view::{Lens, PartView};

/// Light of the table, so many metres above which the eye is, on what is close above it.
#[inline(always)]
pub(super) fn look_down<const LANES: usize>(
    light: &Light<'_>,
    eye_height: f32,
    spots: &Spots,
    placed: &PartView,
    out: &mut Reflected,
) {
    let (sky, lit) = (&light.lighting.sky, light.table_lit);
    let up = placed.world_from_body.row(2);
    let at_zero = eye_height - up.dot(placed.eye_in_body);
    let up = up.to_array();
    for i in 0..LANES {
        let place = [spots.place[0][i], spots.place[1][i], spots.place[2][i]];
        let height = dot(up, place) + at_zero;
        let seen = sky.near_table([out.normal[0][i], out.normal[1][i], out.normal[2][i]], height);
        for channel in 0..3 {
            out.around[channel][i] = seen[channel].mul_add(lit, out.around[channel][i]);
        }
    }
}

/// What metal mirrors of a near thing instead of the surroundings.
#[inline(always)]
pub(super) fn mirror_near<const LANES: usize>(
    thing: &Mirrored,
    spots: &Spots,
    lens: &Lens,
    lighting: &Lighting,
    out: &mut Reflected,
) {
    let (eye, axis) = (lens.eye.to_array(), lens.turn.z_axis.to_array());
    let (mut shares, mut normals) = ([0.0; LANES], [[0.0; LANES]; 3]);
    for i in 0..LANES {
        let normal = [out.normal[0][i], out.normal[1][i], out.normal[2][i]];
        let viewer = [out.viewer[0][i], out.viewer[1][i], out.viewer[2][i]];
        let distance = spots.pixels.depth[i] / dot(viewer, axis);
        let along = |axis: usize| viewer[axis].mul_add(distance, eye[axis]);
        let place = [along(0), along(1), along(2)];
        let twice = 2.0 * dot(normal, viewer);
        let (share, [x, y, z]) = thing.meet(place, mirrored(normal, viewer, twice));
        shares[i] = share;
        (normals[0][i], normals[1][i], normals[2][i]) = (x, y, z);
    }
    // Most of the hand mirrors nothing of it.
    if shares.iter().fold(true, |none, &share| none & (share <= 0.0)) {
        return;
    }
    let lamp = [lighting.to_light.to_array(), lighting.key.to_array()];
    for i in 0..LANES {
        let (share, normal) = (shares[i], [normals[0][i], normals[1][i], normals[2][i]]);
        let light = thing.light(share, normal, lighting.sky.diffuse(normal), lamp);
        for channel in 0..3 {
            out.mirrored[channel][i] = out.mirrored[channel][i].mul_add(1.0 - share, light[channel]);
        }
    }
}

/// How much of the key light that enters a hollow reaches places in it.
#[inline(always)]
pub(super) fn find_hollow<const LANES: usize>(hollow: Option<Hollow>, spots: &Spots, out: &mut Reflected) {
    let Some(hollow) = hollow else { return };
    let middle = hollow.middle.to_array();
    for i in 0..LANES {
        let normal = [spots.normal[0][i], spots.normal[1][i], spots.normal[2][i]];
        let toward = [middle[0] - spots.place[0][i], middle[1] - spots.place[1][i], middle[2] - spots.place[2][i]];
        let lengths = dot(normal, normal) * dot(toward, toward) + 1e-20;
        out.hollow[i] = hollow.light * facing_middle(dot(normal, toward) / lengths.sqrt());
    }
}

/// The light of the surroundings at some places on the table among bodies.
#[inline(always)]
pub(super) fn dim_table(table_light: &TableLight, count: usize, place: &[Lane; 3], around: &mut [Lane; 3]) {
    for i in 0..count.min(CHUNK) {
        let [r, g, b, _] = table_light.at(place[0][i], place[1][i]).to_array();
        around[0][i] *= r;
        around[1][i] *= g;
        around[2][i] *= b;
    }
}
