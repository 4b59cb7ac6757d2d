//! Smooth edges, and what is transparent.
//!
//! A surface is shaded once per pixel, at the pixel's centre. Where the samples around a centre show other surfaces, a
//! sample takes the colour of the neighbouring pixel whose centre shows its surface (Chajdas, McGuire and Luebke,
//! "Subpixel Reconstruction Antialiasing", 2011); only what no centre near by shows is shaded by itself.
//! Samples count by a tent two pixels wide.

use glam::{Vec2, Vec3A};

use crate::arrival::Arrival;
use crate::assets::RenderAssets;
use crate::glass::Glass;
use crate::layers::{TILE, each_place};
use crate::panes::{Opaque, Pane, Panes};
use crate::raster::Target;
use crate::scene::Scene;
use crate::shade::{Appearance, Shading, Spot};
use crate::texture::srgb8_from_linear;
use crate::view::{View, far_nearness, surface_of};
use front::{Share, find_shares};
use keys::{Around, Directions, TileKeys};

mod front;
mod keys;
mod mix;

/// What is found on the edges of a picture; memory kept from frame to frame.
#[derive(Debug, Default)]
pub(crate) struct Edges {
    /// Pixels with several surfaces, and the sum of their known colours.
    mixed: Vec<(u32, Vec3A)>,
    /// Surfaces that are shaded by themselves.
    extras: Vec<Extra>,
    panes: Panes,
    order: Vec<u32>,
    /// By tile: the pixels, in bits, row by row, whose bytes are not those of their colour alone.
    rewritten: Vec<u64>,
    keys: TileKeys,
    directions: Directions,
}

/// A sample, or several of one surface, to be shaded.
#[derive(Debug)]
struct Extra {
    spot: Spot,
    /// Equal for samples of one smooth piece of surface.
    key: u32,
    /// Index of the mixed pixel.
    mixed: u32,
    /// Its share of the pixel.
    share: f32,
}

impl Edges {
    /// Looks at all parts as they are seen; to be called before [`Edges::find`].
    pub fn begin(&mut self, assets: &RenderAssets, view: &View, tiles: usize) {
        self.rewritten.resize(tiles, 0);
        self.mixed.clear();
        self.extras.clear();
        self.panes.clear();
        let placed = assets.parts.iter().zip(&view.parts);
        self.directions.fill(placed.map(|(part, placed)| &*placed.mesh(part).directions));
    }

    /// Finds the pixels of tiles that show several surfaces or something transparent; tiles are given in their order.
    pub fn find(
        &mut self,
        opaque: &mut Target,
        mut glass: Option<&mut Glass>,
        arrival: &Arrival,
        tiles: &[usize],
        colors: &[Vec3A],
    ) {
        let n = opaque.scale as isize;
        for &tile in tiles {
            let glass = glass.as_deref_mut().filter(|glass| glass.reaches(tile));
            if !arrival.is_at_border(tile) || glass.is_none() && arrival.shows_one(tile) {
                continue;
            }
            opaque.settle_around(tile);
            if let Some(glass) = glass {
                glass.layers.iter_mut().for_each(|layer| layer.settle_around(tile));
            }
        }
        let opaque = &*opaque;
        let (mut keys, directions) = (std::mem::take(&mut self.keys), std::mem::take(&mut self.directions));
        let around = Around { opaque, directions: &directions, arrival, n };
        for &tile in tiles {
            let [columns, rows] = arrival.pixels_of(tile);
            let first_mixed = self.mixed.len();
            let is_mixed = n > 1 && !arrival.shows_one(tile) && keys.load(&around, tile);
            let mut rewritten = if is_mixed { self.mix_tile(&around, &keys, [&columns, &rows], colors) } else { 0 };
            if let Some(glass) = glass.as_deref().filter(|glass| glass.reaches(tile)) {
                rewritten |= self.find_panes(&around, &glass.layers, tile, first_mixed);
            }
            self.rewritten[tile] = rewritten;
        }
        (self.keys, self.directions) = (keys, directions);
    }

    /// The places within a tile of the pixels whose bytes were not those of their colour alone when it was last looked at.
    pub fn rewritten(&self, tile: usize) -> impl Iterator<Item = usize> {
        each_place(self.rewritten[tile])
    }

    /// Shades what no pixel's centre shows and rewrites the bytes of all pixels that were found.
    pub fn finish(&mut self, scene: &Scene<'_>, view: &View, arrival: &Arrival, colors: &[Vec3A], rgb: &mut [u8]) {
        self.shade_extras(scene, view);
        for &(pixel, color) in &self.mixed {
            rgb[pixel as usize * 3..][..3].copy_from_slice(&srgb8_from_linear(color));
        }
        let opaque = Opaque { scene, view, arrival, colors, mixed: &self.mixed };
        self.panes.show(&opaque, rgb);
    }

