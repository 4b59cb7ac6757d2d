//! Materials of support surfaces and floors: procedural textures.

use crate::scene::patterns::Pattern::{Boards, Brushed, Checks, Concrete, Flecks, Grain, Plain, Tiles, Veins, Weave};
use crate::scene::patterns::{Patterned, named_materials, patterned as top};

/// Side of the square that one repetition of a texture covers (m).
pub(crate) const TOP_SIZE_M: f32 = 1.5;
/// Texels along a side of a texture, each 1.5 mm wide.
const SIZE: u32 = 1024;

named_materials!(
    /// Material of support surfaces and floors, by its name in files and on the command line.
    TableTop,
    "table top",
    TOPS,
    SIZE
);

/// All materials, the default first. Colours and roughness were chosen by hand to match the names; none is so dark or
/// saturated that objects on it would be hard to see.
const TOPS: [Patterned; 32] = [
    top("pale_oak", Grain { bands: 9.0 }, [222, 209, 190], [194, 176, 152], 0.55, 0.0),
    top("oak", Grain { bands: 7.0 }, [205, 170, 125], [160, 122, 78], 0.5, 0.0),
    top("walnut", Grain { bands: 8.0 }, [128, 92, 66], [84, 56, 38], 0.45, 0.0),
    top("cherry", Grain { bands: 6.0 }, [186, 122, 86], [146, 84, 56], 0.45, 0.0),
    top("ash", Grain { bands: 11.0 }, [226, 218, 200], [198, 184, 160], 0.5, 0.0),
    top("teak", Grain { bands: 5.0 }, [172, 126, 78], [122, 84, 48], 0.5, 0.0),
    top("pine_boards", Boards { count: 9 }, [228, 196, 146], [200, 158, 102], 0.55, 0.0),
    top("oak_boards", Boards { count: 7 }, [196, 160, 116], [150, 114, 76], 0.5, 0.0),
    top("walnut_boards", Boards { count: 11 }, [122, 90, 68], [78, 54, 40], 0.5, 0.0),
    top("bamboo", Boards { count: 40 }, [222, 194, 140], [196, 160, 104], 0.45, 0.0),
    top("grey_boards", Boards { count: 8 }, [178, 174, 168], [138, 134, 128], 0.6, 0.0),
    top("white_marble", Veins { share: 0.10 }, [236, 235, 232], [150, 150, 154], 0.25, 0.0),
    top("grey_marble", Veins { share: 0.14 }, [160, 162, 166], [208, 208, 210], 0.25, 0.0),
    top("green_marble", Veins { share: 0.12 }, [72, 104, 90], [160, 190, 172], 0.25, 0.0),
    top("black_marble", Veins { share: 0.08 }, [56, 56, 60], [176, 172, 164], 0.22, 0.0),
    top("grey_granite", Flecks { across: 420, share: 0.42 }, [168, 166, 164], [116, 114, 116], 0.3, 0.0),
    top("red_granite", Flecks { across: 360, share: 0.40 }, [172, 130, 116], [124, 92, 84], 0.3, 0.0),
    top("terrazzo", Flecks { across: 110, share: 0.22 }, [222, 216, 206], [168, 146, 128], 0.35, 0.0),
    top("cork", Flecks { across: 300, share: 0.35 }, [198, 156, 108], [164, 122, 80], 0.85, 0.0),
    top("linen", Weave { threads: 420 }, [216, 206, 188], [182, 170, 150], 0.9, 0.0),
    top("denim", Weave { threads: 480 }, [92, 112, 148], [58, 76, 112], 0.9, 0.0),
    top("green_felt", Weave { threads: 512 }, [76, 124, 92], [60, 104, 76], 0.95, 0.0),
    top("red_checks", Checks { count: 20 }, [236, 232, 226], [178, 62, 58], 0.85, 0.0),
    top("blue_checks", Checks { count: 24 }, [234, 236, 238], [74, 104, 160], 0.85, 0.0),
    top("white_tiles", Tiles { count: 10 }, [232, 232, 228], [150, 148, 144], 0.2, 0.0),
    top("clay_tiles", Tiles { count: 8 }, [188, 116, 84], [120, 96, 84], 0.6, 0.0),
    top("steel", Brushed, [176, 178, 182], [148, 150, 156], 0.4, 0.9),
    top("concrete", Concrete, [176, 174, 170], [140, 138, 134], 0.7, 0.0),
    top("slate", Concrete, [86, 90, 96], [64, 68, 74], 0.55, 0.0),
    top("white_laminate", Plain, [236, 236, 234], [228, 228, 226], 0.35, 0.0),
    top("beige_laminate", Plain, [214, 202, 178], [206, 194, 170], 0.4, 0.0),
    top("blue_laminate", Plain, [120, 148, 176], [112, 140, 168], 0.4, 0.0),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_back_and_differ() {
        for top in TableTop::all() {
            assert_eq!(TableTop::try_from(top.name().to_owned()), Ok(top));
        }
        assert!(TableTop::try_from("gold".to_owned()).unwrap_err().contains("pale_oak"));
        assert!(TableTop::all().len() >= 30);
    }

    /// Textures tile seamlessly: neighbouring texels differ no more across the border than across some line inside,
    /// such as a joint or the edge of a check.
    #[test]
    fn tops_repeat_without_a_seam() {
        const ROWS: u32 = 32;
        for top in &TOPS {
            let at = |x: u32, y: u32| top.pattern.mix(x as f32 / SIZE as f32, y as f32 / SIZE as f32).clamp(0.0, 1.0);
            let along = |pair: &dyn Fn(u32) -> (f32, f32)| {
                let steps = (0..ROWS).map(|row| pair(row * (SIZE / ROWS))).map(|(a, b)| (a - b).abs());
                steps.sum::<f32>() / ROWS as f32
            };
            let across =
                |x: u32, next: u32| along(&|y| (at(x, y), at(next, y))).max(along(&|y| (at(y, x), at(y, next))));
            let seam = across(SIZE - 1, 0);
            let inside = (0..SIZE - 1).map(|x| across(x, x + 1)).fold(0.0, f32::max);
            assert!(seam <= inside, "{}: {seam} over the border, at most {inside} inside", top.name);
        }
    }
}
