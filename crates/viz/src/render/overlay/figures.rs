//! Overlays of 3D geometry on an image: boxes, grippers, the tool path, contact forces and coordinate frames.

use genmanip_agent::image::Color;
use genmanip_core::geometry::OrientedBox;
use genmanip_core::glam::{DVec2, DVec3};
use genmanip_core::{Pose, Projection};
use genmanip_sim::{BodyId, ContactReport};

use super::grasps::DrawnGrasp;
use super::palette::{PALETTE, SKY, VERMILION};
use super::pen::{Hidden, Pen};

/// Line width, pixels of a 512x288 image. Chosen by hand: visible in a video.
const LINE_PX: f64 = 1.2;
/// Width of the tool path, pixels of a 512x288 image.
const WAY_PX: f64 = 1.6;
/// Length of the fingers and the stem of a drawn gripper, m: about those of the Panda's hand.
const FINGER_M: f64 = 0.045;
/// Offset of a drawn finger line from the contact, outwards and along the approach direction, m: half of a finger's
/// thickness.
const FINGER_HALF_M: f64 = 0.008;
/// Minimum spacing of the points of a drawn path, m. Chosen by hand: less than a pixel of usual cameras.
const STEP_M: f64 = 0.004;
/// Minimum normal force that is drawn, N: below it is the noise of objects at rest.
const MIN_FORCE_N: f64 = 0.05;
/// Length of the arrow of a force of 1 N, m; lengths grow with the square root of the force, so that both 0.1 N and 60
/// N are visible.
const NEWTON_M: f64 = 0.015;
/// Length of the drawn axes of a frame, m.
const AXIS_M: f64 = 0.17;
/// Cap height of the axis letters, pixels of a 512x288 image.
const LETTER_PX: f64 = 8.0;
/// Colours of the x, y and z axes.
const AXES: [Color; 3] = [VERMILION, PALETTE[2], PALETTE[4]];

/// Edges of bounding boxes, dashed where occluded.
pub(super) fn boxes(pen: &mut Pen, boxes: &[OrientedBox]) {
    for (placed, color) in boxes.iter().zip(PALETTE.iter().cycle()) {
        let corners = placed.corners();
        for [from, to] in OrientedBox::EDGES {
            pen.line(corners[from], corners[to], LINE_PX, *color, Hidden::Dashed);
        }
    }
}

/// Gripper at a grasp: lines for two fingers, the palm and a stem against the approach direction.
pub(super) fn gripper(pen: &mut Pen, drawn: &DrawnGrasp) {
    let color = PALETTE[drawn.object % PALETTE.len()];
    let grasp = &drawn.grasp;
    let at = |side: f64, back_m: f64| {
        let half_m = 0.5 * grasp.width + FINGER_HALF_M;
        grasp.pose.transform_point(DVec3::new(0.0, side * half_m, FINGER_HALF_M - back_m))
    };
    for (from, to) in [
        (at(-1.0, 0.0), at(-1.0, FINGER_M)),
        (at(1.0, 0.0), at(1.0, FINGER_M)),
        (at(-1.0, FINGER_M), at(1.0, FINGER_M)),
        (at(0.0, FINGER_M), at(0.0, 2.0 * FINGER_M)),
    ] {
        pen.line(from, to, 1.3 * LINE_PX, color, Hidden::Dashed);
    }
}

/// Path of the tool through positions in the world frame (m): thick up to index `now`, thin after it, with a dot at the
/// current position.
pub(super) fn path(pen: &mut Pen, tools: &[DVec3], now: usize) {
    let now = now.min(tools.len().saturating_sub(1));
    let Some(tool) = tools.get(now) else { return };
    let ahead = thinned(&tools[now..]);
    let behind = thinned(&tools[..=now]);
    for (points, width, color) in [(ahead, 0.6 * WAY_PX, SKY), (behind, WAY_PX, VERMILION)] {
        pen.polyline(&points, width, color, Hidden::Shown);
    }
    pen.dot(*tool, 2.0 * WAY_PX, VERMILION);
}

/// Path downsampled to points at least [`STEP_M`] apart; the first and last point are kept.
fn thinned(points: &[DVec3]) -> Vec<DVec3> {
    let mut kept: Vec<DVec3> = Vec::new();
    for (index, point) in points.iter().enumerate() {
        let is_apart = kept.last().is_none_or(|last| last.distance(*point) >= STEP_M);
        if is_apart || index + 1 == points.len() {
            kept.push(*point);
        }
    }
    kept
}

