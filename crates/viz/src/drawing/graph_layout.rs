//! Node positions of a scene graph: grid cells that agree with the spatial meaning of the relations.

use genmanip_core::Seed;
use rand::RngExt;

/// Cell of the grid, (column, row): columns increase to the right, rows increase up the page (away from the robot).
pub type Cell = [i32; 2];

/// Constraint of an edge on the cells of its two ends, given by node indices.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CellConstraint {
    pub from: usize,
    pub to: usize,
    pub wish: PreferredCell,
}

/// Preferred cell of node `from`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PreferredCell {
    /// Cell one step from node `to` in this direction.
    Step(Cell),
    /// Cell next to node `to`.
    Close,
    /// Cell halfway between node `to` and this other node.
    Middle(usize),
}

/// Number of local searches, and the maximum number of changes in each; most end in a local optimum earlier.
const RESTARTS: u64 = 6;
const MAX_ROUNDS: usize = 60;

/// Cells of `count` nodes: the best result of several local searches by moves and swaps. The same input gives the same
/// cells.
pub fn cells(count: usize, ties: &[CellConstraint]) -> Vec<Cell> {
    let side = (count as i32).min(6);
    let mut best = (f64::INFINITY, Vec::new());
    for restart in 0..RESTARTS {
        let mut cells = if restart == 0 { grown(count, ties) } else { scattered(count, side, restart) };
        let mut cost = total_cost(&cells, ties);
        for _ in 0..MAX_ROUNDS {
            let Some((better, improved)) = best_change(&cells, ties, side, cost) else { break };
            (cost, cells) = (better, improved);
        }
        if cost < best.0 - 1e-9 {
            best = (cost, cells);
        }
    }
    normalised(best.1)
}

/// Initial arrangement, found by following the edges from the first node of each connected component: one step in the
/// preferred direction, or one column to the right of `to` for the other preferences. Several nodes may share a cell.
fn grown(count: usize, ties: &[CellConstraint]) -> Vec<Cell> {
    let mut cells: Vec<Option<Cell>> = vec![None; count];
    for start in 0..count {
        if cells[start].is_some() {
            continue;
        }
        cells[start] = Some([start as i32 * 2, 0]);
        for _ in 0..count {
            for tie in ties {
                let step = if let PreferredCell::Step(step) = tie.wish { step } else { [1, 0] };
                match (cells[tie.from], cells[tie.to]) {
                    (None, Some(to)) => cells[tie.from] = Some([to[0] + step[0], to[1] + step[1]]),
                    (Some(from), None) => cells[tie.to] = Some([from[0] - step[0], from[1] - step[1]]),
                    _ => {}
                }
            }
        }
    }
    cells.into_iter().map(Option::unwrap_or_default).collect()
}

fn scattered(count: usize, side: i32, restart: u64) -> Vec<Cell> {
    let mut rng = Seed::new(restart).fork("graph drawing").rng();
    (0..count).map(|_| [rng.random_range(0..side.max(1)), rng.random_range(0..side.max(1))]).collect()
}

/// Best single move or swap, as cost and cells; `None` if none reduces the cost.
fn best_change(cells: &[Cell], ties: &[CellConstraint], side: i32, cost: f64) -> Option<(f64, Vec<Cell>)> {
    let mut best: Option<(f64, Vec<Cell>)> = None;
    let mut consider = |candidate: Vec<Cell>| {
        let candidate_cost = total_cost(&candidate, ties);
        if candidate_cost < best.as_ref().map_or(cost, |best| best.0) - 1e-9 {
            best = Some((candidate_cost, candidate));
        }
    };
    let low = |axis: usize| cells.iter().map(|cell| cell[axis]).min().unwrap_or(0) - 1;
    let (column0, row0) = (low(0), low(1));
    for node in 0..cells.len() {
        for column in column0..=column0 + side + 1 {
            for row in row0..=row0 + side + 1 {
                let mut candidate = cells.to_vec();
                candidate[node] = [column, row];
                consider(candidate);
            }
        }
        for other in node + 1..cells.len() {
            let mut candidate = cells.to_vec();
            candidate.swap(node, other);
            consider(candidate);
        }
    }
    best
}

