//! Contradictions between relations.
//!
//! Left, front and support are strict orders, so cycles are contradictory; contradictory statements about a pair are
//! cycles of length two. The kinds of relations of a pair exclude each other: left/right requires overlap along x only,
//! front/back along y only, and a supported object is neither beside nor near its support.

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet, VecDeque};

use genmanip_core::{HorizontalAxis, Relation, RelationKind, Side};

/// A relation between two different objects.
#[derive(Clone, Copy)]
pub(super) struct Link {
    pub subject: usize,
    pub relation: Relation,
    pub reference: usize,
}

/// Kinds of relations: the strict orders, with `right` and `back` inverted to `left` and `front`, and `near`.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Order {
    Left,
    Front,
    Support,
    Near,
}

impl Order {
    fn word(self) -> &'static str {
        match self {
            Self::Left => "left",
            Self::Front => "front",
            Self::Support => "top",
            Self::Near => "near",
        }
    }
}

/// Descriptions of all contradictions; empty if the relations are consistent.
pub(super) fn contradictions(links: &[Link], name: impl Fn(usize) -> String) -> Vec<String> {
    let mut found = mixed_pairs(links, &name);
    for order in [Order::Left, Order::Front, Order::Support] {
        found.extend(cycles(links, order).into_iter().map(|cycle| {
            let chain: Vec<String> = cycle.iter().chain(cycle.first()).map(|&object| name(object)).collect();
            format!("a cycle of `{}`: {}", order.word(), chain.join(&format!(" {} ", order.word())))
        }));
    }
    found
}

/// Kind of a link with its smaller and its larger object in that order (for `near`: subject and reference); `None` for
/// `between`.
fn ordered(link: &Link) -> Option<(Order, usize, usize)> {
    let (subject, reference) = (link.subject, link.reference);
    Some(match link.relation.kind() {
        RelationKind::Side(Side { axis, is_positive }) => {
            let order = match axis {
                HorizontalAxis::Width => Order::Left,
                HorizontalAxis::Depth => Order::Front,
            };
            if is_positive { (order, subject, reference) } else { (order, reference, subject) }
        }
        RelationKind::Support(_) => (Order::Support, subject, reference),
        RelationKind::Around => (Order::Near, subject, reference),
        RelationKind::Between => return None,
    })
}

/// Descriptions of pairs with mutually exclusive relations.
fn mixed_pairs(links: &[Link], name: &impl Fn(usize) -> String) -> Vec<String> {
    let mut orders: BTreeMap<(usize, usize), BTreeSet<Order>> = BTreeMap::new();
    for (order, one, other) in links.iter().filter_map(ordered) {
        orders.entry((one.min(other), one.max(other))).or_default().insert(order);
    }
    let excluded = |orders: &BTreeSet<Order>| {
        let both = |one, other| orders.contains(&one) && orders.contains(&other);
        both(Order::Left, Order::Front) || (orders.contains(&Order::Support) && orders.len() > 1)
    };
    orders
        .iter()
        .filter(|(_, orders)| excluded(orders))
        .map(|((one, other), orders)| {
            let words: Vec<&str> = orders
                .iter()
                .map(|order| match order {
                    Order::Left => "left/right",
                    Order::Front => "front/back",
                    Order::Support => "top",
                    Order::Near => "near",
                })
                .collect();
            format!("{} and {} cannot be {} at once", name(*one), name(*other), words.join(" and "))
        })
        .collect()
}

/// One shortest cycle per strongly connected component of an order.
fn cycles(links: &[Link], order: Order) -> Vec<Vec<usize>> {
    let mut next: BTreeMap<usize, BTreeSet<usize>> = BTreeMap::new();
    for (_, one, other) in links.iter().filter_map(ordered).filter(|(kind, ..)| *kind == order) {
        next.entry(one).or_default().insert(other);
    }
    let mut explained: BTreeSet<usize> = BTreeSet::new();
    let mut found = Vec::new();
    for &start in next.keys() {
        if explained.contains(&start) {
            continue;
        }
        if let Some(cycle) = shortest_cycle(&next, start) {
            explained.extend(&cycle);
            found.push(cycle);
        }
    }
    found
}

fn shortest_cycle(next: &BTreeMap<usize, BTreeSet<usize>>, start: usize) -> Option<Vec<usize>> {
    let mut from: BTreeMap<usize, usize> = BTreeMap::new();
    let mut queue = VecDeque::from([start]);
    while let Some(object) = queue.pop_front() {
        for &other in next.get(&object).into_iter().flatten() {
            if other == start {
                let mut cycle = vec![object];
                while let Some(&earlier) = cycle.last().and_then(|last| from.get(last)) {
                    cycle.push(earlier);
                }
                cycle.reverse();
                return Some(cycle);
            }
            if let Entry::Vacant(entry) = from.entry(other) {
                entry.insert(object);
                queue.push_back(other);
            }
        }
    }
    None
}
