//! Agreement of the success rates of the same policies in simulation and in reality.

use statrs::statistics::{Data, OrderStatistics, RankTieBreaker};

/// A pair of policies whose order in simulation contradicts that in reality.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RankViolation {
    /// Index of the policy with the higher rate in reality.
    pub better: usize,
    /// Index of the other policy.
    pub worse: usize,
    /// Rate of the better policy minus that of the worse in reality, > 0.
    pub real_gap: f64,
    /// Rate of the better policy minus that of the worse in simulation: negative, or 0 for a tie.
    pub sim_gap: f64,
}

/// Mean maximum rank violation (SimplerEnv, Li et al. 2024): for each policy the largest difference in reality to a
/// policy that simulation ranks the other way, averaged over policies. 0 is best, 1 worst; 0 without policies.
///
/// A pair (i, j) is violated if exactly one of `sim[i] > sim[j]` and `real[i] > real[j]` holds, so ties are not
/// symmetric, and the order of the arguments matters.
///
/// ```
/// use genmanip_benchmark::statistics::mmrv;
/// assert_eq!(mmrv(&[0.5, 0.5], &[0.9, 0.1]), 0.4);
/// assert_eq!(mmrv(&[0.9, 0.1], &[0.5, 0.5]), 0.0);
/// ```
pub fn mmrv(sim: &[f64], real: &[f64]) -> f64 {
    let count = sim.len().min(real.len());
    let violation = |i: usize, j: usize| match (sim[i] > sim[j]) != (real[i] > real[j]) {
        true => (real[i] - real[j]).abs(),
        false => 0.0,
    };
    let worst = |i: usize| (0..count).map(|j| violation(i, j)).fold(0.0, f64::max);
    (0..count).map(worst).sum::<f64>() / count.max(1) as f64
}

/// Pairs that contribute to [`mmrv`], largest difference in reality first.
pub fn rank_violations(sim: &[f64], real: &[f64]) -> Vec<RankViolation> {
    let count = sim.len().min(real.len());
    let mut violations = Vec::new();
    for better in 0..count {
        for worse in (0..count).filter(|&worse| real[better] > real[worse]) {
            let (real_gap, sim_gap) = (real[better] - real[worse], sim[better] - sim[worse]);
            if sim_gap <= 0.0 {
                violations.push(RankViolation { better, worse, real_gap, sim_gap });
            }
        }
    }
    violations.sort_by(|a, b| b.real_gap.total_cmp(&a.real_gap));
    violations
}

/// Pearson correlation as SimplerEnv computes it, with 1e-8 added to the denominator: 0 if one list is constant, 1 if
/// the centred lists are equal.
pub fn pearson(sim: &[f64], real: &[f64]) -> f64 {
    let (sim, real) = (centred(sim), centred(real));
    if sim == real {
        return 1.0;
    }
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    product(&sim, &real) / ((product(&sim, &sim) * product(&real, &real)).sqrt() + 1e-8)
}

/// Spearman's rank correlation, ties with their mean rank; `None` if one list is constant.
pub fn spearman(sim: &[f64], real: &[f64]) -> Option<f64> {
    let ranks = |values: &[f64]| centred(&Data::new(values.to_vec()).ranks(RankTieBreaker::Average));
    let (sim, real) = (ranks(sim), ranks(real));
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let scale = (product(&sim, &sim) * product(&real, &real)).sqrt();
    (scale > 0.0).then(|| product(&sim, &real) / scale)
}

/// Kendall's τ-b, which corrects for ties; `None` if one list is constant.
pub fn kendall(sim: &[f64], real: &[f64]) -> Option<f64> {
    let count = sim.len().min(real.len());
    let (mut agreement, mut untied_sim, mut untied_real) = (0.0, 0.0, 0.0);
    for i in 0..count {
        for j in 0..i {
            let order = |values: &[f64]| f64::from(i8::from(values[i] > values[j]) - i8::from(values[i] < values[j]));
            let (s, r) = (order(sim), order(real));
            agreement += s * r;
            untied_sim += s.abs();
            untied_real += r.abs();
        }
    }
    let scale = f64::sqrt(untied_sim * untied_real);
    (scale > 0.0).then(|| agreement / scale)
}

