//! Appearance randomisation: render variations sampled from a seed, each appearance factor from its own random stream.

use genmanip_core::glam::{DQuat, DVec3, EulerRot};
use genmanip_core::{AppearanceFactor, AppearanceRandomisation, Camera, CameraMount, Pose, Seed};
use rand::{Rng, RngExt};

use crate::scene::table_tops::TableTop;
use crate::scene::variation::{ObjectVariation, RenderVariation};
use crate::scene::walls::{Room, Wall};

/// Largest translation (m) and rotation (rad) of a camera per axis, by its mount. Chosen by hand: a tripod repositioned
/// by hand, and a bracket with some play.
const TREMBLE: [(CameraMount, f64, f64); 2] = [(CameraMount::World, 0.02, 0.017), (CameraMount::Hand, 0.004, 0.012)];
/// Largest change of an object's paint: relative of each colour channel, absolute of the roughness, and absolute of the
/// metallic parameter of metals. Chosen by hand: visible side by side, but no colour changes its name.
const PAINT: [f32; 3] = [0.10, 0.15, 0.1];

/// Default variation in which the factors `vary` are sampled from a seed.
pub fn sampled(seed: Seed, vary: &[AppearanceFactor]) -> RenderVariation {
    varied(&RenderVariation::default(), &AppearanceRandomisation::new(seed, vary.to_vec()))
}

/// Applies an appearance randomisation to a variation; parts that the randomisation does not name are unchanged.
///
/// The key light comes from 35 to 80 degrees above the table, from any side, with a colour temperature of 3000 K to
/// 7500 K. All ranges are chosen around the default so that everything stays recognisable. The strength interpolates
/// numbers from the given to the sampled value and scales the ranges of the objects' paint; the material of the table
/// top and the room change at any strength above 0.
pub fn varied(usual: &RenderVariation, look: &AppearanceRandomisation) -> RenderVariation {
    let mut variation = usual.clone();
    let share = look.strength as f32;
    for &part in &look.vary {
        // Each factor has its own stream, so that varying another factor does not change this one.
        let own = look.seed.fork(part.name());
        let rng = &mut own.rng();
        match part {
            AppearanceFactor::Light => light(&mut variation, share, rng),
            AppearanceFactor::Background => {
                let drawn = background(rng);
                let mixed =
                    |channel: usize| mix(f32::from(usual.background[channel]), f32::from(drawn[channel]), share);
                variation.background = [0, 1, 2].map(|channel| mixed(channel) as u8);
                // A room cannot be interpolated.
                variation.room = if share > 0.0 { room(rng) } else { usual.room };
                forget_photographs(&mut variation, share);
            }
            AppearanceFactor::Material => {
                let index = rng.random_range(0..TableTop::all().len());
                let drawn = TableTop::all().nth(index).unwrap_or_default();
                // A material cannot be interpolated.
                variation.table_top = if share > 0.0 { drawn } else { usual.table_top };
                variation.table_color = usual.table_color.map(|channel| mix(channel, between(rng, 0.9, 1.0), share));
                variation.table_base = variation.table_base.filter(|_| share == 0.0);
                forget_photographs(&mut variation, share);
            }
            AppearanceFactor::Objects => {
                let (tint, roughness, metallic) = PAINT.map(|most| share * most).into();
                variation.objects = Some(ObjectVariation { seed: own, tint, roughness, metallic });
            }
            AppearanceFactor::Camera => {}
        }
    }
    variation
}

/// Camera with a random perturbation of its pose, drawn from the seed and the camera's name; unchanged unless `vary`
/// contains [`AppearanceFactor::Camera`].
#[must_use]
pub fn moved(camera: &Camera, seed: Seed, vary: &[AppearanceFactor]) -> Camera {
    let tremble =
        TREMBLE.iter().find(|(mount, ..)| *mount == camera.mount).filter(|_| vary.contains(&AppearanceFactor::Camera));
    let Some(&(_, shift_m, turn_rad)) = tremble else { return camera.clone() };
    jittered(camera, shift_m, turn_rad, &mut seed.fork(AppearanceFactor::Camera.name()).fork(&camera.name).rng())
}

