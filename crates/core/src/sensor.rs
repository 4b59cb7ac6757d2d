//! Sensor models: device parameters that the renderer applies to ideal images.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Sensor model of a camera; a missing channel is ideal.
///
/// Depth and colour share one viewpoint, as in a device with registered depth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CameraSensor {
    /// Depth sensor; `None` for ideal depth.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub depth: Option<DepthSensor>,
    /// Colour sensor; `None` for ideal colour.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub color: Option<ColorSensor>,
}

/// Triangulation depth sensor: an imager with a second imager (active stereo) or a projector (structured light) as
/// partner.
///
/// Depth is `focal_length_px · baseline_m / disparity`, so disparity errors and steps, in device pixels at any image
/// size, cause depth errors that grow with the squared depth.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DepthSensor {
    /// Signed distance from the imager to its partner, to the right, metres. Points visible to only one of the two
    /// have no depth: an occlusion shadow on the left of near objects, which widens with the distance of the
    /// background.
    pub baseline_m: f64,
    /// Focal length of the imager at its measuring resolution, pixels.
    pub focal_length_px: f64,
    /// Horizontal and vertical field of view, degrees; no depth outside.
    pub field_of_view_deg: [f64; 2],
    /// Smallest and largest depth, metres.
    pub range_m: [f64; 2],
    /// Standard deviation of the disparity, device pixels.
    pub disparity_error_px: f64,
    /// Quantisation step of the disparity, device pixels; 0 for none.
    pub disparity_step_px: f64,
    /// Smallest measurable cosine of the angle between surface normal and view direction.
    pub least_cosine: f64,
    /// Smallest measurable return: diffuse albedo times that cosine.
    /// White paper is near 0.9, black plastic near 0.02, glass and polished metal nearly 0.
    pub least_return: f64,
}

/// Maximum exposure time, s; longer ones are rejected as implausible.
pub const MAX_SHUTTER_S: f64 = 0.1;

/// Colour imager with a lens: exposure, white balance, motion blur, vignetting, shot and read noise, compression.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ColorSensor {
    /// Exposure relative to the ideal image, stops: 1 is twice as bright.
    pub exposure_stops: f64,
    /// White balance relative to the ideal image: factors of linear red, green and blue.
    pub white_balance: [f64; 3],
    /// Exposure time, ending at the image's timestamp, seconds: moving objects are blurred. Does not affect
    /// brightness; 0 for no motion blur.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub shutter_s: f64,
    /// Light loss in the corners relative to the centre, 0-1.
    pub vignetting: f64,
    /// Full-well capacity, electrons: shot noise is proportional to the square root of the signal.
    pub full_well_e: f64,
    /// Read noise (standard deviation), electrons.
    pub read_noise_e: f64,
    /// JPEG quality, 1-100; `None` for uncompressed images.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub jpeg_quality: Option<u8>,
}

impl ColorSensor {
    /// An imager that adds nothing but motion blur to an ideal image.
    pub fn perfect(shutter_s: f64) -> Self {
        Self {
            exposure_stops: 0.0,
            white_balance: [1.0; 3],
            shutter_s,
            vignetting: 0.0,
            full_well_e: 1e12,
            read_noise_e: 0.0,
            jpeg_quality: None,
        }
    }
}

fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

/// A named sensor model of a device.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct SensorPreset {
    /// Name on the command line and in world files, e.g. `d435`.
    pub name: &'static str,
    /// Device that the preset models.
    pub what: &'static str,
    /// Source of the numbers, e.g. a data sheet.
    pub source: &'static str,
    /// Depth and colour models of the device.
    pub sensor: CameraSensor,
}

/// Chosen: a small rolling-shutter imager in a well-lit room, with noise barely visible in dark parts.
const ROOM_COLOR: ColorSensor = ColorSensor {
    exposure_stops: 0.0,
    white_balance: [1.0, 1.0, 1.0],
    shutter_s: 0.0,
    vignetting: 0.12,
    full_well_e: 5_000.0,
    read_noise_e: 4.0,
    jpeg_quality: None,
};

const REALSENSE: &str = "baselines and fields of view: Intel RealSense D400 datasheet, 337029. Error 0.08 px and 126 \
     disparities, which set the nearest depth at the recommended resolution: \"Tuning depth cameras for best \
     performance\" (Grunnet-Jepsen et al.). Steps of 1/32 px: \"Subpixel linearity improvement\" (the same authors). \
     Farthest depth, angle, return and colour: chosen";

/// D435 at 848x480; the D415 differs in baseline, lens and derived values.
const D435_DEPTH: DepthSensor = DepthSensor {
    baseline_m: 0.050,
    // Half the width of 848 pixels and the horizontal field of view: 424 / tan(87 degrees / 2).
    focal_length_px: 446.8,
    field_of_view_deg: [87.0, 58.0],
    // Depth at the maximum disparity of 126 pixels: 446.8 px · 0.05 m / 126.
    range_m: [0.177, 6.0],
    disparity_error_px: 0.08,
    disparity_step_px: 1.0 / 32.0,
    least_cosine: 0.17,
    least_return: 0.015,
};

