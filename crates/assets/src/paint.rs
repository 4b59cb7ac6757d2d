//! Procedural textures: prints, wood grain, weaves, glazes.
//!
//! Texture coordinates: u to the right, v downwards, both 0-1.
//! Lengths are fractions of the texture's height.

use std::f32::consts::TAU;

use genmanip_core::{Seed, Texture, stroke_font};
use glam::{Vec2, Vec3};
use rand::RngExt;
use serde::Deserialize;

use crate::color::Color;

/// Layer of a texture. `at` is a centre (u, v). With `repeat`, the layer is repeated that many times along u, and u of
/// `at` is a fraction of one repetition.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Paint {
    /// Soft irregular noise; `scale` is the number of features along u and v, `amount` the largest opacity.
    Noise { color: Color, scale: [f32; 2], amount: f32 },
    /// Wood grain along u (or along v with `upright`).
    Wood {
        color: Color,
        rings: f32,
        #[serde(default)]
        upright: bool,
    },
    /// Randomly placed dots between two heights `v`, each of 0.4 to 1.2 times `radius`; they wrap around in u.
    Speckle {
        color: Color,
        count: u32,
        radius: f32,
        #[serde(default = "full")]
        v: [f32; 2],
    },
    /// Uniform band between two heights `v`.
    Band { color: Color, v: [f32; 2] },
    /// Wavy band around the height `v`, with `periods` waves along u.
    Wave { color: Color, v: f32, amplitude: f32, width: f32, periods: f32 },
    /// Disc, or an ellipse with `stretch` times its height as width.
    Disc {
        color: Color,
        at: [f32; 2],
        radius: f32,
        #[serde(default = "one")]
        stretch: f32,
        #[serde(default = "one")]
        repeat: f32,
    },
    /// Lower half of an ellipse, like a bowl seen from the side: `at` is the middle of its rim, `radius` half the width
    /// of its rim, and its depth is `radius` / 1.3.
    Cup { color: Color, at: [f32; 2], radius: f32 },
    /// Rectangle with `size` (width, height).
    Rect {
        color: Color,
        at: [f32; 2],
        size: [f32; 2],
        #[serde(default = "one")]
        repeat: f32,
    },
    /// Pointed oval; `angle` in degrees, counter-clockwise from u.
    Leaf {
        color: Color,
        at: [f32; 2],
        length: f32,
        width: f32,
        angle: f32,
        #[serde(default = "one")]
        repeat: f32,
    },
    /// Star with `count` points between the radii `inner` and `radius`.
    Star {
        color: Color,
        at: [f32; 2],
        radius: f32,
        inner: f32,
        count: f32,
        #[serde(default = "one")]
        repeat: f32,
    },
    /// Straight stripes along v, `count` of them side by side along u (with `level`: along u, side by side along v);
    /// `width` is the painted fraction of a period.
    Stripes {
        color: Color,
        count: f32,
        width: f32,
        #[serde(default)]
        level: bool,
        /// Slant of the stripes: periods by which they shift over the height of the texture (over its width with
        /// `level`).
        #[serde(default)]
        lean: f32,
    },
    /// Weave of `cells` (along u, along v) strands that pass over and under each other, shaded towards the colour.
    Weave { color: Color, cells: [f32; 2] },
    /// Bars that look like `lines` lines of text in a rectangle.
    Text { color: Color, at: [f32; 2], size: [f32; 2], lines: u32 },
    /// Words in capitals centred at a point, `height` high, shrunk to fit `width` (a fraction of the width of the
    /// texture, or of one repetition); `weight` is the stroke width relative to the cap height.
    Words {
        color: Color,
        text: String,
        at: [f32; 2],
        height: f32,
        #[serde(default = "most")]
        width: f32,
        #[serde(default = "weight")]
        weight: f32,
        #[serde(default = "one")]
        repeat: f32,
    },
    /// Randomly coloured squares on a grid of `cells`; `gap` is the unpainted margin on each side of a cell, as a
    /// fraction of the cell.
    Squares { colors: Vec<Color>, cells: [u32; 2], gap: f32 },
    /// Seam of a tennis ball, for a texture on a sphere; `width` is about half the seam's width, in radii of the
    /// sphere.
    Seam { color: Color, width: f32 },
}

/// Texture to which layers are added.
#[derive(Clone, Debug)]
pub struct Canvas {
    width: u32,
    height: u32,
    aspect: f32,
    pixels: Vec<Vec3>,
}