    fn shade_extras(&mut self, scene: &Scene<'_>, view: &View) {
        let lens = &view.lens;
        for Extra { spot, mixed, share, .. } in self.extras.iter().filter(|extra| extra.spot.id == 0) {
            let ray = lens.point_at(Vec2::new(spot.x, spot.y), 1.0) - lens.eye;
            self.mixed[*mixed as usize].1 += scene.backdrop.color(lens.eye, ray) * *share;
        }
        self.extras.retain(|extra| extra.spot.id != 0);
        let extras = &self.extras;
        by_surface(extras.iter().map(|extra| surface_of(extra.spot.id)), &mut self.order);
        let mut shading = Shading::default();
        let surface = |extra: &u32| surface_of(extras[*extra as usize].spot.id);
        for same in self.order.chunk_by(|a, b| surface(a) == surface(b)) {
            let appearance = Appearance::new(scene, view, surface(&same[0]) as usize - 1);
            for chunk in same.chunks(crate::lanes::CHUNK) {
                shading.clear();
                for &extra in chunk {
                    shading.push(extras[extra as usize].spot);
                }
                shading.shade(&appearance);
                for (spot, &extra) in chunk.iter().enumerate() {
                    let Extra { mixed, share, .. } = extras[extra as usize];
                    self.mixed[mixed as usize].1 += shading.color_of(spot) * share;
                }
            }
        }
    }

    /// Lists the sides of transparent surfaces before the pixels of a tile, whose mixed pixels are those from an index on;
    /// returns the places of the pixels with such sides, in bits.
    fn find_panes(&mut self, around: &Around<'_>, layers: &[Target; 2], tile: usize, first_mixed: usize) -> u64 {
        let n = around.n;
        let [columns, rows] = around.arrival.pixels_of(tile);
        let shares = find_shares(layers, around, tile);
        let width = around.opaque.width / around.opaque.scale;
        let mut mixed = (first_mixed as u32..).zip(&self.mixed[first_mixed..]).peekable();
        let mut found = 0;
        for (y, row) in rows.enumerate() {
            for (x, column) in columns.clone().enumerate() {
                let shares = shares.each_ref().map(|shares| shares[y * TILE + x]);
                // A far side alone lies in what its thing stands on, or its thing begins before the near plane.
                if shares[1].coverage == 0.0 {
                    continue;
                }
                let pixel = (row * width + column) as u32;
                // In a tile both lists go through the pixels in the same order.
                while mixed.next_if(|(_, (other, _))| *other < pixel).is_some() {}
                let mixed = mixed.next_if(|(_, (other, _))| *other == pixel).map(|(index, _)| index);
                let pane = |index: usize| {
                    let (layer, Share { coverage, step: [dx, dy] }) = (&layers[index], shares[index]);
                    if coverage == 0.0 {
                        return None;
                    }
                    let (column, row) =
                        around.cut(column as isize * n + isize::from(dx), row as isize * n + isize::from(dy));
                    let (id, stored) = layer.sample(column as usize, row as usize);
                    let spot = Spot {
                        id,
                        x: column as f32 / n as f32,
                        y: row as f32 / n as f32,
                        depth: 1.0 / if index == 0 { far_nearness(stored) } else { stored },
                        key: around.arrival.key[pixel as usize].max(0.0),
                        ambient: 1.0,
                    };
                    Some(Pane { spot, coverage })
                };
                self.panes.add(pixel, mixed, [pane(0), pane(1)]);
                found |= 1 << (y * TILE + x);
            }
        }
        found
    }
}

/// Sorts the indices of surfaces by their numbers and keeps the order of equal ones; a counting sort, since many points
/// lie on few surfaces.
fn by_surface(surfaces: impl Iterator<Item = u32> + Clone, order: &mut Vec<u32>) {
    let mut ends = vec![0; surfaces.clone().max().map_or(0, |last| last as usize + 2)];
    surfaces.clone().for_each(|surface| ends[surface as usize + 1] += 1);
    for surface in 1..ends.len() {
        ends[surface] += ends[surface - 1];
    }
    order.clear();
    order.resize(ends.last().map_or(0, |count| *count as usize), 0);
    for (index, surface) in (0..).zip(surfaces) {
        let place = &mut ends[surface as usize];
        order[*place as usize] = index;
        *place += 1;
    }
}