/// Cost of an arrangement: violated preferences, nodes in the same cell or on an edge of others, crossing edges,
/// extent.
fn total_cost(cells: &[Cell], ties: &[CellConstraint]) -> f64 {
    let mut cost = 0.0;
    for (index, cell) in cells.iter().enumerate() {
        cost += 1000.0 * cells[index + 1..].iter().filter(|other| *other == cell).count() as f64;
    }
    for (index, tie) in ties.iter().enumerate() {
        cost += wish_cost(cells, tie);
        cost += 18.0 * blocked(cells, tie.from, tie.to);
        if let PreferredCell::Middle(other) = tie.wish {
            cost += 18.0 * blocked(cells, tie.from, other);
        }
        cost += 6.0 * ties[index + 1..].iter().filter(|other| crosses(cells, tie, other)).count() as f64;
    }
    let extent = |axis: usize| {
        let values = cells.iter().map(|cell| cell[axis]);
        f64::from(values.clone().max().unwrap_or(0) - values.min().unwrap_or(0))
    };
    let (columns, rows) = (extent(0), extent(1));
    cost + 1.0 * columns + 1.2 * rows + 14.0 * (columns - 3.0).max(0.0) + 3.0 * (rows - 4.0).max(0.0)
}

fn wish_cost(cells: &[Cell], tie: &CellConstraint) -> f64 {
    let (from, to) = (cells[tie.from], cells[tie.to]);
    let delta = [from[0] - to[0], from[1] - to[1]];
    match tie.wish {
        PreferredCell::Step(step) => {
            let along = f64::from(delta[0] * step[0] + delta[1] * step[1]);
            let across = f64::from((delta[0] * step[1] - delta[1] * step[0]).abs());
            let wrong = if along < 1.0 { 60.0 + 20.0 * (1.0 - along) } else { 3.0 * (along - 1.0) };
            wrong + 4.0 * across
        }
        PreferredCell::Close => 3.0 * f64::from((delta[0].abs() + delta[1].abs() - 1).max(0)),
        PreferredCell::Middle(other) => {
            let other = cells[other];
            let off = (2 * from[0] - to[0] - other[0]).abs() + (2 * from[1] - to[1] - other[1]).abs();
            let apart = (to[0] - other[0]).abs() + (to[1] - other[1]).abs();
            8.0 * f64::from(off) + 2.0 * f64::from((apart - 2).max(0))
        }
    }
}

/// Number of other nodes on the straight line between two nodes.
fn blocked(cells: &[Cell], from: usize, to: usize) -> f64 {
    let (a, b) = (cells[from], cells[to]);
    let (dx, dy) = (f64::from(b[0] - a[0]), f64::from(b[1] - a[1]));
    let length2 = dx * dx + dy * dy;
    let in_the_way = |cell: &Cell| {
        let (px, py) = (f64::from(cell[0] - a[0]), f64::from(cell[1] - a[1]));
        let t = (px * dx + py * dy) / length2.max(1e-9);
        t > 0.0 && t < 1.0 && (px - t * dx).hypot(py - t * dy) < 0.45
    };
    cells.iter().enumerate().filter(|(node, cell)| *node != from && *node != to && in_the_way(cell)).count() as f64
}

fn crosses(cells: &[Cell], a: &CellConstraint, b: &CellConstraint) -> bool {
    if a.from == b.from || a.from == b.to || a.to == b.from || a.to == b.to {
        return false;
    }
    let side = |p: Cell, q: Cell, r: Cell| ((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])).signum();
    let (p, q, r, s) = (cells[a.from], cells[a.to], cells[b.from], cells[b.to]);
    side(p, q, r) * side(p, q, s) < 0 && side(r, s, p) * side(r, s, q) < 0
}

/// Same arrangement without empty rows and columns, with indices from 0.
fn normalised(cells: Vec<Cell>) -> Vec<Cell> {
    let used = |axis: usize| {
        let mut used: Vec<i32> = cells.iter().map(|cell| cell[axis]).collect();
        used.sort_unstable();
        used.dedup();
        used
    };
    let (columns, rows) = (used(0), used(1));
    let rank = |used: &[i32], value: i32| used.iter().take_while(|other| **other < value).count() as i32;
    cells.iter().map(|cell| [rank(&columns, cell[0]), rank(&rows, cell[1])]).collect()
}