impl Canvas {
    /// Texture of one colour; `aspect` is the width of the painted area divided by its height.
    pub fn new([width, height]: [u32; 2], aspect: f32, ground: Color) -> Self {
        let (width, height) = (width.clamp(1, 4096), height.clamp(1, 4096));
        Self { width, height, aspect, pixels: vec![Vec3::from_array(ground.0); (width * height) as usize] }
    }

    /// Paints a layer over the texture; `seed` drives random patterns.
    pub fn apply(&mut self, paint: &Paint, seed: Seed) {
        let soft = 1.0 / self.height as f32;
        let edge = |distance: f32| (0.5 - distance / soft).clamp(0.0, 1.0);
        let within = |value: f32, [low, high]: [f32; 2]| edge(low - value).min(edge(value - high));
        let aspect = self.aspect;
        // Offset from the point `at`, in heights of the texture, in a pattern that is repeated `repeat` times along u.
        let from = move |p: Vec2, at: [f32; 2], repeat: f32| {
            let folded = (p.x * repeat).rem_euclid(1.0);
            let mut du = folded - at[0];
            du -= du.round();
            Vec2::new(du * aspect / repeat, p.y - at[1])
        };
        match paint {
            Paint::Noise { color, scale, amount } => self.blend(*color, |p| {
                (fractal_noise(wrapped(p, scale[0]) + Vec3::Z * (p.y * scale[1]), seed) * 2.4 - 0.7).clamp(0.0, 1.0)
                    * amount
            }),
            Paint::Wood { color, rings, upright } => self.blend(*color, |p| {
                let (lengthwise, across) = if *upright { (p.y, p.x) } else { (p.x, p.y) };
                let bend = noise(Vec3::new(lengthwise * 1.5, across * 3.0, 0.5), seed) * 1.6;
                let ring = ((across * rings + bend) * TAU).sin() * 0.5 + 0.5;
                let fibre = noise(Vec3::new(lengthwise * 6.0, across * 90.0, 7.0), seed);
                (ring * ring * 0.6 + fibre * 0.4).clamp(0.0, 1.0)
            }),
            Paint::Speckle { color, count, radius, v } => {
                let mut rng = seed.rng();
                for _ in 0..*count {
                    let at = [rng.random::<f32>(), v[0] + (v[1] - v[0]) * rng.random::<f32>()];
                    let radius = radius * (0.4 + 0.8 * rng.random::<f32>());
                    self.blend_within(*color, at, radius, |p| edge(from(p, at, 1.0).length() - radius));
                }
            }
            Paint::Band { color, v } => self.blend_rows(*color, *v, |p| within(p.y, *v)),
            Paint::Wave { color, v, amplitude, width, periods } => {
                self.blend_rows(*color, [v - amplitude - width, v + amplitude + width], |p| {
                    let middle = v + amplitude * (p.x * periods * TAU).sin();
                    let swell = width * (1.0 + 0.4 * (p.x * periods * TAU + 1.0).cos());
                    edge((p.y - middle).abs() - swell / 2.0)
                })
            }
            Paint::Disc { color, at, radius, stretch, repeat } => {
                self.blend_rows(*color, around(at, *radius), |p| {
                    let d = from(p, *at, *repeat);
                    edge(Vec2::new(d.x / stretch, d.y).length() - radius)
                });
            }
            Paint::Cup { color, at, radius } => self.blend_rows(*color, around(at, *radius), |p| {
                let d = from(p, *at, 1.0);
                edge((Vec2::new(d.x, d.y * 1.3).length() - radius).max(-d.y))
            }),
            Paint::Rect { color, at, size, repeat } => self.blend_rows(*color, around(at, size[1] / 2.0), |p| {
                let d = from(p, *at, *repeat).abs() - Vec2::from_array(*size) / 2.0;
                edge(d.max_element())
            }),
            Paint::Leaf { color, at, length, width, angle, repeat } => {
                self.blend_rows(*color, around(at, length / 2.0), |p| {
                    let d = from(p, *at, *repeat);
                    let along = Vec2::from_angle(-angle.to_radians());
                    let (x, y) = (d.dot(along), d.perp_dot(along));
                    let t = (2.0 * x / length).clamp(-1.0, 1.0);
                    let vein = if y.abs() < width * 0.04 { 0.55 } else { 1.0 };
                    edge((y.abs() - width / 2.0 * (1.0 - t * t)).max(x.abs() - length / 2.0)) * vein
                })
            }
            Paint::Star { color, at, radius, inner, count, repeat } => {
                self.blend_rows(*color, around(at, *radius), |p| {
                    let d = from(p, *at, *repeat);
                    let phase = (d.y.atan2(d.x) / TAU * count).rem_euclid(1.0);
                    let reach = inner + (radius - inner) * (1.0 - 2.0 * (phase - 0.5).abs()).powf(1.3);
                    edge(d.length() - reach)
                })
            }
            Paint::Stripes { color, count, width, level, lean } => self.blend(*color, |p| {
                let (across, along) = if *level { (p.y, p.x) } else { (p.x, p.y) };
                let phase = (across * count + along * lean).rem_euclid(1.0);
                let blur = soft * count;
                ((width / 2.0 - (phase - 0.5).abs()) / blur + 0.5).clamp(0.0, 1.0)
            }),
            Paint::Weave { color, cells } => self.blend(*color, |p| {
                let (x, y) = (p.x * cells[0], p.y * cells[1]);
                let over = (x.floor() + y.floor()) as i64 % 2 == 0;
                let (fx, fy) = (x.fract() - 0.5, y.fract() - 0.5);
                let (along, across) = if over { (fx, fy) } else { (fy, fx) };
                let strand = (1.0 - 4.0 * across * across).max(0.0).sqrt() * (1.0 - 1.6 * along * along);
                1.0 - strand.clamp(0.0, 1.0)
            }),
            Paint::Text { color, at, size, lines } => {
                let mut rng = seed.rng();
                for line in 0..*lines {
                    let y = at[1] - size[1] / 2.0 + (line as f32 + 0.5) * size[1] / *lines as f32;
                    let length = size[0] * (0.55 + 0.45 * rng.random::<f32>());
                    let height = size[1] / *lines as f32 * 0.5;
                    self.blend_rows(*color, around(&[at[0], y], height), |p| {
                        let d = from(p, [at[0], y], 1.0).abs() - Vec2::new(length, height) / 2.0;
                        edge(d.max_element())
                    });
                }
            }
            Paint::Words { color, text, at, height, width, weight, repeat } => {
                let (strokes, long) = stroke_font::strokes(text);
                let height = height.min(width * aspect / repeat / (long + weight).max(0.1));
                let half = Vec2::new(long + weight, 1.0 + weight) * height / 2.0;
                let place = |p: Vec2| Vec2::new(p.x - long / 2.0, 0.5 - p.y) * height;
                let segments: Vec<[Vec2; 2]> = strokes
                    .iter()
                    .flat_map(|stroke| stroke.windows(2).map(|ends| [place(ends[0]), place(ends[1])]))
                    .collect();
                self.blend_rows(*color, around(at, half.y), |p| {
                    let d = from(p, *at, *repeat);
                    if d.x.abs() > half.x {
                        return 0.0;
                    }
                    let near = segments.iter().map(|&ends| distance_squared(d, ends)).fold(f32::INFINITY, f32::min);
                    edge(near.sqrt() - weight * height / 2.0)
                });
            }
            Paint::Squares { colors, cells, gap } => {
                let mut rng = seed.rng();
                for row in 0..cells[1] {
                    for column in 0..cells[0] {
                        let Some(&color) = colors.get(rng.random_range(0..colors.len().max(1))) else { continue };
                        let cell = Vec2::new(1.0 / cells[0] as f32, 1.0 / cells[1] as f32);
                        let middle = Vec2::new(column as f32 + 0.5, row as f32 + 0.5) * cell;
                        self.blend_within(color, middle.to_array(), cell.y, |p| {
                            let d = (p - middle).abs() - cell * (0.5 - gap);
                            edge(d.max_element())
                        });
                    }
                }
            }
            Paint::Seam { color, width } => self.blend(*color, |p| {
                // On the unit sphere, the seam is close to the intersection with the saddle x² − y² = z.
                let (polar, around) = (p.y * TAU / 2.0, p.x * TAU);
                let (x, y, z) = (polar.sin() * around.cos(), polar.sin() * around.sin(), polar.cos());
                let value = x * x - y * y - 0.85 * z * (2.2 - z * z) * 0.75;
                edge(value.abs() / 1.9 - width)
            }),
        }
    }

