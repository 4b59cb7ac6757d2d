//! Which pixels' share of the key light is certain, which is read from level tops, and which is estimated.

use glam::Vec2;

use super::bins::Bins;
use super::{Arrival, LEVEL, NO_RANGE, ON_TOP, SEVERAL, Work, put};
use crate::layers::TILE;
use crate::points::packed;
use crate::refine::UNKNOWN;
use crate::shadow::ShadowMap;
use crate::tops::Tops;
use crate::view::Lens;

impl Arrival {
    /// Writes the share of the key light of tiles for which one is certain, and lists the pixels of the others; of
    /// coarse tiles, which are listed too, only those that do not share the estimate of another.
    pub(super) fn find_key(
        &mut self,
        shadow: &ShadowMap,
        lens: &Lens,
        tiles: &[usize],
        bins: &mut Bins,
        parts: usize,
        Work { tops, coarse, doubtful, .. }: &mut Work,
    ) {
        bins.clear(parts);
        tops.clear(parts);
        coarse.clear();
        doubtful.clear();
        for &tile in tiles {
            let summary = &self.tiles[tile];
            let [columns, rows] = self.pixels_of(tile);
            if let (Some(blocks), Some(top)) = (summary.top, shadow.tops().of(summary.surface)) {
                let certain = top.certain_share(blocks);
                self.raw_key.fill(tile, [columns.clone(), rows.clone()], ON_TOP);
                self.tiles[tile].key = NO_RANGE;
                match certain {
                    Some(share) => self.key.fill(tile, [columns, rows], share),
                    None => {
                        self.key.forget(tile);
                        tops.push_tile(self, tile);
                    }
                }
                continue;
            }
            let share = match summary.surface {
                0 => Some(UNKNOWN),
                _ if shadow.is_on() => shadow.certain_share(&summary.span),
                _ => Some(1.0),
            };
            // Where all pixels of one surface are estimated, all are written.
            let is_estimated = share.is_none() && summary.surface != SEVERAL && !summary.has_top;
            if !is_estimated || summary.is_coarse && !summary.is_level {
                self.raw_key.fill(tile, [columns.clone(), rows.clone()], share.unwrap_or(UNKNOWN));
            }
            if share.is_none() || summary.has_top {
                self.raw_key.forget(tile);
            }
            if summary.has_top {
                self.key.forget(tile);
                self.find_tops(shadow.tops(), lens, tile, tops);
            }
            let summary = &self.tiles[tile];
            if share.is_none() && summary.is_coarse && summary.is_level {
                bins.push_every::<2>(summary.surface, &columns, &rows);
                coarse.push(tile);
            } else if share.is_none() && summary.is_coarse {
                for row in rows {
                    for column in columns.clone() {
                        if self.raw_key[row * self.width + column] > ON_TOP && self.giver_of(column, row).is_none() {
                            bins.push(self.surface[row * self.width + column], packed(column, row));
                        }
                    }
                }
                coarse.push(tile);
            } else if share.is_none() && summary.has_top {
                for row in rows {
                    for pixel in row * self.width + columns.start..row * self.width + columns.end {
                        if self.raw_key[pixel] > ON_TOP {
                            bins.push(self.surface[pixel], packed(pixel - row * self.width, row));
                        }
                    }
                }
            } else if share.is_none() {
                bins.push_tile(self, tile);
            }
            match share {
                Some(share) => self.tiles[tile].key = if share >= 0.0 { [share; 2] } else { NO_RANGE },
                None => doubtful.push(tile),
            }
        }
    }

    /// Lists the pixels of a tile that show level tops.
    fn find_tops(&mut self, known: &Tops, lens: &Lens, tile: usize, tops: &mut Bins) {
        let [columns, rows] = self.pixels_of(tile);
        for row in rows {
            for column in columns.clone() {
                let pixel = row * self.width + column;
                let surface = self.surface[pixel];
                if let Some(top) = known.of(surface)
                    && top.holds(lens.point_at(Vec2::new(column as f32, row as f32), self.depth[pixel]).z)
                {
                    self.raw_key[pixel] = ON_TOP;
                    tops.push(surface, packed(column, row));
                }
            }
        }
    }

    /// The pixel at an even row and column whose estimate of the key light another pixel of a coarse tile shares: it must
    /// show the same surface.
    #[inline(always)]
    fn giver_of(&self, column: usize, row: usize) -> Option<usize> {
        let (pixel, giver) = (row * self.width + column, (row & !1) * self.width + (column & !1));
        let is_same = (self.surface[giver] == self.surface[pixel])
            & ((self.depth[giver] - self.depth[pixel]).abs() < LEVEL * self.depth[pixel])
            & (self.raw_key[giver] > ON_TOP)
            & (self.raw_key[pixel] > ON_TOP);
        (pixel != giver && is_same).then_some(giver)
    }

    pub(super) fn share_key(&mut self, tile: usize) {
        let [columns, rows] = self.pixels_of(tile);
        if self.tiles[tile].is_level {
            for row in rows {
                let (giver, first) = ((row & !1) * self.width, row * self.width);
                let mut given = [0.0; TILE];
                let from = &self.raw_key[giver..][columns.clone()];
                match from.first_chunk() {
                    Some(whole) => given = *whole,
                    None => given[..from.len()].copy_from_slice(from),
                }
                let shared = std::array::from_fn(|step| given[step & !1]);
                put(&mut self.raw_key[first..][columns.clone()], &shared);
            }
            return;
        }
        for row in rows {
            for column in columns.clone() {
                if let Some(giver) = self.giver_of(column, row) {
                    self.raw_key[row * self.width + column] = self.raw_key[giver];
                }
            }
        }
    }
}
