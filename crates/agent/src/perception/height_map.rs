//! Height map from points.

use glam::{DVec2, DVec3};

/// Cell size (m); a pixel of the usual cameras covers 2 to 4 mm.
const CELL_M: f64 = 0.005;

/// Height map: the highest point in each cell of a horizontal grid.
#[derive(Clone, Debug)]
pub struct HeightMap {
    low: DVec2,
    columns: usize,
    rows: usize,
    /// Heights in row-major order, world z (m); NaN for cells without points.
    heights: Vec<f32>,
}

impl HeightMap {
    /// Builds the map of the points over a rectangle.
    pub fn new(low: DVec2, high: DVec2, points: impl IntoIterator<Item = DVec3>) -> Self {
        let count = |extent: f64| ((extent / CELL_M).ceil() as usize).clamp(1, 1000);
        let (columns, rows) = (count(high.x - low.x), count(high.y - low.y));
        let mut map = Self { low, columns, rows, heights: vec![f32::NAN; columns * rows] };
        for point in points {
            if let Some(index) = map.index(point.truncate()) {
                map.heights[index] = map.heights[index].max(point.z as f32);
            }
        }
        map
    }

    fn index(&self, at: DVec2) -> Option<usize> {
        let cell = ((at - self.low) / CELL_M).floor();
        let inside = cell.cmpge(DVec2::ZERO).all() && cell.x < self.columns as f64 && cell.y < self.rows as f64;
        inside.then(|| cell.y as usize * self.columns + cell.x as usize)
    }

    /// Heights of the non-empty cells in a rectangle.
    pub fn within(&self, center: DVec2, half: DVec2) -> impl Iterator<Item = f64> + '_ {
        let low = ((center - half - self.low) / CELL_M).floor().max(DVec2::ZERO);
        let high = ((center + half - self.low) / CELL_M).ceil().max(DVec2::ZERO);
        let columns = (low.x as usize).min(self.columns)..(high.x as usize).min(self.columns);
        let rows = (low.y as usize).min(self.rows)..(high.y as usize).min(self.rows);
        rows.flat_map(move |row| columns.clone().map(move |column| row * self.columns + column))
            .filter_map(|index| self.heights.get(index).filter(|height| height.is_finite()).map(|&z| f64::from(z)))
    }

    /// Maximum height over a rectangle; `None` without points.
    pub fn highest(&self, center: DVec2, half: DVec2) -> Option<f64> {
        self.within(center, half).reduce(f64::max)
    }

    /// Quantile `share` (0 to 1) of the cell heights over a rectangle; `None` without points.
    pub fn quantile(&self, center: DVec2, half: DVec2, share: f64) -> Option<f64> {
        let mut heights: Vec<f64> = self.within(center, half).collect();
        heights.sort_by(f64::total_cmp);
        heights.get(((heights.len().max(1) - 1) as f64 * share).round() as usize).copied()
    }
}
