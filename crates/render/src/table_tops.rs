//! What a table top may be made of: patterns computed here, so that no picture of anybody else's is needed.

use std::f32::consts::TAU;
use std::sync::{Arc, Mutex, PoisonError, Weak};

use genmanip_core::{Material, Texture};
use glam::Vec3;
use serde::{Deserialize, Serialize};

/// Metres of table covered by one repetition of a texture.
pub(crate) const TOP_SIZE_M: f32 = 1.5;
/// Texels per side of a texture: 1.5 mm each.
const SIZE: u32 = 1024;

/// One of the known table tops, by its name in files and on the command line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct TableTop(u8);

/// How a top looks: two colours, 8-bit sRGB, and what mixes them.
struct Top {
    name: &'static str,
    pattern: Pattern,
    light: [u8; 3],
    dark: [u8; 3],
    roughness: f32,
    metallic: f32,
}

/// What mixes the colours of a top; numbers are repetitions per texture, so that it repeats without a seam.
#[derive(Clone, Copy)]
enum Pattern {
    /// Long fibres along y, wide soft bands.
    Grain { bands: f32 },
    /// Boards of different grain side by side.
    Boards { count: u32 },
    /// Thin dark veins in soft clouds.
    Veins { share: f32 },
    /// Small grains of the second colour.
    Flecks { across: u32, share: f32 },
    /// Threads over and under each other.
    Weave { threads: u32 },
    /// Stripes that cross, as on a table cloth.
    Checks { count: u32 },
    /// Squares with dark joints.
    Tiles { count: u32 },
    /// Fine scratches along x.
    Brushed,
    /// Soft clouds and pores.
    Concrete,
    /// One colour, hardly mottled.
    Plain,
}

use Pattern::{Boards, Brushed, Checks, Concrete, Flecks, Grain, Plain, Tiles, Veins, Weave};

const fn top(
    name: &'static str,
    pattern: Pattern,
    light: [u8; 3],
    dark: [u8; 3],
    roughness: f32,
    metallic: f32,
) -> Top {
    Top { name, pattern, light, dark, roughness, metallic }
}

/// All tops; the first is the usual one. Colours and roughness are chosen to look like what the name says, and none
/// is so dark or so colourful that what stands on it would be lost.
const TOPS: [Top; 32] = [
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

impl TableTop {
    /// All of them, the usual one first.
    pub fn all() -> impl ExactSizeIterator<Item = Self> {
        (0..TOPS.len() as u8).map(Self)
    }

    /// The name in files.
    pub fn name(self) -> &'static str {
        self.top().name
    }

    fn top(self) -> &'static Top {
        &TOPS[usize::from(self.0) % TOPS.len()]
    }

    /// The material of the table's slab; textures are made once for all that use them at the same time.
    pub(crate) fn material(self) -> Material {
        static MADE: Mutex<[Weak<Texture>; TOPS.len()]> = Mutex::new([const { Weak::new() }; TOPS.len()]);
        let top = self.top();
        let mut made = MADE.lock().unwrap_or_else(PoisonError::into_inner);
        let known = &mut made[usize::from(self.0) % TOPS.len()];
        let texture = known.upgrade().unwrap_or_else(|| Arc::new(top.texture()));
        *known = Arc::downgrade(&texture);
        Material { texture: Some(texture), metallic: top.metallic, ..Material::plain([1.0; 3], top.roughness) }
    }
}

impl TryFrom<String> for TableTop {
    type Error = String;

    fn try_from(name: String) -> Result<Self, String> {
        let unknown = || format!("unknown table top `{name}`: expected one of {}", TOPS.map(|top| top.name).join(", "));
        Self::all().find(|top| top.name() == name).ok_or_else(unknown)
    }
}

impl From<TableTop> for String {
    fn from(top: TableTop) -> Self {
        top.name().into()
    }
}

impl Top {
    fn texture(&self) -> Texture {
        let color = |[r, g, b]: [u8; 3]| Vec3::new(f32::from(r), f32::from(g), f32::from(b));
        let (light, dark) = (color(self.light), color(self.dark));
        let mut rgb = Vec::with_capacity((SIZE * SIZE * 3) as usize);
        for y in 0..SIZE {
            for x in 0..SIZE {
                let mix = self.pattern.mix(x as f32 / SIZE as f32, y as f32 / SIZE as f32);
                rgb.extend(light.lerp(dark, mix.clamp(0.0, 1.0)).to_array().map(|value| value as u8));
            }
        }
        Texture { width: SIZE, height: SIZE, rgb }
    }
}

