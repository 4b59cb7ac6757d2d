//! Axes of perturbations.

use std::fmt;

use genmanip_core::named_enum;

named_enum! {
    /// Axis of a perturbation, as in LIBERO-Plus (Fei et al., 2025), with physics, distractors and an exchanged
    /// instruction.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Axis {
        /// A new layout of the same task.
        Layout = "layout",
        /// Camera poses.
        Camera = "camera",
        /// Initial posture of the arm.
        RobotStart = "robot_start",
        /// Light and exposure.
        Light = "light",
        /// Background behind the table.
        Background = "background",
        /// Material of the table top.
        Texture = "texture",
        /// Tint and roughness of objects; every colour word stays true.
        Paint = "paint",
        /// Sensor noise, exposure, white balance and compression of the cameras.
        Sensor = "sensor",
        /// Friction, mass, bouncing, and friction of joints.
        Physics = "physics",
        /// Additional objects.
        Distractors = "distractors",
        /// The same request in other words.
        Wording = "wording",
        /// Another request that the scene allows; both are judged.
        Instruction = "instruction",
    }
}

impl Axis {
    /// True if objects may be occluded or outside the image afterwards.
    pub fn moves_what_is_seen(self) -> bool {
        match self {
            Self::Layout | Self::Camera | Self::Distractors => true,
            Self::RobotStart
            | Self::Light
            | Self::Background
            | Self::Texture
            | Self::Paint
            | Self::Sensor
            | Self::Physics
            | Self::Wording
            | Self::Instruction => false,
        }
    }
}

impl fmt::Display for Axis {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}