/// Arrows of the normal contact forces on objects and on whatever the robot touches. Forces exerted or borne by the
/// robot have another colour; contacts within the robot are omitted.
pub(super) fn contacts(pen: &mut Pen, contacts: &[ContactReport]) {
    let is_object = |body: BodyId| matches!(body, BodyId::Object { .. });
    let is_robot = |body: BodyId| matches!(body, BodyId::Robot { .. });
    for contact in contacts.iter().filter(|contact| contact.normal_force >= MIN_FORCE_N) {
        if is_robot(contact.a) && is_robot(contact.b) {
            continue;
        }
        // The normal points from a to b, so a force along the normal acts on b.
        let is_on_a = is_robot(contact.b) || (is_object(contact.a) && !is_object(contact.b) && !is_robot(contact.a));
        let way = if is_on_a { -contact.normal } else { contact.normal };
        let by_robot = is_robot(contact.a) || is_robot(contact.b);
        let length_m = NEWTON_M * contact.normal_force.sqrt();
        let color = if by_robot { VERMILION } else { SKY };
        // The tip of the arrow is the contact point.
        pen.arrow(contact.position - way * length_m, contact.position, LINE_PX, color);
    }
}

/// Axes of the world, of the tool and of the other cameras, view frustums of those cameras, and the pixel axes of the
/// image.
pub(super) fn frames(pen: &mut Pen, tool: &Pose, others: &[(String, Projection)]) {
    axes(pen, &Pose::IDENTITY, "WORLD");
    axes(pen, tool, "TOOL");
    for (name, projection) in others {
        sight(pen, projection);
        axes(pen, &projection.world_from_camera, name);
    }
    pixel_axes(pen);
}

fn axes(pen: &mut Pen, world_from_frame: &Pose, name: &str) {
    let at = |way: DVec3, length_m: f64| world_from_frame.transform_point(way * length_m);
    for ((way, color), letter) in [DVec3::X, DVec3::Y, DVec3::Z].into_iter().zip(AXES).zip(["X", "Y", "Z"]) {
        pen.arrow(world_from_frame.position, at(way, AXIS_M), 1.4 * LINE_PX, color);
        if let Some((pixel, _)) = pen.projection.pixel(at(way, 1.2 * AXIS_M)) {
            pen.label(letter, pixel, LETTER_PX, color);
        }
    }
    let Some((origin, _)) = pen.projection.pixel(world_from_frame.position) else { return };
    // The name is placed opposite to the mean direction of the axes in the image.
    let tips = [DVec3::X, DVec3::Y, DVec3::Z].iter().filter_map(|way| pen.projection.pixel(at(*way, AXIS_M)));
    let lead: DVec2 = tips.map(|(tip, _)| tip - origin).sum();
    let away = -lead.try_normalize().unwrap_or(DVec2::NEG_Y);
    let half = 0.5 * super::pen::width(name, 0.8 * LETTER_PX);
    let reach = DVec2::new(half + 0.7 * LETTER_PX, 1.1 * LETTER_PX) * pen.picture.unit();
    pen.label(name, origin + away * reach, 0.8 * LETTER_PX, [255; 3]);
}

/// Edges of a camera's view frustum up to depth [`AXIS_M`].
fn sight(pen: &mut Pen, projection: &Projection) {
    let k = &projection.intrinsics;
    let (right, bottom) = (f64::from(k.width) - 0.5, f64::from(k.height) - 0.5);
    let corners = [(-0.5, -0.5), (right, -0.5), (right, bottom), (-0.5, bottom)];
    let corners = corners.map(|(x, y)| projection.point(DVec2::new(x, y), AXIS_M));
    for (index, corner) in corners.iter().enumerate() {
        let Some((corner, next)) = corner.zip(corners[(index + 1) % 4]) else { continue };
        pen.line(projection.world_from_camera.position, corner, 0.6 * LINE_PX, [255; 3], Hidden::Shown);
        pen.line(corner, next, 0.6 * LINE_PX, [255; 3], Hidden::Shown);
    }
}

/// Pixel axes at the upper left corner of the image: u to the right, v down.
fn pixel_axes(pen: &mut Pen) {
    let unit = pen.picture.unit();
    let from = DVec2::splat(6.0 * unit);
    for (way, name, color) in [(DVec2::X, "U", AXES[0]), (DVec2::Y, "V", AXES[1])] {
        let tip = from + way * (44.0 * unit);
        pen.picture.line(from.to_array(), tip.to_array(), 3.0 * unit, [0; 3]);
        pen.picture.line(from.to_array(), tip.to_array(), 1.6 * unit, color);
        pen.head(from, tip, 1.6, color);
        pen.label(name, tip + way * (9.0 * unit), LETTER_PX, color);
    }
    pen.label("(0, 0)", from + DVec2::new(20.0, 13.0) * unit, 0.7 * LETTER_PX, [255; 3]);
}