    /// Texture with all layers painted.
    pub fn into_texture(self) -> Texture {
        let byte = |value: f32| (value.clamp(0.0, 1.0) * 255.0).round() as u8;
        let rgb = self.pixels.iter().flat_map(|pixel| pixel.to_array().map(byte)).collect();
        Texture { width: self.width, height: self.height, rgb }
    }

    fn blend(&mut self, color: Color, coverage: impl Fn(Vec2) -> f32) {
        self.blend_rows(color, [0.0, 1.0], coverage);
    }

    /// Blends a colour into the rows between two heights only; `coverage` may exceed them by a pixel.
    fn blend_rows(&mut self, color: Color, v: [f32; 2], coverage: impl Fn(Vec2) -> f32) {
        self.blend_pixels(color, v, (0, i64::from(self.width) - 1), coverage);
    }

    /// Blends a colour within `reach` of a point only; columns wrap around.
    fn blend_within(&mut self, color: Color, at: [f32; 2], reach: f32, coverage: impl Fn(Vec2) -> f32) {
        let across = reach / self.aspect;
        let column = |u: f32| (u * self.width as f32).floor() as i64;
        let columns = (column(at[0] - across) - 1, column(at[0] + across) + 1);
        self.blend_pixels(color, around(&at, reach), columns, coverage);
    }