/// Results of pairwise comparisons of two policies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Duel {
    /// Index of the first policy.
    pub first: usize,
    /// Index of the second policy.
    pub second: usize,
    /// Number of comparisons that the first policy won; a tie counts as half.
    pub first_wins: f64,
    /// Number of comparisons that the second policy won; a tie counts as half.
    pub second_wins: f64,
}

/// Strengths of a Bradley–Terry model of `policies` policies, as probabilities of winning against the average opponent.
///
/// Maximum of the likelihood with one virtual tie added between each policy and an opponent of average strength, so
/// that policies that won or lost everything have a finite strength (MM algorithm, Hunter 2004).
///
/// ```
/// use genmanip_benchmark::statistics::{Duel, bradley_terry};
/// let chances = bradley_terry(2, &[Duel { first: 0, second: 1, first_wins: 9.0, second_wins: 1.0 }]);
/// assert!(chances[0] > 0.7 && (chances[0] + chances[1] - 1.0).abs() < 1e-9);
/// ```
pub fn bradley_terry(policies: usize, duels: &[Duel]) -> Vec<f64> {
    /// Iterations; ample, since the change per iteration falls geometrically.
    const ITERATIONS: usize = 10_000;
    let mut wins = vec![0.5; policies];
    for duel in duels {
        wins[duel.first] += duel.first_wins;
        wins[duel.second] += duel.second_wins;
    }
    let mut strength = vec![1.0; policies];
    for _ in 0..ITERATIONS {
        let mut share: Vec<f64> = strength.iter().map(|own| 1.0 / (own + 1.0)).collect();
        for duel in duels {
            let weight = (duel.first_wins + duel.second_wins) / (strength[duel.first] + strength[duel.second]);
            share[duel.first] += weight;
            share[duel.second] += weight;
        }
        let next: Vec<f64> = wins.iter().zip(&share).map(|(wins, share)| wins / share).collect();
        let change = next.iter().zip(&strength).map(|(next, old)| (next / old).ln().abs()).fold(0.0, f64::max);
        strength = next;
        if change < 1e-12 {
            break;
        }
    }
    strength.into_iter().map(|own| own / (own + 1.0)).collect()
}

