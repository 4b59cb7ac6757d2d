//! Axes of perturbations.

use std::fmt;
use std::str::FromStr;

/// Axis of a perturbation, as in LIBERO-Plus (Fei et al., 2025), with physics, distractors and an exchanged
/// instruction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axis {
    /// A new layout of the same task.
    Layout,
    /// Camera poses.
    Camera,
    /// Initial posture of the arm.
    RobotStart,
    /// Light and exposure.
    Light,
    /// Background behind the table.
    Background,
    /// Material of the table top.
    Texture,
    /// Tint and roughness of objects; every colour word stays true.
    Paint,
    /// Sensor noise, exposure, white balance and compression of the cameras.
    Sensor,
    /// Friction, mass, bouncing, and friction of joints.
    Physics,
    /// Additional objects.
    Distractors,
    /// The same request in other words.
    Wording,
    /// Another request that the scene allows; both are judged.
    Instruction,
}

impl Axis {
    /// All axes.
    pub const ALL: [Self; 12] = [
        Self::Layout,
        Self::Camera,
        Self::RobotStart,
        Self::Light,
        Self::Background,
        Self::Texture,
        Self::Paint,
        Self::Sensor,
        Self::Physics,
        Self::Distractors,
        Self::Wording,
        Self::Instruction,
    ];

    /// The name in files and on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Layout => "layout",
            Self::Camera => "camera",
            Self::RobotStart => "robot_start",
            Self::Light => "light",
            Self::Background => "background",
            Self::Texture => "texture",
            Self::Paint => "paint",
            Self::Sensor => "sensor",
            Self::Physics => "physics",
            Self::Distractors => "distractors",
            Self::Wording => "wording",
            Self::Instruction => "instruction",
        }
    }

    /// True if objects may be occluded or outside the image afterwards.
    pub fn moves_what_is_seen(self) -> bool {
        matches!(self, Self::Layout | Self::Camera | Self::Distractors)
    }
}

impl fmt::Display for Axis {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Axis {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let names = Self::ALL.map(Self::name);
        let found = Self::ALL.into_iter().find(|axis| axis.name() == text);
        found.ok_or_else(|| format!("there is no axis `{text}`; expected one of {}", names.join(", ")))
    }
}
