//! Colour and roughness of a surface from its pixels and their renderings at candidate roughnesses.
//!
//! Reflected light is affine in the base colour: what a black surface reflects, and what the colour adds. For each
//! candidate roughness both are rendered, so the best factor on the colour follows by robust least squares; the
//! costs of the candidates tell the roughness and how well the pixels determine it.

use glam::Vec3A;

/// Candidate roughnesses.
pub const ROUGHNESSES: [f64; 12] = [0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.6, 0.7, 0.85, 1.0];
/// Widest range of a roughness that counts as identified.
const WIDEST: f64 = 0.3;
/// Residual beyond which a pixel counts less and less, relative to the mean radiance: shifted texture, dirt.
const OUTLIER: f64 = 0.15;
/// Smallest residual that a rendered surface is expected to leave, relative to the mean radiance.
const MODEL_SD: f64 = 0.05;
/// Largest residual, relative to the mean radiance, with which renderings still explain the photographs.
const MISFIT: f64 = 0.08;
/// Number of neighbouring pixels whose residuals are taken as one: texture and rendering errors are correlated.
const CORRELATED: f64 = 40.0;
/// Rise of χ² at the ends of the range.
const CHI_SQUARE: f64 = 3.84;
/// Iterations of the reweighted least squares.
const ITERATIONS: usize = 8;

/// Pixels of a surface.
#[derive(Clone, Debug, Default)]
pub struct Pixels {
    /// Photographed radiance.
    pub seen: Vec<Vec3A>,
    /// True for pixels that are at least as bright as they look.
    pub is_overexposed: Vec<bool>,
}

/// The same pixels, rendered with one roughness: light off a black surface, and what the colour adds.
pub type Rendered = Vec<[Vec3A; 2]>;

/// Best factors on the colour at one roughness.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fit {
    /// Factors of red, green and blue.
    pub factor: [f64; 3],
    /// Robust cost.
    pub cost: f64,
}

/// A roughness, and the range that fits nearly as well.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Roughness {
    /// Estimate.
    pub value: f64,
    /// Roughnesses that fit nearly as well. Errors of the light count only roughly ([`MODEL_SD`]), so this is no
    /// confidence interval: in tests it holds the truth in two of three cases.
    pub range: [f64; 2],
    /// Root mean square of the robust residuals, relative to the mean radiance.
    pub misfit: f64,
}

impl Pixels {
    /// Number of pixels.
    pub fn len(&self) -> usize {
        self.seen.len()
    }

    /// Best factors at one roughness.
    pub fn fit(&self, rendered: &Rendered) -> Fit {
        let channels = [0, 1, 2].map(|channel| self.channel(rendered, channel));
        Fit { factor: channels.map(|(factor, _)| factor), cost: channels.iter().map(|(_, cost)| cost).sum() }
    }

    /// Factor and cost of one colour channel.
    fn channel(&self, rendered: &Rendered, channel: usize) -> (f64, f64) {
        let outlier = OUTLIER * self.brightness();
        let residual = |factor: f64, index: usize| {
            let [black, added] = rendered[index].map(|color| f64::from(color[channel]));
            let off = black + factor * added - f64::from(self.seen[index][channel]);
            if self.is_overexposed[index] { off.min(0.0) } else { off }
        };
        let weight = |off: f64| 1.0 / (1.0 + (off / outlier).powi(2));
        let mut factor = 1.0;
        for _ in 0..ITERATIONS {
            let (mut top, mut bottom) = (0.0, 0.0);
            for index in (0..self.len()).filter(|&index| !self.is_overexposed[index]) {
                let [black, added] = rendered[index].map(|color| f64::from(color[channel]));
                let weight = weight(residual(factor, index));
                top += weight * added * (f64::from(self.seen[index][channel]) - black);
                bottom += weight * added * added;
            }
            factor = if bottom > 0.0 { (top / bottom).clamp(0.0, 100.0) } else { factor };
        }
        let cost = |off: f64| outlier * outlier * (off / outlier).powi(2).ln_1p();
        (factor, (0..self.len()).map(|index| cost(residual(factor, index))).sum())
    }

    /// Mean radiance.
    fn brightness(&self) -> f64 {
        let sum: f64 = self.seen.iter().map(|color| f64::from(color.element_sum()) / 3.0).sum();
        (sum / self.len().max(1) as f64).max(0.01)
    }

