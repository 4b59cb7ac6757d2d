//! Materials of walls: procedural textures.

use serde::{Deserialize, Serialize};

use crate::scene::patterns::Pattern::{
    Boards, Bricks, Checks, Concrete, Dots, Folds, Plain, Stripes, Tiles, Veins, Weave,
};
use crate::scene::patterns::{Patterned, named_materials, patterned as wall};
use crate::scene::table_tops::TableTop;

/// Side of the square that one repetition of a texture covers (m).
pub(crate) const WALL_SIZE_M: f32 = 2.4;
/// Texels along a side of a texture, each about 4.7 mm wide on the wall.
const SIZE: u32 = 512;

named_materials!(
    /// Wall material, by its name in files.
    Wall,
    "wall",
    WALLS,
    SIZE
);

/// All wall materials. Colours were chosen by hand to match the names.
const WALLS: [Patterned; 32] = [
    wall("white_paint", Plain, [232, 231, 228], [224, 223, 220], 0.8, 0.0),
    wall("cream_paint", Plain, [232, 222, 200], [224, 214, 192], 0.8, 0.0),
    wall("grey_paint", Plain, [168, 170, 172], [160, 162, 164], 0.8, 0.0),
    wall("charcoal_paint", Plain, [74, 76, 80], [68, 70, 74], 0.8, 0.0),
    wall("sage_paint", Plain, [164, 178, 156], [156, 170, 148], 0.8, 0.0),
    wall("sky_paint", Plain, [168, 192, 210], [160, 184, 202], 0.8, 0.0),
    wall("navy_paint", Plain, [62, 78, 108], [56, 72, 102], 0.8, 0.0),
    wall("terracotta_paint", Plain, [190, 122, 96], [182, 114, 88], 0.8, 0.0),
    wall("mustard_paint", Plain, [206, 172, 92], [198, 164, 84], 0.8, 0.0),
    wall("rose_paint", Plain, [212, 176, 174], [204, 168, 166], 0.8, 0.0),
    wall("lime_plaster", Concrete, [226, 220, 208], [200, 192, 178], 0.9, 0.0),
    wall("clay_plaster", Concrete, [196, 164, 132], [170, 138, 108], 0.9, 0.0),
    wall("raw_concrete", Concrete, [164, 162, 158], [132, 130, 126], 0.8, 0.0),
    wall("red_brick", Bricks { rows: 36 }, [166, 92, 72], [196, 188, 176], 0.9, 0.0),
    wall("white_brick", Bricks { rows: 36 }, [226, 224, 218], [186, 184, 178], 0.8, 0.0),
    wall("yellow_brick", Bricks { rows: 30 }, [204, 172, 122], [176, 166, 150], 0.9, 0.0),
    wall("grey_blocks", Bricks { rows: 12 }, [170, 170, 168], [138, 138, 136], 0.9, 0.0),
    wall("pine_panels", Boards { count: 20 }, [216, 180, 130], [186, 142, 90], 0.6, 0.0),
    wall("oak_panels", Boards { count: 16 }, [178, 140, 98], [134, 100, 66], 0.6, 0.0),
    wall("white_panels", Boards { count: 24 }, [228, 226, 220], [204, 202, 196], 0.6, 0.0),
    wall("white_wall_tiles", Tiles { count: 24 }, [230, 232, 230], [170, 170, 168], 0.2, 0.0),
    wall("green_wall_tiles", Tiles { count: 24 }, [112, 152, 132], [186, 190, 184], 0.2, 0.0),
    wall("blue_wall_tiles", Tiles { count: 20 }, [98, 130, 166], [196, 198, 200], 0.2, 0.0),
    wall("marble_wall", Veins { share: 0.1 }, [228, 226, 222], [160, 158, 160], 0.3, 0.0),
    wall("beige_stripes", Stripes { count: 16 }, [226, 216, 198], [206, 192, 168], 0.8, 0.0),
    wall("blue_stripes", Stripes { count: 20 }, [222, 226, 230], [150, 172, 198], 0.8, 0.0),
    wall("green_stripes", Stripes { count: 12 }, [214, 218, 204], [138, 158, 128], 0.8, 0.0),
    wall("grey_dots", Dots { count: 18 }, [220, 218, 214], [178, 176, 172], 0.8, 0.0),
    wall("gold_dots", Dots { count: 14 }, [72, 84, 96], [190, 162, 98], 0.8, 0.0),
    wall("linen_cloth", Weave { threads: 240 }, [206, 196, 178], [178, 166, 146], 0.9, 0.0),
    wall("grey_curtain", Folds { count: 22 }, [186, 184, 182], [120, 118, 118], 0.9, 0.0),
    wall("checked_cloth", Checks { count: 24 }, [222, 218, 210], [146, 160, 150], 0.9, 0.0),
];

/// Materials of the room around the scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Room {
    /// Material of all walls.
    pub wall: Wall,
    /// Material of the floor.
    pub floor: TableTop,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_back_and_differ() {
        for wall in Wall::all() {
            assert_eq!(Wall::try_from(wall.name().to_owned()), Ok(wall));
        }
        assert!(Wall::try_from("gold".to_owned()).unwrap_err().contains("red_brick"));
        assert!(Wall::all().len() >= 30);
    }
}
