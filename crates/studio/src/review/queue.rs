//! Order of work of a reviewer, and what each may see.

use super::{Review, Standing, current, standing};

/// The scenario that a reviewer should see next, out of (id, hash of the content) in the order of the collection; `None`
/// if nothing is left.
///
/// Scenarios that others have reviewed once come first, so that pairs are completed; then those without reviews; then
/// those to adjudicate. Nobody gets a scenario that they have reviewed, and nobody adjudicates a difference of their own.
pub fn next_for<'a>(reviewer: &str, scenarios: &'a [(String, String)], reviews: &[Review]) -> Option<&'a str> {
    let rank = |(id, content): &(String, String)| {
        let current = current(reviews, id, content);
        if current.iter().any(|review| review.reviewer.name == reviewer) {
            return None;
        }
        match standing(&current, true) {
            Standing::Open { missing } => Some(missing),
            Standing::Adjudication => Some(usize::MAX),
            Standing::SentBack | Standing::Uncertified | Standing::Approved | Standing::Rejected => None,
        }
    };
    let ranked = scenarios.iter().filter_map(|scenario| Some((rank(scenario)?, scenario)));
    // `min_by_key` keeps the first of equals.
    ranked.min_by_key(|(rank, _)| *rank).map(|(_, (id, _))| id.as_str())
}

/// Current reviews of a scenario that a reviewer may see: all of them after their own, none before; when two differ,
/// whoever adjudicates sees both.
pub fn visible_to<'a>(reviewer: &str, current: &[&'a Review]) -> Vec<&'a Review> {
    let has_said = current.iter().any(|review| review.reviewer.name == reviewer);
    let is_open = matches!(standing(current, true), Standing::Open { .. });
    if has_said || !is_open { current.to_vec() } else { Vec::new() }
}