fn centred(values: &[f64]) -> Vec<f64> {
    let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
    values.iter().map(|value| value - mean).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    type Table = (&'static [f64], &'static [f64], f64, f64, f64);

    /// Rates in simulation and in reality of the tables of SimplerEnv with MMRV, MMRV of swapped arguments and Pearson
    /// correlation, computed by its own metrics.
    const GOLD: [Table; 7] = [
        (
            &[0.787, 0.857, 0.710, 0.567, 0.027, 0.170],
            &[0.907, 0.853, 0.920, 0.760, 0.133, 0.293],
            0.031333333333,
            0.061833333333,
            0.975433962123,
        ),
        (
            &[0.779, 0.442, 0.354, 0.317, 0.050, 0.042],
            &[0.733, 0.633, 0.583, 0.450, 0.017, 0.350],
            0.111,
            0.002666666667,
            0.856096664312,
        ),
        (
            &[0.157, 0.601, 0.463, 0.296, 0.0, 0.009],
            &[0.333, 0.815, 0.704, 0.519, 0.0, 0.148],
            0.0,
            0.0,
            0.983166491732,
        ),
        (
            &[0.343, 0.861, 0.667, 0.891, 0.278, 0.444],
            &[0.630, 0.926, 0.889, 0.741, 0.0, 0.519],
            0.123333333333,
            0.113333333333,
            0.771232818159,
        ),
        (
            &[0.037, 0.065, 0.130, 0.213, 0.0, 0.0],
            &[0.074, 0.185, 0.185, 0.407, 0.0, 0.0],
            0.0,
            0.010833333333,
            0.969171806143,
        ),
        (&[0.042, 0.083, 0.097], &[0.0, 0.250, 0.083], 0.111333333333, 0.009333333333, 0.571367598455),
        (&[0.0, 0.0, 0.042], &[0.0, 0.0, 0.125], 0.0, 0.0, 0.999997142865),
    ];

    #[test]
    fn published_tables_give_the_published_figures() {
        let close = |got: f64, wanted: f64| (got - wanted).abs() < 1e-9;
        for (sim, real, violation, swapped, correlation) in GOLD {
            assert!(close(mmrv(sim, real), violation), "{sim:?}: {}", mmrv(sim, real));
            assert!(close(mmrv(real, sim), swapped), "{sim:?}: {}", mmrv(real, sim));
            assert!(close(pearson(sim, real), correlation), "{sim:?}: {}", pearson(sim, real));
        }
    }

    #[test]
    fn ties_and_constant_lists_are_treated_as_defined() {
        assert!((mmrv(&[0.5; 3], &[0.9, 0.5, 0.1]) - 0.4).abs() < 1e-15);
        assert_eq!((mmrv(&[], &[]), mmrv(&[0.9, 0.1], &[0.5, 0.5])), (0.0, 0.0));
        assert_eq!((pearson(&[0.5; 3], &[0.9, 0.5, 0.1]), pearson(&[0.2, 0.2], &[0.7, 0.7])), (0.0, 1.0));
        assert_eq!((spearman(&[0.5; 3], &[0.9, 0.5, 0.1]), kendall(&[0.5; 3], &[0.9, 0.5, 0.1])), (None, None));
        let violations = rank_violations(&[0.5, 0.5, 0.7], &[0.9, 0.1, 0.4]);
        let pairs: Vec<_> = violations.iter().map(|it| (it.better, it.worse, it.sim_gap)).collect();
        assert_eq!(pairs, [(0, 1, 0.0), (0, 2, 0.5 - 0.7)]);
    }

    #[test]
    fn rank_correlations_handle_ties_as_the_textbooks_do() {
        let (sim, real) = ([1.0, 2.0, 2.0, 4.0, 5.0], [1.0, 3.0, 2.0, 5.0, 4.0]);
        // Centred ranks (−2, −½, −½, 1, 2) and (−2, 0, −1, 2, 1).
        assert!((spearman(&sim, &real).unwrap() - 8.5 / 95.0_f64.sqrt()).abs() < 1e-12);
        // 8 concordant, 1 discordant, 1 tied pair.
        assert!((kendall(&sim, &real).unwrap() - 7.0 / 90.0_f64.sqrt()).abs() < 1e-12);
        assert_eq!(spearman(&[0.1, 0.2, 0.3], &[0.3, 0.2, 0.1]), Some(-1.0));
    }

    #[test]
    fn strengths_explain_the_comparisons() {
        let duel = |first, second, first_wins, second_wins| Duel { first, second, first_wins, second_wins };
        let duels = [duel(0, 1, 30.0, 10.0), duel(1, 2, 30.0, 10.0), duel(0, 2, 36.0, 4.0), duel(3, 2, 0.0, 5.0)];
        let chances = bradley_terry(4, &duels);
        assert!(chances[0] > chances[1] && chances[1] > chances[2] && chances[2] > chances[3], "{chances:?}");
        assert!(chances[3] > 0.0);
        // At the maximum, each policy wins as often as its strength predicts.
        let strength: Vec<f64> = chances.iter().map(|chance| chance / (1.0 - chance)).collect();
        for own in 0..4 {
            let mut excess = 0.5 - chances[own];
            for duel in duels.iter().filter(|duel| duel.first == own || duel.second == own) {
                let (other, wins) =
                    if duel.first == own { (duel.second, duel.first_wins) } else { (duel.first, duel.second_wins) };
                excess +=
                    wins - (duel.first_wins + duel.second_wins) * strength[own] / (strength[own] + strength[other]);
            }
            assert!(excess.abs() < 1e-6, "{own}: {excess}");
        }
    }
}