/// Camera translated along, and rotated about, the axes of its own optical frame by uniform random amounts of up to
/// `shift_m` and `turn_rad` per axis (intrinsic Euler angles x, y, z).
#[must_use]
pub fn jittered(camera: &Camera, shift_m: f64, turn_rad: f64, rng: &mut impl Rng) -> Camera {
    let mut within = |most: f64| most * (2.0 * rng.random::<f64>() - 1.0);
    let shift = DVec3::new(within(shift_m), within(shift_m), within(shift_m));
    let turn = DQuat::from_euler(EulerRot::XYZ, within(turn_rad), within(turn_rad), within(turn_rad));
    Camera { mount_from_camera: camera.mount_from_camera * Pose::new(shift, turn), ..camera.clone() }
}

fn light(variation: &mut RenderVariation, share: f32, rng: &mut impl Rng) {
    let usual = variation.clone();
    let mixed = |from: [f32; 3], to: [f32; 3]| [0, 1, 2].map(|axis| mix(from[axis], to[axis], share));
    let (azimuth, elevation) = (between(rng, 0.0, std::f32::consts::TAU), between(rng, 0.61, 1.40));
    let direction = [azimuth.cos() * elevation.cos(), azimuth.sin() * elevation.cos(), elevation.sin()];
    variation.light_direction = mixed(usual.light_direction, direction);
    variation.light_color = mixed(usual.light_color, lamp(between(rng, 3000.0, 7500.0)));
    variation.light_intensity = mix(usual.light_intensity, between(rng, 0.40, 0.72), share);
    variation.light_angular_radius = mix(usual.light_angular_radius, between(rng, 0.02, 0.16), share);
    variation.sky_color = mixed(usual.sky_color, lamp(between(rng, 4500.0, 9000.0)));
    variation.ambient_intensity = mix(usual.ambient_intensity, between(rng, 0.28, 0.52), share);
    variation.exposure = mix(usual.exposure, between(rng, 0.9, 1.2), share);
}

/// Removes the photographs, which show another background and table than the sampled ones.
fn forget_photographs(variation: &mut RenderVariation, share: f32) {
    if share > 0.0 {
        variation.looks.iter_mut().for_each(|look| look.photograph = None);
    }
}

/// Linear interpolation, exact at 0 and 1.
fn mix(from: f32, to: f32, share: f32) -> f32 {
    (1.0 - share) * from + share * to
}

/// Background colour: any hue, low saturation, never dark.
fn background(rng: &mut impl Rng) -> [u8; 3] {
    let (hue, saturation, value) = (between(rng, 0.0, 6.0), between(rng, 0.0, 0.3), between(rng, 0.45, 1.0));
    [5.0, 3.0, 1.0].map(|offset: f32| {
        let k = (offset + hue) % 6.0;
        let channel = value * (1.0 - saturation * k.min(4.0 - k).clamp(0.0, 1.0));
        (channel * 255.0) as u8
    })
}

/// Random room with probability 0.75, otherwise `None`.
fn room(rng: &mut impl Rng) -> Option<Room> {
    let wall = Wall::all().nth(rng.random_range(0..Wall::all().len()))?;
    let floor = TableTop::all().nth(rng.random_range(0..TableTop::all().len()))?;
    (rng.random::<f32>() < 0.75).then_some(Room { wall, floor })
}