/// Known devices. `least_cosine` and `least_return` are chosen so that black plastic has holes, and glass and mirrors
/// are almost entirely missing.
pub const SENSORS: [SensorPreset; 3] = [
    SensorPreset {
        name: "d435",
        what: "RealSense D435 at 848x480: active stereo, 50 mm",
        source: REALSENSE,
        sensor: CameraSensor { depth: Some(D435_DEPTH), color: Some(ROOM_COLOR) },
    },
    SensorPreset {
        name: "d415",
        what: "RealSense D415 at 1280x720: active stereo, 55 mm",
        source: REALSENSE,
        sensor: CameraSensor {
            depth: Some(DepthSensor {
                baseline_m: 0.055,
                // As for the D435: 640 / tan(65 degrees / 2).
                focal_length_px: 1004.6,
                field_of_view_deg: [65.0, 40.0],
                // As for the D435: 1004.6 px · 0.055 m / 126.
                range_m: [0.439, 6.0],
                ..D435_DEPTH
            }),
            color: Some(ROOM_COLOR),
        },
    },
    SensorPreset {
        name: "structured-light",
        what: "the first Kinect: projected dots, 75 mm",
        source: "Khoshelham and Elberink, \"Accuracy and resolution of Kinect depth data for indoor mapping \
                 applications\", Sensors 12 (2012): depth between two steps 2.85e-3 z² (z in metres), random error half a step, range \
                 0.5 to 5 m; that is 1/8 px at 580 px and 75 mm. Field of view, angle, return and colour: chosen",
        sensor: CameraSensor {
            depth: Some(DepthSensor {
                baseline_m: 0.075,
                focal_length_px: 580.0,
                field_of_view_deg: [57.0, 43.0],
                range_m: [0.5, 5.0],
                disparity_error_px: 1.0 / 16.0,
                disparity_step_px: 1.0 / 8.0,
                least_cosine: 0.2,
                least_return: 0.03,
            }),
            color: Some(ROOM_COLOR),
        },
    },
];

impl SensorPreset {
    /// Preset with this name; `None` if there is none.
    pub fn named(name: &str) -> Option<&'static Self> {
        SENSORS.iter().find(|preset| preset.name == name)
    }

    /// Names of all presets.
    pub fn names() -> [&'static str; SENSORS.len()] {
        SENSORS.map(|preset| preset.name)
    }
}

impl DepthSensor {
    /// Standard deviation of a depth of 1 m, m; grows with the squared depth.
    pub fn error_at_1_m(&self) -> f64 {
        self.disparity_error_px / (self.focal_length_px * self.baseline_m.abs())
    }
}

impl CameraSensor {
    /// The sensor model with a different exposure time; `None` if the result is ideal.
    #[must_use]
    pub fn with_shutter(sensor: Option<Self>, shutter_s: f64) -> Option<Self> {
        let sensor = sensor.unwrap_or_default();
        let color = ColorSensor { shutter_s, ..sensor.color.unwrap_or(ColorSensor::perfect(0.0)) };
        let color = Some(color).filter(|color| *color != ColorSensor::perfect(0.0));
        Some(Self { color, ..sensor }).filter(|sensor| *sensor != Self::default())
    }

    /// Invalid parameters: field path, expected and actual value.
    pub(crate) fn faults(&self) -> Vec<(&'static str, &'static str, String)> {
        let mut faults = Vec::new();
        let mut check = |is_right: bool, place, expected, got: &dyn std::fmt::Debug| {
            if !is_right {
                faults.push((place, expected, format!("{got:?}")));
            }
        };
        let is_positive = |value: f64| value.is_finite() && value > 0.0;
        let is_share = |value: f64| (0.0..=1.0).contains(&value);
        if let Some(it) = &self.depth {
            let is_baseline = it.baseline_m.is_finite() && (1e-3..=1.0).contains(&it.baseline_m.abs());
            check(is_baseline, "depth.baseline_m", "0.001 to 1 m, negative for a partner on the left", &it.baseline_m);
            check(is_positive(it.focal_length_px), "depth.focal_length_px", "more than 0", &it.focal_length_px);
            let is_view = it.field_of_view_deg.iter().all(|angle| *angle > 0.0 && *angle < 180.0);
            check(is_view, "depth.field_of_view_deg", "two angles between 0 and 180", &it.field_of_view_deg);
            let [near, far] = it.range_m;
            let is_range = near >= 0.0 && far.is_finite() && near < far;
            check(is_range, "depth.range_m", "[smaller, larger], metres, 0 or more", &it.range_m);
            for (place, value) in
                [("depth.disparity_error_px", it.disparity_error_px), ("depth.disparity_step_px", it.disparity_step_px)]
            {
                check((0.0..=10.0).contains(&value), place, "0 to 10 pixels", &value);
            }
            check(is_share(it.least_cosine), "depth.least_cosine", "a share from 0 to 1", &it.least_cosine);
            check(is_share(it.least_return), "depth.least_return", "a share from 0 to 1", &it.least_return);
        }
        if let Some(it) = &self.color {
            let stops = it.exposure_stops;
            check((-8.0..=8.0).contains(&stops), "color.exposure_stops", "-8 to 8", &stops);
            let is_balance = it.white_balance.iter().all(|factor| (0.1..=10.0).contains(factor));
            check(is_balance, "color.white_balance", "three factors from 0.1 to 10", &it.white_balance);
            let shutter = it.shutter_s;
            check((0.0..=MAX_SHUTTER_S).contains(&shutter), "color.shutter_s", "0 to 0.1 s", &shutter);
            check(is_share(it.vignetting), "color.vignetting", "a share from 0 to 1", &it.vignetting);
            check(
                it.full_well_e >= 1.0 && it.full_well_e.is_finite(),
                "color.full_well_e",
                "1 or more",
                &it.full_well_e,
            );
            let read = it.read_noise_e;
            check(read.is_finite() && read >= 0.0, "color.read_noise_e", "0 or more", &read);
            let is_quality = it.jpeg_quality.is_none_or(|quality| (1..=100).contains(&quality));
            check(is_quality, "color.jpeg_quality", "1 to 100", &it.jpeg_quality);
        }
        faults
    }
}
