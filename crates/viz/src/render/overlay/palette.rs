//! Colours of overlays.

use genmanip_agent::image::Color;

/// Qualitative palette, safe for colour blindness: that of M. Okabe and K. Ito, "Color Universal Design" (2008), without
/// black; vermilion is last, so that it is not used for objects of usual scenes. More objects than colours reuse them
/// from the start.
pub(super) const PALETTE: [Color; 7] =
    [[230, 159, 0], [86, 180, 233], [0, 158, 115], [240, 228, 66], [0, 114, 178], [204, 121, 167], [213, 94, 0]];

/// Colour of the past path, of the robot's contact forces, and of x axes.
pub(super) const VERMILION: Color = PALETTE[6];

/// Colour of the future path, and of contact forces without the robot.
pub(super) const SKY: Color = PALETTE[1];
