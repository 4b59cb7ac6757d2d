//! Which tiles of a picture that continues another are to be estimated, and where that gives something new.

use std::ops::Range;

use super::Arrival;
use crate::shadow::ShadowMap;

/// Marks of tiles, for each of the two lights.
#[derive(Debug, Default)]
pub(crate) struct Marks {
    pub key: Vec<bool>,
    pub ambient: Vec<bool>,
}

impl Arrival {
    /// The tiles whose estimates may have changed: those that show something else, for the key light those on which the
    /// shadows may have changed since a version of the shadow map, and for the ambient light those whose taps reach one
    /// that shows something else.
    pub fn mark_stale(&mut self, changed: &[bool], shadow: &ShadowMap, version: u64, stale: &mut Marks) {
        self.changes.count(changed.iter().copied(), self.columns, self.rows);
        let (marks, columns) = shadow.changed_after(version);
        self.shadow_changes.count(marks, columns, columns);
        stale.key.clear();
        stale.key.extend(self.tiles.iter().zip(changed).map(|(summary, changed)| {
            let [from, to] = summary.span.reach();
            *changed || self.shadow_changes.any(from, to)
        }));
        stale.ambient.clear();
        stale.ambient.extend(self.tiles.iter().enumerate().map(|(tile, summary)| {
            let [from, to] = self.around(tile, summary.reach);
            self.changes.any(from, to)
        }));
    }

    /// Whether a tile or one on which its blur depends is marked.
    pub fn any_around(&self, marks: &[bool], tile: usize) -> bool {
        let [columns, mut rows] = self.beside(tile);
        rows.any(|row| marks[row * self.columns..][columns.clone()].contains(&true))
    }
}

/// Values on a grid within the areas of tiles, before they are made anew.
#[derive(Debug, Default)]
pub(super) struct Before {
    values: Vec<f32>,
}

impl Before {
    /// Keeps the values of tiles that are not marked yet.
    pub fn keep(
        &mut self,
        (values, width): (&[f32], usize),
        tiles: &[usize],
        area: impl Fn(usize) -> [Range<usize>; 2],
        marked: &[bool],
    ) {
        self.values.clear();
        for &tile in tiles.iter().filter(|&&tile| !marked[tile]) {
            let [columns, rows] = area(tile);
            rows.for_each(|row| self.values.extend_from_slice(&values[row * width..][columns.clone()]));
        }
    }

    /// Marks those of the tiles that have another value now, to the bit.
    pub fn mark_moved(
        &self,
        (values, width): (&[f32], usize),
        tiles: &[usize],
        area: impl Fn(usize) -> [Range<usize>; 2],
        marked: &mut [bool],
    ) {
        let mut before = self.values.as_slice();
        for &tile in tiles {
            if marked[tile] {
                continue;
            }
            let [columns, rows] = area(tile);
            for row in rows {
                let (line, rest) = before.split_at(columns.len());
                marked[tile] |= differ(line, &values[row * width..][columns.clone()]);
                before = rest;
            }
        }
    }
}

/// Whether two lists of one length differ in any bit.
#[inline(always)]
pub(super) fn differ(a: &[f32], b: &[f32]) -> bool {
    a.iter().zip(b).fold(0, |bits, (a, b)| bits | (a.to_bits() ^ b.to_bits())) != 0
}
