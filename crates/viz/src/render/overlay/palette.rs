//! Colours of overlays.

use genmanip_agent::image::Color;

/// Colours that people with any kind of colour blindness tell apart: those of M. Okabe and K. Ito, "Color Universal
/// Design" (2008), without black; vermilion stands last, next to no object of usual scenes. They repeat.
pub(super) const PALETTE: [Color; 7] =
    [[230, 159, 0], [86, 180, 233], [0, 158, 115], [240, 228, 66], [0, 114, 178], [204, 121, 167], [213, 94, 0]];

/// Of the palette: what has been, forces of the robot, the x axis.
pub(super) const VERMILION: Color = PALETTE[6];

/// Of the palette: what is to come, other forces.
pub(super) const SKY: Color = PALETTE[1];