/// sRGB colour of a black body, largest channel 1: fit by T. Helland, "How to convert temperature (K) to RGB" (2012).
fn lamp(kelvin: f32) -> [f32; 3] {
    let t = kelvin / 100.0;
    let red = if t <= 66.0 { 255.0 } else { 329.7 * (t - 60.0).powf(-0.133_2) };
    let green = if t <= 66.0 { 99.47 * t.ln() - 161.12 } else { 288.12 * (t - 60.0).powf(-0.075_5) };
    let blue = if t >= 66.0 { 255.0 } else { 138.52 * (t - 10.0).ln() - 305.04 };
    let color = [red, green, blue].map(|channel| (channel / 255.0).clamp(0.0, 1.0));
    let brightest = color.into_iter().fold(0.0, f32::max);
    color.map(|channel| channel / brightest)
}

fn between(rng: &mut impl Rng, low: f32, high: f32) -> f32 {
    low + (high - low) * rng.random::<f32>()
}

#[cfg(test)]
mod tests {
    use super::*;
    use genmanip_core::Intrinsics;

    #[test]
    fn each_part_has_its_own_chance() {
        let all = sampled(Seed::new(7), &AppearanceFactor::ALL);
        assert_eq!(all, sampled(Seed::new(7), &AppearanceFactor::ALL));
        assert_ne!(all, sampled(Seed::new(8), &AppearanceFactor::ALL));
        let light = sampled(Seed::new(7), &[AppearanceFactor::Light]);
        assert_eq!(light.light_direction, all.light_direction);
        assert_eq!(light.table_top, TableTop::default());
        assert_eq!(sampled(Seed::new(7), &[]), RenderVariation::default());
        assert_eq!(sampled(Seed::new(7), &[AppearanceFactor::Camera]), RenderVariation::default());
    }

    #[test]
    fn strength_goes_from_the_usual_to_the_drawn() {
        let vary = [AppearanceFactor::Light, AppearanceFactor::Background, AppearanceFactor::Material];
        let (usual, drawn) = (RenderVariation::default(), sampled(Seed::new(7), &vary));
        let full = AppearanceRandomisation::new(Seed::new(7), vary.to_vec());
        let at = |strength| varied(&usual, &AppearanceRandomisation { strength, ..full.clone() });
        assert_eq!(at(0.0), usual);
        assert_eq!(at(1.0), drawn);
        let half = at(0.5);
        assert!((half.exposure - 0.5 * (usual.exposure + drawn.exposure)).abs() < 1e-6);
        let other = varied(&drawn, &AppearanceRandomisation::new(Seed::new(3), vec![AppearanceFactor::Material]));
        assert_eq!((other.exposure, other.background), (drawn.exposure, drawn.background), "the rest stays");
    }

    #[test]
    fn lamps_are_warm_white_and_cold() {
        let [warm, white, cold] = [3000.0, 6600.0, 9000.0].map(lamp);
        assert!(warm[0] > warm[1] && warm[1] > warm[2], "{warm:?}");
        assert!(white.iter().all(|channel| *channel > 0.97), "{white:?}");
        assert!(cold[2] > cold[1] && cold[1] > cold[0], "{cold:?}");
    }

    #[test]
    fn cameras_stay_near_where_they_were() {
        let intrinsics = Intrinsics::from_vertical_fov(64, 36, 0.7);
        for (mount, shift_m, turn_rad) in TREMBLE {
            let usual = Camera::looking_at("viewpoint", DVec3::new(0.4, 0.3, 1.0), DVec3::ZERO, intrinsics);
            let (camera, pose) = (Camera { mount, ..usual.clone() }, usual.mount_from_camera);
            assert_eq!(moved(&camera, Seed::new(3), &[AppearanceFactor::Light]), camera);
            for seed in 0..100 {
                let moved = moved(&camera, Seed::new(seed), &[AppearanceFactor::Camera]).mount_from_camera;
                let (shift, turn) =
                    (moved.position - pose.position, (pose.rotation.inverse() * moved.rotation).to_axis_angle().1);
                assert!(shift.length() > 0.0 && shift.length() < 1.8 * shift_m && turn < 1.8 * turn_rad);
            }
        }
    }
}
