//! Difference constraints on object centres along one axis (simple temporal network).
//!
//! Every relation with one reference bounds the difference between two centres, along x and y separately. The closed
//! network gives, for each object, the exact interval that leaves space for all others, so that a chain of relations
//! does not run off the table, and identifies contradicting relations. After Dechter, Meiri and Pearl, "Temporal
//! constraint networks", 1991.

/// Index of the world's origin among the coordinates of a [`Network`]; object `i` has coordinate `i + 1`.
pub(crate) const ORIGIN: usize = 0;

/// Difference bounds between coordinates along one axis (m).
#[derive(Clone, Debug)]
pub(crate) struct Network {
    count: usize,
    /// `upper[a * count + b]`: upper bound of `b - a`; infinite without a bound.
    upper: Vec<f64>,
    /// Index of the edge that imposed a bound; `None` for bounds of the table, derived bounds and no bound. Layout as
    /// `upper`.
    cause: Vec<Option<usize>>,
    /// Coordinate through which a derived bound was found; `None` for a given bound. Layout as `upper`.
    via: Vec<Option<usize>>,
}

impl Network {
    /// A network of `objects` objects and the origin, without bounds.
    pub fn new(objects: usize) -> Self {
        let count = objects + 1;
        let mut upper = vec![f64::INFINITY; count * count];
        (0..count).for_each(|at| upper[at * count + at] = 0.0);
        Self { count, upper, cause: vec![None; count * count], via: vec![None; count * count] }
    }

    /// Bounds `b - a`; `cause` is the edge that imposes it.
    pub fn bound(&mut self, a: usize, b: usize, [low, high]: [f64; 2], cause: Option<usize>) {
        for (from, to, upper) in [(a, b, high), (b, a, -low)] {
            let at = from * self.count + to;
            if upper < self.upper[at] {
                (self.upper[at], self.cause[at]) = (upper, cause);
            }
        }
    }

    /// Computes the transitive closure of the bounds (Floyd-Warshall).
    ///
    /// # Errors
    /// The contradicting edges, in order; empty if the origin's bounds alone contradict each other.
    pub fn close(&mut self) -> Result<(), Vec<usize>> {
        let count = self.count;
        for through in 0..count {
            for from in 0..count {
                let first = self.upper[from * count + through];
                if from == through || first.is_infinite() {
                    continue;
                }
                for to in (0..count).filter(|&to| to != through) {
                    let sum = first + self.upper[through * count + to];
                    if sum < self.upper[from * count + to] - 1e-12 {
                        if from == to {
                            let mut edges = Vec::new();
                            self.explain(from, through, &mut edges);
                            self.explain(through, from, &mut edges);
                            edges.sort_unstable();
                            edges.dedup();
                            return Err(edges);
                        }
                        self.upper[from * count + to] = sum;
                        self.via[from * count + to] = Some(through);
                    }
                }
            }
        }
        Ok(())
    }

    /// Collects the edges that imply a bound.
    fn explain(&self, from: usize, to: usize, edges: &mut Vec<usize>) {
        match self.via[from * self.count + to] {
            Some(through) => {
                self.explain(from, through, edges);
                self.explain(through, to, edges);
            }
            None => edges.extend(self.cause[from * self.count + to]),
        }
    }

    /// Feasible interval of an object given the coordinates of placed objects; empty if the first number is larger.
    pub fn range(&self, object: usize, placed: impl Iterator<Item = (usize, f64)>) -> [f64; 2] {
        let at = object + 1;
        let known = placed.map(|(other, value)| (other + 1, value)).chain([(ORIGIN, 0.0)]);
        known.fold([f64::NEG_INFINITY, f64::INFINITY], |[low, high], (other, value)| {
            [
                low.max(value - self.upper[at * self.count + other]),
                high.min(value + self.upper[other * self.count + at]),
            ]
        })
    }

    /// True if the given bounds imply a bound on the difference between two objects.
    pub fn are_related(&self, a: usize, b: usize) -> bool {
        let at = (a + 1) * self.count + b + 1;
        self.via[at].is_none_or(|via| via != ORIGIN) && self.upper[at].is_finite()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_chain_leaves_room_for_what_is_still_to_come() {
        let mut network = Network::new(3);
        (0..3).for_each(|object| network.bound(ORIGIN, object + 1, [0.0, 1.0], None));
        network.bound(1, 2, [0.3, 0.4], Some(0));
        network.bound(2, 3, [0.3, 0.4], Some(1));
        network.close().unwrap();
        assert_eq!(network.range(0, [].into_iter()), [0.0, 0.4]);
        let [low, high] = network.range(1, [(0, 0.35)].into_iter());
        assert!((low - 0.65).abs() < 1e-12 && (high - 0.7).abs() < 1e-12, "{low} {high}");
    }

    /// From, to, and the interval of their difference.
    type Bound = (usize, usize, [f64; 2]);

    #[test]
    fn contradictions_name_their_edges_and_no_others() {
        let cases: [(&str, &[Bound], &[usize]); 3] = [
            ("circle", &[(1, 2, [0.1, 0.2]), (2, 3, [0.1, 0.2]), (3, 1, [0.1, 0.2]), (3, 4, [0.1, 0.2])], &[0, 1, 2]),
            ("both sides", &[(1, 2, [0.1, 0.2]), (3, 4, [0.0, 0.1]), (1, 2, [-0.2, -0.1])], &[0, 2]),
            ("too long for the table", &[(1, 2, [0.6, 0.7]), (2, 3, [0.6, 0.7]), (4, 3, [0.0, 0.1])], &[0, 1]),
        ];
        for (name, bounds, expected) in cases {
            let mut network = Network::new(4);
            (0..4).for_each(|object| network.bound(ORIGIN, object + 1, [0.0, 1.0], None));
            for (edge, &(a, b, range)) in bounds.iter().enumerate() {
                network.bound(a, b, range, Some(edge));
            }
            assert_eq!(network.close().unwrap_err(), expected, "{name}");
        }
    }
}
