//! Axes of perturbations.

use std::fmt;

use genmanip_core::named_enum;

named_enum! {
    /// Axis of a perturbation: those of LIBERO-Plus (Fei et al., 2025), and also physics, distractors and an exchanged
    /// instruction.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Axis {
        /// A new layout of the same task.
        Layout = "layout",
        /// Shifted and rotated cameras.
        Camera = "camera",
        /// Another initial arm configuration.
        RobotStart = "robot_start",
        /// Another light and exposure.
        Light = "light",
        /// Another background behind the table.
        Background = "background",
        /// Another material of the table top.
        Texture = "texture",
        /// Another tint and roughness of the objects, within what their colour words allow.
        Paint = "paint",
        /// Other sensor noise, exposure, white balance and compression of the cameras.
        Sensor = "sensor",
        /// Other friction, mass, restitution, and joint friction.
        Physics = "physics",
        /// Additional objects that the goal does not name.
        Distractors = "distractors",
        /// The same request in other words, with the same goal.
        Wording = "wording",
        /// Another request that the scene allows, with another goal; the original goal is judged as well.
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