impl Pattern {
    /// How much of the second colour there is at a place of the texture, about 0-1.
    fn mix(self, u: f32, v: f32) -> f32 {
        match self {
            Grain { bands } => grain(u, v, bands),
            Boards { count } => {
                let across = u * count as f32;
                let board = across as u32;
                // Each board is another piece of the same wood; its ends lie somewhere else.
                let own = hash(board.wrapping_mul(7919) + count);
                let joint = smooth_edge((across.fract() - 0.5).abs(), 0.5 - 0.0035 * count as f32, 0.5);
                let end = smooth_edge(((v + own).fract() - 0.5).abs(), 0.4985, 0.5);
                grain((u + own).fract(), (v + 0.37 * own).fract(), 9.0) * 0.75 + own * 0.3 + joint.max(end) * 0.5
            }
            Veins { share } => {
                let bend = tiling_noise(u, v, 3, 3) * 0.5 + tiling_noise(u, v, 9, 9) * 0.2;
                let vein = |u: f32, v: f32, count: f32| {
                    let wave = ((u + v + bend) * TAU * count).sin().abs();
                    1.0 - smooth_edge(wave, 0.0, share)
                };
                let clouds = tiling_noise(u, v, 5, 4) * 0.6 + tiling_noise(u, v, 24, 24) * 0.4;
                0.25 * clouds + 0.6 * vein(u, v, 2.0) * clouds + 0.3 * vein(v, 2.0 * u, 1.0)
            }
            Flecks { across, share } => {
                let grain = tiling_noise(u, v, across, across) * 0.7 + tiling_noise(u, v, across * 2, across * 2) * 0.3;
                smooth_edge(grain, 0.62 - 0.4 * share, 0.78 - 0.4 * share) * 0.85 + tiling_noise(u, v, 6, 6) * 0.15
            }
            Weave { threads } => {
                let count = threads as f32;
                let (x, y) = ((u * count * TAU / 2.0).sin(), (v * count * TAU / 2.0).sin());
                let fibre = tiling_noise(u, v, threads, 40) * 0.5 + tiling_noise(u, v, 40, threads) * 0.5;
                0.25 + 0.25 * x * y + 0.5 * fibre
            }
            Checks { count } => {
                let is_dark = |t: f32| f32::from(u8::from((t * count as f32).fract() < 0.5));
                (is_dark(u) + is_dark(v)) * 0.45 + tiling_noise(u, v, 512, 512) * 0.1
            }
            Tiles { count } => {
                let (x, y) = (u * count as f32, v * count as f32);
                let joint = |t: f32| smooth_edge((t.fract() - 0.5).abs(), 0.478, 0.488);
                let own = hash(x as u32 * 131 + y as u32 * 7919 + count);
                joint(x).max(joint(y)) + 0.10 * own + 0.06 * tiling_noise(u, v, 30, 30)
            }
            Brushed => tiling_noise(u, v, 4, 512) * 0.6 + tiling_noise(u, v, 16, 900) * 0.4,
            Concrete => {
                let clouds = tiling_noise(u, v, 4, 4) * 0.5 + tiling_noise(u, v, 13, 13) * 0.3;
                let pores = smooth_edge(tiling_noise(u, v, 180, 180), 0.86, 0.95);
                clouds + tiling_noise(u, v, 120, 120) * 0.2 + pores * 0.5
            }
            Plain => tiling_noise(u, v, 200, 200) * 0.6 + tiling_noise(u, v, 7, 7) * 0.4,
        }
    }
}

/// A calm wood of low contrast, so that objects stand out: long fibres along y, wide soft bands.
fn grain(u: f32, v: f32, bands: f32) -> f32 {
    let bend = tiling_noise(u, v, 4, 3) * 0.10 + tiling_noise(u, v, 10, 4) * 0.03;
    let band = ((u + bend) * TAU * bands).sin() * 0.5 + 0.5;
    let fibre = tiling_noise(u, v, 400, 12) * 0.6 + tiling_noise(u, v, 160, 5) * 0.4;
    let patch = tiling_noise(u, v, 3, 2);
    0.18 + 0.22 * band + 0.34 * fibre + 0.16 * patch
}

/// 0 below, 1 above, smooth between.
fn smooth_edge(value: f32, below: f32, above: f32) -> f32 {
    let t = ((value - below) / (above - below)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Value noise in 0-1 on a grid of `columns` × `rows` cells that repeats after one unit.
fn tiling_noise(u: f32, v: f32, columns: u32, rows: u32) -> f32 {
    let (x, y) = (u * columns as f32, v * rows as f32);
    let (x0, y0) = (x as u32, y as u32);
    let smooth = |t: f32| t * t * (3.0 - 2.0 * t);
    let (fx, fy) = (smooth(x - x0 as f32), smooth(y - y0 as f32));
    let value =
        |column: u32, row: u32| hash((column % columns) + (row % rows) * columns + columns * 7919 + rows * 104_729);
    let upper = value(x0, y0) + (value(x0 + 1, y0) - value(x0, y0)) * fx;
    let lower = value(x0, y0 + 1) + (value(x0 + 1, y0 + 1) - value(x0, y0 + 1)) * fx;
    upper + (lower - upper) * fy
}

/// A number in 0-1 that looks like chance.
fn hash(cell: u32) -> f32 {
    let mut hash = cell.wrapping_mul(0x9E37_79B1);
    hash = (hash ^ (hash >> 15)).wrapping_mul(0x85EB_CA77);
    hash = (hash ^ (hash >> 13)).wrapping_mul(0xC2B2_AE3D);
    (hash >> 8) as f32 / 16_777_216.0
}

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

    /// Neighbours over the border differ no more than those on both sides of some line inside: checks and joints are lines,
    /// too.
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
