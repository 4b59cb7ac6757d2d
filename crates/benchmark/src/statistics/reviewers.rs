//! Agreement of two reviewers of the same items.

use std::collections::BTreeMap;

use serde::Serialize;

/// Agreement of two reviewers.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ReviewerAgreement {
    /// Number of items that both judged.
    pub items: usize,
    /// Share of items with equal judgements, 0 to 1.
    pub raw: f64,
    /// Cohen's κ; `None` if both gave the same single judgement to all items, where κ is undefined.
    pub kappa: Option<f64>,
    /// Gwet's AC1, which remains meaningful when nearly all items get the same judgement.
    pub ac1: f64,
}

/// Agreement of pairs of judgements (first, second reviewer) out of `categories` possible ones, at least two; `None`
/// without pairs.
///
/// κ after Cohen (1960), with the chance agreement of each reviewer's own shares; AC1 after Gwet (2008), with the mean
/// shares of both: Σ π (1 − π) / (q − 1) for q categories.
///
/// ```
/// # use genmanip_benchmark::statistics::reviewer_agreement;
/// let agreement = reviewer_agreement(&[(true, true), (true, true), (false, false), (true, false)], 2).unwrap();
/// assert_eq!(agreement.raw, 0.75);
/// assert_eq!(agreement.kappa, Some(0.5));
/// ```
pub fn reviewer_agreement<C: Ord>(pairs: &[(C, C)], categories: usize) -> Option<ReviewerAgreement> {
    if pairs.is_empty() {
        return None;
    }
    let items = pairs.len() as f64;
    let mut shares = BTreeMap::<&C, [f64; 2]>::new();
    for (first, second) in pairs {
        shares.entry(first).or_default()[0] += 1.0 / items;
        shares.entry(second).or_default()[1] += 1.0 / items;
    }
    let raw = pairs.iter().filter(|(first, second)| first == second).count() as f64 / items;
    let by_chance: f64 = shares.values().map(|[first, second]| first * second).sum();
    let is_constant = shares.len() == 1;
    let spread = |[first, second]: &[f64; 2]| {
        let mean = f64::midpoint(*first, *second);
        mean * (1.0 - mean)
    };
    let by_chance_of_ac1 = shares.values().map(spread).sum::<f64>() / (categories.max(2) - 1) as f64;
    Some(ReviewerAgreement {
        items: pairs.len(),
        raw,
        kappa: (!is_constant).then(|| (raw - by_chance) / (1.0 - by_chance)),
        ac1: (raw - by_chance_of_ac1) / (1.0 - by_chance_of_ac1),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pairs from a table of counts: both yes, first only, second only, both no.
    fn pairs([both, first, second, none]: [usize; 4]) -> Vec<(bool, bool)> {
        let of = |pair, count| std::iter::repeat_n(pair, count);
        of((true, true), both)
            .chain(of((true, false), first))
            .chain(of((false, true), second))
            .chain(of((false, false), none))
            .collect()
    }

    #[test]
    fn agreement_equals_published_and_closed_values() {
        // Counts, raw share, κ, AC1. The first is the paradox of Gwet (2008): nearly perfect agreement, κ below 0.
        let cases: [([usize; 4], f64, Option<f64>, f64); 5] = [
            ([118, 5, 2, 0], 0.944, Some(-0.023_391_8), 0.940_776_5),
            ([10, 0, 0, 10], 1.0, Some(1.0), 1.0),
            ([5, 5, 5, 5], 0.5, Some(0.0), 0.0),
            ([0, 4, 4, 0], 0.0, Some(-1.0), -1.0),
            ([7, 0, 0, 0], 1.0, None, 1.0),
        ];
        for (counts, raw, kappa, ac1) in cases {
            let got = reviewer_agreement(&pairs(counts), 2).unwrap();
            let near = |got: f64, expected: f64| (got - expected).abs() < 1e-6;
            assert!(near(got.raw, raw) && near(got.ac1, ac1), "{counts:?}: {got:?}");
            assert!(got.kappa.is_some() == kappa.is_some(), "{counts:?}: {got:?}");
            assert!(got.kappa.zip(kappa).is_none_or(|(got, expected)| near(got, expected)), "{counts:?}: {got:?}");
        }
        assert_eq!(reviewer_agreement::<bool>(&[], 2), None);
    }

    #[test]
    fn a_third_judgement_that_nobody_gives_lowers_chance_only_for_ac1() {
        let table = pairs([6, 2, 2, 6]);
        let (two, three) = (reviewer_agreement(&table, 2).unwrap(), reviewer_agreement(&table, 3).unwrap());
        assert_eq!(two.kappa, three.kappa);
        assert!(three.ac1 > two.ac1, "{two:?} {three:?}");
    }
}
