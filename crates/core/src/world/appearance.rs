//! Measured appearance of a workspace: light, table colour, materials of objects, and response and photograph of each
//! camera.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::fault::WorldFault;
use crate::{AssetUid, Camera};

/// Appearance measured from photographs of a real workspace; images of the world are rendered to look like them.
///
/// Scene-linear values are relative: a white matt surface that faces up in the open has about the radiance 1, and
/// exposure and white balance of the cameras map it to their images.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WorkspaceAppearance {
    /// Light; `None` for the default light.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub light: Option<WorkspaceLight>,
    /// Base colour of the table, linear RGB, 0-1, without texture; `None` for the default material.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub table_color: Option<[f64; 3]>,
    /// Measured materials of objects, at most one entry per part of an object.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub materials: Vec<MeasuredMaterial>,
    /// Measured cameras, at most one entry per camera of the world.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub cameras: Vec<CameraAppearance>,
}

/// One key light and ambient light.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WorkspaceLight {
    /// Direction from the scene towards the key light, world frame; any length.
    pub direction: [f64; 3],
    /// Angular radius of the key light, rad, which determines the width of penumbrae.
    pub angular_radius_rad: f64,
    /// Radiance of a white matt surface that faces the key light and gets no other light, linear RGB.
    pub key: [f64; 3],
    /// Radiance of a white matt surface that faces up and gets ambient light only, linear RGB.
    pub ambient: [f64; 3],
}

/// Measured material of one part of an object, wherever that object stands.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MeasuredMaterial {
    /// Object.
    pub object: AssetUid,
    /// Name of the object's visual part.
    pub part: String,
    /// Factors on the part's linear base colour, which the texture keeps multiplying.
    pub color_factor: [f64; 3],
    /// Roughness, 0.05-1; `None` for that of the object's file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub roughness: Option<f64>,
}

impl MeasuredMaterial {
    /// True for the material of this part of an object.
    pub fn is_of(&self, object: &AssetUid, part: &str) -> bool {
        self.object == *object && self.part == part
    }
}

/// Measured appearance of one camera's images.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CameraAppearance {
    /// Name of a camera of the world.
    pub camera: String,
    /// From radiance to the camera's pixel values.
    pub response: CameraResponse,
    /// The camera's image of the empty workspace, which replaces surfaces and background in rendered images; fixed
    /// cameras only. `None` to render them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub photograph: Option<Photograph>,
}

/// Response of a camera from scene-linear radiance to display-linear pixel values, which are then encoded as sRGB.
///
/// The radiance is multiplied channel by channel with exposure and white balance, then with the colour matrix; each
/// channel x then passes the tone curve (p + v) xᶜ / (p xᶜ + 1) with c the contrast, v = w⁻ᶜ, w the white level, and p
/// such that 0.18 is mapped to itself; the result is limited to 0-1.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CameraResponse {
    /// Factor on the radiance.
    pub exposure: f64,
    /// Factors of red, green and blue; their Rec. 709 luminance is 1 by convention.
    pub white_balance: [f64; 3],
    /// Colour matrix, row by row; rows add up to 1 by convention, so that grey stays grey.
    pub matrix: [[f64; 3]; 3],
    /// Slope of the tone curve at dark values, in stops per stop.
    pub contrast: f64,
    /// White level: value before the tone curve that becomes 1.
    pub white: f64,
}

/// A camera's image of the empty workspace.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Photograph {
    /// Base64 of a JPEG file with the size of the camera's images.
    pub jpeg: String,
}

/// Value that every tone curve maps to itself: a grey card's reflectance.
pub const MIDDLE_GREY: f64 = 0.18;

impl Default for CameraResponse {
    fn default() -> Self {
        let matrix = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        Self { exposure: 1.0, white_balance: [1.0; 3], matrix, contrast: 1.0, white: 1.0 }
    }
}

/// Tone curve of a [`CameraResponse`], prepared for evaluation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ToneCurve {
    contrast: f64,
    offset: f64,
    bend: f64,
    white: f64,
}

impl ToneCurve {
    /// Display-linear value, 0-1, of a value before the curve.
    pub fn display(&self, value: f64) -> f64 {
        let raised = value.clamp(0.0, self.white).powf(self.contrast);
        ((self.bend + self.offset) * raised / (self.bend * raised + 1.0)).min(1.0)
    }

    /// Value before the curve of a display-linear value, limited to 0-1: inverse of [`ToneCurve::display`].
    pub fn scene(&self, display: f64) -> f64 {
        let display = display.clamp(0.0, 1.0);
        (display / (self.bend + self.offset - self.bend * display)).powf(1.0 / self.contrast)
    }
}

impl CameraResponse {
    /// Tone curve; `None` if contrast and white level give no rising curve.
    pub fn tone(&self) -> Option<ToneCurve> {
        let (contrast, white) = (self.contrast, self.white);
        let offset = white.powf(-contrast);
        let grey = MIDDLE_GREY.powf(contrast);
        let bend = (MIDDLE_GREY - grey * offset) / (grey * (1.0 - MIDDLE_GREY));
        let rises = [contrast, offset].iter().all(|value| value.is_finite() && *value > 0.0)
            && bend.is_finite()
            && bend + offset > 0.0;
        rises.then_some(ToneCurve { contrast, offset, bend, white })
    }

    /// Gains of red, green and blue: exposure times white balance.
    pub fn gains(&self) -> [f64; 3] {
        self.white_balance.map(|factor| factor * self.exposure)
    }

