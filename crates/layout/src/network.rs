//! Where objects may be along one axis, given how they stand to each other: a network of differences.
//!
//! Every relation with one anchor bounds how far one centre lies from another, along x and along y separately.
//! Closing such a network tells for each object the exact interval that still leaves room for all the others,
//! so that a chain of relations does not run off the table, and finds the relations that contradict each other.
//! After Dechter, Meiri and Pearl, "Temporal constraint networks", 1991.

/// Index of the world's origin among the coordinates of a [`Network`]; object `i` is coordinate `i + 1`.
pub(crate) const ORIGIN: usize = 0;

/// Bounds on the differences between coordinates along one axis, metres.
#[derive(Clone, Debug)]
pub(crate) struct Network {
    count: usize,
    /// `most[a * count + b]`: the largest value of `b - a`.
    most: Vec<f64>,
    /// The edge that gave a bound, where one did.
    cause: Vec<Option<usize>>,
    /// The coordinate that a bound was derived through.
    via: Vec<Option<usize>>,
}

impl Network {
    /// A network of so many objects and the origin, nothing bounded.
    pub fn new(objects: usize) -> Self {
        let count = objects + 1;
        let mut most = vec![f64::INFINITY; count * count];
        (0..count).for_each(|at| most[at * count + at] = 0.0);
        Self { count, most, cause: vec![None; count * count], via: vec![None; count * count] }
    }

    /// Bounds `b - a`; `cause` is the edge that asks for it.
    pub fn bound(&mut self, a: usize, b: usize, [low, high]: [f64; 2], cause: Option<usize>) {
        for (from, to, most) in [(a, b, high), (b, a, -low)] {
            let at = from * self.count + to;
            if most < self.most[at] {
                (self.most[at], self.cause[at]) = (most, cause);
            }
        }
    }

    /// Derives every bound from the given ones.
    ///
    /// # Errors
    /// The edges that contradict each other, in order; none when the origin's bounds alone do.
    pub fn close(&mut self) -> Result<(), Vec<usize>> {
        let count = self.count;
        for through in 0..count {
            for from in 0..count {
                let first = self.most[from * count + through];
                if from == through || first.is_infinite() {
                    continue;
                }
                for to in (0..count).filter(|&to| to != through) {
                    let sum = first + self.most[through * count + to];
                    if sum < self.most[from * count + to] - 1e-12 {
                        if from == to {
                            let mut edges = Vec::new();
                            self.explain(from, through, &mut edges);
                            self.explain(through, from, &mut edges);
                            edges.sort_unstable();
                            edges.dedup();
                            return Err(edges);
                        }
                        self.most[from * count + to] = sum;
                        self.via[from * count + to] = Some(through);
                    }
                }
            }
        }
        Ok(())
    }

    /// The edges that a bound follows from.
    fn explain(&self, from: usize, to: usize, edges: &mut Vec<usize>) {
        match self.via[from * self.count + to] {
            Some(through) => {
                self.explain(from, through, edges);
                self.explain(through, to, edges);
            }
            None => edges.extend(self.cause[from * self.count + to]),
        }
    }

    /// Where object `object` may be, given the coordinates of objects that are placed; empty when the first number is larger.
    pub fn range(&self, object: usize, placed: impl Iterator<Item = (usize, f64)>) -> [f64; 2] {
        let at = object + 1;
        let known = placed.map(|(other, value)| (other + 1, value)).chain([(ORIGIN, 0.0)]);
        known.fold([f64::NEG_INFINITY, f64::INFINITY], |[low, high], (other, value)| {
            [low.max(value - self.most[at * self.count + other]), high.min(value + self.most[other * self.count + at])]
        })
    }

    /// Whether a bound on the difference between two objects follows from the given ones.
    pub fn ties(&self, a: usize, b: usize) -> bool {
        let at = (a + 1) * self.count + b + 1;
        self.via[at].is_none_or(|via| via != ORIGIN) && self.most[at].is_finite()
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

    /// From, to, and the range of their difference.
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