    fn blend_pixels(&mut self, color: Color, v: [f32; 2], columns: (i64, i64), coverage: impl Fn(Vec2) -> f32) {
        let color = Vec3::from_array(color.0);
        let (width, height) = (i64::from(self.width), i64::from(self.height));
        let row = |v: f32| (v * height as f32).floor() as i64;
        for row in (row(v[0]) - 1).max(0)..=(row(v[1]) + 1).min(height - 1) {
            for column in columns.0..=columns.1.min(columns.0 + width - 1) {
                let column = column.rem_euclid(width);
                let p = Vec2::new((column as f32 + 0.5) / width as f32, (row as f32 + 0.5) / height as f32);
                let pixel = &mut self.pixels[(row * width + column) as usize];
                *pixel = pixel.lerp(color, coverage(p).clamp(0.0, 1.0));
            }
        }
    }
}

/// Squared distance from a point to a segment.
fn distance_squared(p: Vec2, [a, b]: [Vec2; 2]) -> f32 {
    let along = b - a;
    let t = ((p - a).dot(along) / along.length_squared().max(1e-12)).clamp(0.0, 1.0);
    p.distance_squared(a + along * t)
}

/// Height interval within `reach` of a point.
fn around(at: &[f32; 2], reach: f32) -> [f32; 2] {
    [at[1] - reach, at[1] + reach]
}

/// Point on a circle whose circumference is `scale` noise features, so that noise has no seam along u.
fn wrapped(p: Vec2, scale: f32) -> Vec3 {
    let radius = scale / TAU;
    Vec3::new(radius * (p.x * TAU).cos(), radius * (p.x * TAU).sin(), 0.0)
}

fn fractal_noise(p: Vec3, seed: Seed) -> f32 {
    noise(p, seed) * 0.65 + noise(p * 2.13, seed) * 0.35
}

/// Smooth value noise in 0-1 with one feature per unit.
fn noise(p: Vec3, seed: Seed) -> f32 {
    let cell = p.floor();
    let f = p - cell;
    let f = f * f * (Vec3::splat(3.0) - f * 2.0);
    let corner = |x: i32, y: i32, z: i32| {
        let mut h = (cell.x as i32 + x) as u32;
        h = h.wrapping_mul(0x9E37_79B1) ^ ((cell.y as i32 + y) as u32).wrapping_mul(0x85EB_CA77);
        h ^= ((cell.z as i32 + z) as u32).wrapping_mul(0xC2B2_AE3D) ^ (seed.value() as u32);
        h = (h ^ (h >> 15)).wrapping_mul(0x2C1B_3C6D);
        h = (h ^ (h >> 12)).wrapping_mul(0x297A_2D39);
        ((h ^ (h >> 15)) & 0xFF_FFFF) as f32 / 16_777_215.0
    };
    let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
    let layer = |z: i32| {
        let low = mix(corner(0, 0, z), corner(1, 0, z), f.x);
        let high = mix(corner(0, 1, z), corner(1, 1, z), f.x);
        mix(low, high, f.y)
    };
    mix(layer(0), layer(1), f.z)
}

fn full() -> [f32; 2] {
    [0.0, 1.0]
}

fn most() -> f32 {
    0.9
}

fn weight() -> f32 {
    0.17
}

fn one() -> f32 {
    1.0
}
