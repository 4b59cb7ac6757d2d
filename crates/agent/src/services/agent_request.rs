//! Request to the agent over HTTP: one RGB-D image, joint positions and an instruction.

use genmanip_core::{Intrinsics, Pose, Seed};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::masks::decode_image;
use crate::ActQuestion;

/// Maximum length of an instruction (bytes). Chosen by hand: bounds the cost of prompts.
const MAX_INSTRUCTION: usize = 4096;

/// Request body of `POST /agent`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ActRequest {
    /// Size and projection of the image.
    pub intrinsics: Intrinsics,
    /// Camera pose in the robot's base frame; camera axes x right, y down, z forward; base z is up.
    pub world_from_camera: Pose,
    /// Colour: three bytes per pixel, row by row from the top left, 8-bit sRGB, in base64.
    pub rgb: String,
    /// Depth along the optical axis (m): 32-bit little-endian floats in the same order, 0 for none, in base64.
    pub depth_m: String,
    /// Arm joint positions (rad).
    pub joints: Vec<f64>,
    /// Gripper opening (m).
    pub gripper_width_m: f64,
    /// Instruction in natural language.
    pub instruction: String,
    /// Seed of grasp sampling and motion planning.
    #[serde(default)]
    pub seed: u64,
}

impl ActRequest {
    /// Validates the request for an arm with `arm_dof` joints.
    ///
    /// # Errors
    /// Describes the inconsistency.
    pub fn read(&self, arm_dof: usize) -> Result<ActQuestion, String> {
        let image = decode_image(self.intrinsics, self.world_from_camera, &self.rgb, Some(&self.depth_m))?;
        if self.joints.len() != arm_dof || !self.joints.iter().all(|joint| joint.is_finite()) {
            return Err(format!("joints has {} numbers, expected {arm_dof} finite ones, rad", self.joints.len()));
        }
        if !(0.0..1.0).contains(&self.gripper_width_m) {
            return Err(format!("gripper_width_m is {}, expected a gripper opening below 1 m", self.gripper_width_m));
        }
        let length = self.instruction.len();
        if self.instruction.trim().is_empty() || length > MAX_INSTRUCTION {
            return Err(format!("instruction has {length} bytes, expected 1 to {MAX_INSTRUCTION}"));
        }
        Ok(ActQuestion {
            image,
            joints: self.joints.clone(),
            gripper_width_m: self.gripper_width_m,
            instruction: self.instruction.clone(),
            seed: Seed::new(self.seed),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use base64::Engine;
    use base64::engine::general_purpose::STANDARD;

    fn request() -> ActRequest {
        ActRequest {
            intrinsics: Intrinsics::from_vertical_fov(2, 1, 0.6),
            world_from_camera: Pose::IDENTITY,
            rgb: STANDARD.encode([1, 2, 3, 4, 5, 6]),
            depth_m: STANDARD.encode([0.5_f32, 1.0].map(f32::to_le_bytes).concat()),
            joints: vec![0.0; 7],
            gripper_width_m: 0.08,
            instruction: "Put the apple on the plate.".into(),
            seed: 3,
        }
    }

    #[test]
    fn what_fits_is_read() {
        let question = request().read(7).unwrap();
        assert_eq!((question.image.rgb, question.image.depth_m), (vec![1, 2, 3, 4, 5, 6], vec![0.5, 1.0]));
        assert_eq!((question.seed, question.joints.len()), (Seed::new(3), 7));
    }

    #[test]
    fn what_does_not_fit_is_named() {
        type Spoil = fn(&mut ActRequest);
        let cases: [(Spoil, &str); 6] = [
            (|it| it.joints.truncate(6), "joints has 6 numbers, expected 7 finite ones"),
            (|it| it.joints[2] = f64::NAN, "joints has 7 numbers, expected 7 finite ones"),
            (|it| it.gripper_width_m = 80.0, "gripper_width_m is 80, expected a gripper opening"),
            (|it| it.instruction = "  ".into(), "instruction has 2 bytes, expected 1 to 4096"),
            (|it| it.depth_m = String::new(), "depth_m has 0 bytes, expected 8"),
            (|it| it.intrinsics.fx = 0.0, "no focal length"),
        ];
        for (spoil, expected) in cases {
            let mut request = request();
            spoil(&mut request);
            let error = request.read(7).unwrap_err();
            assert!(error.contains(expected), "{error}");
        }
    }
}