    /// Roughness from the costs of the candidates, in their order.
    pub fn roughness(&self, fits: &[Fit]) -> Roughness {
        let costs: Vec<f64> = fits.iter().map(|fit| fit.cost).collect();
        let best = (0..costs.len()).min_by(|a, b| costs[*a].total_cmp(&costs[*b])).unwrap_or_default();
        let (value, least) = lowest(&costs, best);
        let misfit = (least.max(0.0) / (3 * self.len().max(1)) as f64).sqrt() / self.brightness();
        let variance = (misfit.max(MODEL_SD) * self.brightness()).powi(2);
        let limit = least + CHI_SQUARE * CORRELATED * variance;
        let ends = [ROUGHNESSES[0], ROUGHNESSES[ROUGHNESSES.len() - 1]];
        let crossing = |inner: usize, outer: usize| {
            let share = ((limit - costs[inner]) / (costs[outer] - costs[inner])).clamp(0.0, 1.0);
            ROUGHNESSES[inner] + share * (ROUGHNESSES[outer] - ROUGHNESSES[inner])
        };
        let low = (0..best).rev().find(|&at| costs[at] > limit).map_or(ends[0], |at| crossing(at + 1, at));
        let high = (best + 1..costs.len()).find(|&at| costs[at] > limit).map_or(ends[1], |at| crossing(at - 1, at));
        Roughness { value, range: [low.min(value), high.max(value)], misfit }
    }
}

/// Roughness with the lowest cost, and that cost: of the parabola through the best candidate and its neighbours.
fn lowest(costs: &[f64], best: usize) -> (f64, f64) {
    let at = |index: usize| (ROUGHNESSES[index], costs[index]);
    let usual = at(best);
    if best == 0 || best + 1 >= costs.len() {
        return usual;
    }
    let [(x0, y0), (x1, y1), (x2, y2)] = [at(best - 1), usual, at(best + 1)];
    let (left, right) = ((y1 - y0) / (x1 - x0), (y2 - y1) / (x2 - x1));
    let curvature = (right - left) / (x2 - x0);
    if curvature <= 0.0 {
        return usual;
    }
    let value = 0.5 * (x0 + x1) - left / (2.0 * curvature);
    (value.clamp(x0, x2), y0 + left * (value - x0) + curvature * (value - x0) * (value - x1))
}

impl Roughness {
    /// True if the pixels tell the roughness.
    pub fn is_identified(&self) -> bool {
        self.is_explained() && self.range[1] - self.range[0] <= WIDEST
    }

    /// True if renderings explain the photographs.
    pub fn is_explained(&self) -> bool {
        self.misfit <= MISFIT
    }
}

/// Factors at any roughness, between those of the candidates.
pub fn factor_at(fits: &[Fit], roughness: f64) -> [f64; 3] {
    let above = ROUGHNESSES.iter().position(|it| *it >= roughness).unwrap_or(ROUGHNESSES.len() - 1).max(1);
    let (low, high) = (ROUGHNESSES[above - 1], ROUGHNESSES[above]);
    let share = ((roughness - low) / (high - low)).clamp(0.0, 1.0);
    [0, 1, 2].map(|channel| {
        let [a, b] = [above - 1, above].map(|at| fits[at].factor[channel]);
        a + share * (b - a)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pixels across a highlight of this strength, and their renderings at each candidate: a lobe that widens with the
    /// roughness above an even colour.
    fn sphere(strength: f32) -> (Pixels, Vec<Rendered>) {
        let lobe = |place: f32, roughness: f64| strength * (-(place / roughness as f32).powi(2)).exp();
        let places = || (0..400).map(|index| index as f32 / 200.0 - 1.0);
        let color = Vec3A::new(0.4, 0.3, 0.2);
        let seen = places().map(|place| Vec3A::splat(lobe(place, 0.34)) + color * Vec3A::new(1.2, 0.5, 1.0));
        let seen: Vec<Vec3A> = seen.collect();
        let is_overexposed = seen.iter().map(|it| it.max_element() > 0.7).collect();
        let clipped = seen.into_iter().map(|it| it.min(Vec3A::splat(0.7))).collect();
        let rendered = |roughness: &f64| places().map(|place| [Vec3A::splat(lobe(place, *roughness)), color]).collect();
        (Pixels { seen: clipped, is_overexposed }, ROUGHNESSES.iter().map(rendered).collect())
    }

    /// A highlight tells roughness and colour, although it is overexposed; without one only the colour is told.
    #[test]
    fn a_highlight_tells_the_roughness() {
        for (strength, is_told) in [(0.5, true), (0.2, true), (0.001, false)] {
            let (pixels, rendered) = sphere(strength);
            let fits: Vec<Fit> = rendered.iter().map(|rendered| pixels.fit(rendered)).collect();
            let found = pixels.roughness(&fits);
            assert_eq!(found.is_identified(), is_told, "{strength}: {found:?}");
            if is_told {
                assert!((found.value - 0.34).abs() < 0.03, "{strength}: {found:?}");
                assert!((found.range[0]..=found.range[1]).contains(&0.34), "{strength}: {found:?}");
            }
            for (factor, truth) in factor_at(&fits, found.value).iter().zip([1.2, 0.5, 1.0]) {
                assert!((factor / truth - 1.0).abs() < 0.04, "{strength}: {factor} for {truth}");
            }
        }
    }
}
