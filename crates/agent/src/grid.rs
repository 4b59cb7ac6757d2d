//! The labelled grid over an image: rows A, B, … from the top, columns from 1 at the left.

use std::fmt;

/// A grid that divides a rectangle of an image, usually all of it, evenly into cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Grid {
    /// Number of rows, at most 26.
    pub rows: u32,
    /// Number of columns.
    pub columns: u32,
    /// Left edge in the image (px).
    pub left: u32,
    /// Upper edge in the image (px).
    pub top: u32,
    /// Width of the whole grid (px).
    pub width: u32,
    /// Height of the whole grid (px).
    pub height: u32,
}

/// A grid cell, indexed from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Cell {
    /// Index of the row, from the top.
    pub row: u32,
    /// Index of the column, from the left.
    pub column: u32,
}

impl Grid {
    /// The default grid of 9 rows and 16 columns: square cells on 16:9 images.
    pub fn usual(width: u32, height: u32) -> Self {
        Self { rows: 9, columns: 16, left: 0, top: 0, width, height }
    }

    /// A grid over a cell and its neighbours, each of which is divided into `parts` x `parts` cells.
    #[must_use]
    pub fn around(&self, cell: Cell, parts: u32) -> Self {
        let first = Cell { row: cell.row.saturating_sub(1), column: cell.column.saturating_sub(1) };
        let last = Cell { row: (cell.row + 1).min(self.rows - 1), column: (cell.column + 1).min(self.columns - 1) };
        let [left, top, ..] = self.edges(first).map(|edge| edge.round() as u32);
        let [_, _, right, bottom] = self.edges(last).map(|edge| edge.round() as u32);
        let [rows, columns] = [last.row - first.row + 1, last.column - first.column + 1].map(|count| count * parts);
        Self { rows, columns, left, top, width: right - left, height: bottom - top }
    }

    /// All cells in row-major order.
    pub fn cells(&self) -> impl Iterator<Item = Cell> + use<> {
        let Self { rows, columns, .. } = *self;
        (0..rows).flat_map(move |row| (0..columns).map(move |column| Cell { row, column }))
    }

    /// Left, top, right and bottom edge of a cell (px); pixel k covers k to k + 1.
    pub fn edges(&self, cell: Cell) -> [f64; 4] {
        let x =
            |column: u32| f64::from(self.left) + f64::from(column) * f64::from(self.width) / f64::from(self.columns);
        let y = |row: u32| f64::from(self.top) + f64::from(row) * f64::from(self.height) / f64::from(self.rows);
        [x(cell.column), y(cell.row), x(cell.column + 1), y(cell.row + 1)]
    }

    /// Centre of a cell in pixel coordinates with whole numbers at pixel centres.
    pub fn center(&self, cell: Cell) -> [f64; 2] {
        let [left, top, right, bottom] = self.edges(cell);
        [(left + right) / 2.0 - 0.5, (top + bottom) / 2.0 - 0.5]
    }

    /// Cell that contains a pixel; `None` outside the grid.
    pub fn cell_at(&self, x: f64, y: f64) -> Option<Cell> {
        let (x, y) = (x + 0.5 - f64::from(self.left), y + 0.5 - f64::from(self.top));
        let (x, y) = (x / f64::from(self.width), y / f64::from(self.height));
        ((0.0..1.0).contains(&x) && (0.0..1.0).contains(&y))
            .then(|| Cell { row: (y * f64::from(self.rows)) as u32, column: (x * f64::from(self.columns)) as u32 })
    }

    /// Cell of a label such as `C4`; `None` if there is no such cell.
    pub fn named(&self, label: &str) -> Option<Cell> {
        let letter = label.chars().next().filter(char::is_ascii_uppercase)?;
        let digits = &label[1..];
        let column: u32 = digits.parse().ok().filter(|_| !digits.starts_with(['0', '+']))?;
        let row = u32::from(letter) - u32::from('A');
        (row < self.rows && (1..=self.columns).contains(&column)).then(|| Cell { row, column: column - 1 })
    }
}

impl fmt::Display for Cell {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let letter = char::from_u32(u32::from('A') + self.row).unwrap_or('?');
        write!(f, "{letter}{}", self.column + 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_name_their_cells_and_nothing_else() {
        for (width, height) in [(512, 288), (1280, 720), (640, 480)] {
            let grid = Grid::usual(width, height);
            for cell in grid.cells() {
                assert_eq!(grid.named(&cell.to_string()), Some(cell));
                let [x, y] = grid.center(cell);
                assert_eq!(grid.cell_at(x, y), Some(cell));
            }
            for label in ["", "Z99", "J1", "A0", "A17", "A", "1A", "a1", "A01", "A+1", "A1 ", "É1", "A-1", "A1.0"] {
                assert_eq!(grid.named(label), None, "{label}");
            }
            assert_eq!(grid.cell_at(-0.6, 0.0), None);
            assert_eq!(grid.cell_at(f64::from(width) - 0.4, 0.0), None);
            assert_eq!(grid.cell_at(f64::NAN, 0.0), None);
        }
    }
    #[test]
    fn a_finer_grid_covers_a_cell_and_its_neighbours() {
        let coarse = Grid::usual(512, 288);
        let check = |label: &str, expected: [u32; 6]| {
            let cell = coarse.named(label).unwrap();
            let fine = coarse.around(cell, 4);
            let Grid { rows, columns, left, top, width, height } = fine;
            assert_eq!([rows, columns, left, top, width, height], expected, "{label}");
            let [x, y] = coarse.center(cell);
            assert!(fine.cell_at(x, y).is_some());
            for cell in fine.cells() {
                assert_eq!(fine.named(&cell.to_string()), Some(cell));
                let [x, y] = fine.center(cell);
                assert_eq!(fine.cell_at(x, y), Some(cell));
            }
        };
        check("C4", [12, 12, 64, 32, 96, 96]);
        check("A1", [8, 8, 0, 0, 64, 64]);
        check("I16", [8, 8, 448, 224, 64, 64]);
    }
}
