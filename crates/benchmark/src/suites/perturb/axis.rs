//! What can be changed of a scenario.

use std::fmt;
use std::str::FromStr;

/// What is changed; the axes of LIBERO-Plus (Fei et al., 2025), with physics, distractors and an exchanged instruction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axis {
    /// The same task is laid out anew.
    Layout,
    /// Cameras are shifted and turned.
    Camera,
    /// The arm starts from another posture.
    RobotStart,
    /// Light and exposure.
    Light,
    /// What is behind the table.
    Background,
    /// What the table's top is made of.
    Texture,
    /// Tint and roughness of things; every colour word stays true.
    Paint,
    /// Cameras have noise, other exposure and white balance, and compress.
    Sensor,
    /// Friction, mass, bouncing, and friction of joints.
    Physics,
    /// More things stand about.
    Distractors,
    /// The sentence asks for the same in other words.
    Wording,
    /// The sentence asks for something else that the scene allows; both are judged.
    Instruction,
}

impl Axis {
    /// All of them.
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

    /// Whether things may be hidden or out of the picture afterwards.
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