    fn faults(&self, place: &str, faults: &mut Vec<WorldFault>) {
        let mut check = |is_right: bool, name: &str, expected: &str, got: String| {
            if !is_right {
                faults.push(WorldFault::new(format!("{place}.{name}"), expected, got));
            }
        };
        check(
            (1e-3..=1e3).contains(&self.exposure),
            "exposure",
            "a factor of 0.001 to 1000",
            self.exposure.to_string(),
        );
        let balanced = self.white_balance.iter().all(|factor| (0.01..=100.0).contains(factor));
        check(balanced, "white_balance", "three factors of 0.01 to 100", format!("{:?}", self.white_balance));
        let matrix = glam::DMat3::from_cols_array_2d(&self.matrix);
        let invertible = matrix.is_finite() && matrix.determinant().abs() > 1e-3;
        check(invertible, "matrix", "an invertible matrix of three rows", format!("{:?}", self.matrix));
        let got = format!("contrast {}, white {}", self.contrast, self.white);
        let rises = (0.2..=5.0).contains(&self.contrast) && (0.2..=100.0).contains(&self.white);
        let expected = "contrast of 0.2 to 5 and white of 0.2 to 100 that give a rising tone curve";
        check(rises && self.tone().is_some(), "contrast", expected, got);
    }
}

impl WorkspaceAppearance {
    /// Entry of a camera; `None` if it was not measured.
    pub fn camera(&self, name: &str) -> Option<&CameraAppearance> {
        self.cameras.iter().find(|entry| entry.camera == name)
    }

    /// All faults for a world with these cameras.
    pub(super) fn faults(&self, cameras: &[Camera]) -> Vec<WorldFault> {
        let mut faults = Vec::new();
        if let Some(light) = &self.light {
            let direction = glam::DVec3::from_array(light.direction);
            if !(direction.is_finite() && direction.length() > 1e-6 && direction.z >= 0.0) {
                let got = format!("{:?}", light.direction);
                faults.push(WorldFault::new("appearance.light.direction", "a direction from above the table", got));
            }
            if !(0.0..=1.0).contains(&light.angular_radius_rad) {
                let got = light.angular_radius_rad;
                faults.push(WorldFault::new("appearance.light.angular_radius_rad", "0 to 1 rad", got));
            }
            for (name, values) in [("key", light.key), ("ambient", light.ambient)] {
                if !values.iter().all(|value| (0.0..=100.0).contains(value)) {
                    let place = format!("appearance.light.{name}");
                    faults.push(WorldFault::new(place, "three numbers from 0 to 100", format!("{values:?}")));
                }
            }
        }
        if let Some(color) = self.table_color.filter(|color| !color.iter().all(|value| (0.0..=1.0).contains(value))) {
            let got = format!("{color:?}");
            faults.push(WorldFault::new("appearance.table_color", "three numbers from 0 to 1, linear RGB", got));
        }
        for (index, entry) in self.materials.iter().enumerate() {
            let place = format!("appearance.materials[{index}]");
            if self.materials[..index].iter().any(|it| it.is_of(&entry.object, &entry.part)) {
                let got = format!("a second one of `{}`, part `{}`", entry.object, entry.part);
                faults.push(WorldFault::new(&*place, "one entry per part of an object", got));
            }
            if !entry.color_factor.iter().all(|factor| (0.0..=100.0).contains(factor)) {
                let got = format!("{:?}", entry.color_factor);
                faults.push(WorldFault::new(format!("{place}.color_factor"), "three factors of 0 to 100", got));
            }
            if let Some(roughness) = entry.roughness.filter(|it| !(0.05..=1.0).contains(it)) {
                faults.push(WorldFault::new(format!("{place}.roughness"), "0.05 to 1", roughness));
            }
        }
        for (index, entry) in self.cameras.iter().enumerate() {
            let place = format!("appearance.cameras[{index}]");
            let known = cameras.iter().find(|camera| camera.name == entry.camera);
            let twin = self.cameras[..index].iter().any(|other| other.camera == entry.camera);
            if known.is_none() || twin {
                let expected = if twin { "one entry per camera" } else { "the name of a camera of this world" };
                faults.push(WorldFault::new(format!("{place}.camera"), expected, format!("`{}`", entry.camera)));
            }
            entry.response.faults(&format!("{place}.response"), &mut faults);
            let moves = known.is_some_and(|camera| camera.mount != crate::CameraMount::World);
            if entry.photograph.is_some() && moves {
                let expected = "photographs of fixed cameras only";
                faults.push(WorldFault::new(format!("{place}.photograph"), expected, "one of a camera on the hand"));
            }
        }
        faults
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every tone curve rises, keeps middle grey and maps the white level to 1; the default changes nothing.
    #[test]
    fn tone_curves_keep_middle_grey() {
        for (contrast, white) in [(1.0, 1.0), (0.8, 1.0), (1.3, 1.6), (1.6, 4.0), (0.7, 0.9)] {
            let response = CameraResponse { contrast, white, ..CameraResponse::default() };
            let tone = response.tone().expect("a curve that rises");
            let at = |value: f64| tone.display(value);
            assert!((at(MIDDLE_GREY) - MIDDLE_GREY).abs() < 1e-12 && (at(white) - 1.0).abs() < 1e-9, "{contrast}");
            for step in 1..=100 {
                let value = 0.01 * f64::from(step) * white;
                assert!(at(value) > at(value - 0.01 * white) && (tone.scene(at(value)) - value).abs() < 1e-9 * white);
                if contrast == 1.0 && white == 1.0 {
                    assert!((at(value) - value).abs() < 1e-12);
                }
            }
        }
        assert_eq!(CameraResponse { contrast: 0.0, ..CameraResponse::default() }.tone(), None);
    }
}
