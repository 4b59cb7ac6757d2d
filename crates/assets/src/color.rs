//! Colours, written `#rrggbb` in recipes.

use serde::{Deserialize, Deserializer};

/// sRGB colour, each channel 0-1; `#rrggbb` in JSON.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Color(pub [f32; 3]);

impl Color {
    /// Parses a colour written `#rrggbb`; `None` for anything else.
    pub fn parse(text: &str) -> Option<Self> {
        let digits = text.strip_prefix('#').filter(|digits| digits.len() == 6)?;
        let value = u32::from_str_radix(digits, 16).ok()?;
        Some(Self([16, 8, 0].map(|shift| ((value >> shift) & 255) as f32 / 255.0)))
    }
}

impl<'de> Deserialize<'de> for Color {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = String::deserialize(deserializer)?;
        let color = Self::parse(&text);
        color.ok_or_else(|| serde::de::Error::custom(format!("expected a colour #rrggbb, got \"{text}\"")))
    }
}
