//! Interchangeable copies of an asset in a goal.

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};

use crate::{Atom, Goal, InstanceId, ReferenceId, Task};

/// Maximum number of instances in a group; their permutations are enumerated (24 for four).
pub const MAX_INTERCHANGEABLE: usize = 4;

/// Maximum number of goal alternatives after expanding the permutations; bounded because the goal is judged at every
/// control step.
pub const MAX_ALTERNATIVES: usize = 96;

/// Reason why groups of interchangeable instances are invalid.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum InterchangeError {
    /// A group of fewer than two or more than [`MAX_INTERCHANGEABLE`] instances.
    #[error("a group of {got} interchangeable instances, expected 2 to {MAX_INTERCHANGEABLE}")]
    Size {
        /// Number of instances in the group.
        got: usize,
    },
    /// An unknown id, or an id listed twice.
    #[error("interchangeable instance `{id}` is {what}")]
    Instance {
        /// The invalid id.
        id: InstanceId,
        /// Message, e.g. that the id is listed twice.
        what: &'static str,
    },
    /// Different assets in one group.
    #[error("`{first}` and `{second}` are made from different assets and cannot be exchanged")]
    Assets {
        /// First id of the group.
        first: InstanceId,
        /// Id with a different asset.
        second: InstanceId,
    },
    /// More than [`MAX_ALTERNATIVES`] alternatives after expansion.
    #[error("exchanging copies gives the goal {got} alternatives, expected at most {MAX_ALTERNATIVES}")]
    Alternatives {
        /// Number of alternatives after expansion.
        got: usize,
    },
}

impl Task {
    /// The goal with an alternative for every permutation of interchangeable copies.
    ///
    /// The alternatives as written come first, so that a verdict names the instances that satisfied the goal.
    pub fn judged_goal(&self) -> Cow<'_, Goal> {
        if self.interchangeable.is_empty() {
            return Cow::Borrowed(&self.goal);
        }
        let mut alternatives = self.goal.alternatives.clone();
        for written in &self.goal.alternatives {
            for exchange in exchanges(&self.interchangeable, written) {
                let exchanged: Vec<Atom> = written.iter().map(|atom| atom.renamed(&exchange)).collect();
                if !alternatives.contains(&exchanged) {
                    alternatives.push(exchanged);
                }
            }
        }
        Cow::Owned(Goal { alternatives })
    }

    /// Checks the groups of interchangeable instances.
    ///
    /// # Errors
    /// [`InterchangeError`] with the first violation.
    pub fn check_interchangeable(&self) -> Result<(), InterchangeError> {
        let mut seen = BTreeSet::new();
        for group in &self.interchangeable {
            if !(2..=MAX_INTERCHANGEABLE).contains(&group.len()) {
                return Err(InterchangeError::Size { got: group.len() });
            }
            for id in group {
                let refused = |what| Err(InterchangeError::Instance { id: id.clone(), what });
                if self.scene_graph.index_of(id).is_none() {
                    return refused("not a node of the scene");
                }
                if !seen.insert(id) {
                    return refused("listed twice");
                }
            }
            let asset =
                |id: &InstanceId| self.scene_graph.index_of(id).map(|index| &self.scene_graph.nodes[index].asset);
            if let Some(other) = group.iter().find(|id| asset(id) != asset(&group[0])) {
                return Err(InterchangeError::Assets { first: group[0].clone(), second: other.clone() });
            }
        }
        let exchanges: usize = self.goal.alternatives.iter().map(|atoms| count(&self.interchangeable, atoms)).sum();
        if exchanges > MAX_ALTERNATIVES {
            return Err(InterchangeError::Alternatives { got: exchanges });
        }
        Ok(())
    }
}

impl Atom {
    /// The condition with instances renamed; ids missing from the table are kept.
    #[must_use]
    pub fn renamed(&self, other: &BTreeMap<&ReferenceId, &InstanceId>) -> Self {
        let new = |id: &InstanceId| other.get(&**id).map_or_else(|| id.clone(), |id| (*id).clone());
        let known = |id: &ReferenceId| other.get(id).map_or_else(|| id.clone(), |id| (*id).clone().into());
        match self {
            Self::Relation { subject, relation, reference, second_reference } => Self::Relation {
                subject: new(subject),
                relation: *relation,
                reference: known(reference),
                second_reference: second_reference.as_ref().map(known),
            },
            Self::State { object, state } => Self::State { object: new(object), state: state.clone() },
        }
    }
}

/// For each group, its members that occur in the conditions, and the whole group.
fn concerned<'g>(groups: &'g [Vec<InstanceId>], atoms: &[Atom]) -> Vec<(Vec<&'g InstanceId>, &'g [InstanceId])> {
    let is_meant = |id: &&InstanceId| atoms.iter().flat_map(Atom::ids).any(|other| *other == **id);
    groups.iter().map(|group| (group.iter().filter(is_meant).collect(), group.as_slice())).collect()
}

/// Number of ways to replace the instances in the conditions by interchangeable copies.
fn count(groups: &[Vec<InstanceId>], atoms: &[Atom]) -> usize {
    let ways = |(meant, group): &(Vec<&InstanceId>, &[InstanceId])| {
        (0..meant.len()).map(|taken| group.len() - taken).product::<usize>()
    };
    concerned(groups, atoms).iter().map(ways).product()
}

/// All replacements of the instances in the conditions by interchangeable copies, the identity first.
fn exchanges<'g>(groups: &'g [Vec<InstanceId>], atoms: &[Atom]) -> Vec<BTreeMap<&'g ReferenceId, &'g InstanceId>> {
    let mut all = vec![BTreeMap::new()];
    for (meant, group) in concerned(groups, atoms) {
        for id in meant {
            // The copy itself comes first, so that the first replacement is the identity.
            let own = group.iter().filter(|other| *other == id);
            let others: Vec<&InstanceId> = own.chain(group.iter().filter(|other| *other != id)).collect();
            let with = |so_far: BTreeMap<&'g ReferenceId, &'g InstanceId>| {
                let free: Vec<&InstanceId> =
                    others.iter().copied().filter(|other| !so_far.values().any(|v| v == other)).collect();
                free.into_iter().map(move |other| {
                    let mut more = so_far.clone();
                    more.insert(id, other);
                    more
                })
            };
            all = all.into_iter().flat_map(with).collect();
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Document, Relation};

    fn on(subject: &str, reference: &str) -> Atom {
        Atom::Relation {
            subject: subject.parse().unwrap(),
            relation: Relation::On,
            reference: reference.into(),
            second_reference: None,
        }
    }

    fn task(ids: &[&str], goal: Vec<Vec<Atom>>, groups: &[&[&str]]) -> Task {
        let mut task = Task::from_json(include_str!("../testdata/task.json")).unwrap();
        let of = |id: &&str| {
            let id: InstanceId = id.parse().unwrap();
            let asset = crate::AssetRef::builtin(id.asset(), 2).into();
            crate::GraphNode { id, asset, state: None }
        };
        task.scene_graph.nodes = ids.iter().map(of).collect();
        task.goal.alternatives = goal;
        task.interchangeable =
            groups.iter().map(|group| group.iter().map(|id| id.parse().unwrap()).collect()).collect();
        task
    }

    /// The alternatives of the judged goal as text.
    fn judged(task: &Task) -> Vec<String> {
        let words = |atoms: &Vec<Atom>| atoms.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ");
        task.judged_goal().alternatives.iter().map(words).collect()
    }

    #[test]
    fn every_exchange_is_an_alternative() {
        let ids = ["1", "1#2", "1#3", "8", "8#2"];
        for (goal, groups, expected) in [
            (vec![vec![on("1", "8")]], &[][..], &["1 on 8"][..]),
            (vec![vec![on("1", "8")]], &[&["1", "1#2"][..]], &["1 on 8", "1#2 on 8"]),
            (vec![vec![on("1#2", "8")]], &[&["1", "1#2", "1#3"]], &["1#2 on 8", "1 on 8", "1#3 on 8"]),
            (vec![vec![on("1#3", "8")]], &[&["1", "1#2"]], &["1#3 on 8"]),
            (
                vec![vec![on("1", "8")]],
                &[&["1", "1#2"], &["8", "8#2"]],
                &["1 on 8", "1 on 8#2", "1#2 on 8", "1#2 on 8#2"],
            ),
            (
                vec![vec![on("1", "8"), on("1#2", "8#2")]],
                &[&["1", "1#2"]],
                &["1 on 8, 1#2 on 8#2", "1#2 on 8, 1 on 8#2"],
            ),
            // Duplicate alternatives are judged once.
            (vec![vec![on("1", "8")], vec![on("1#2", "8")]], &[&["1", "1#2"]], &["1 on 8", "1#2 on 8"]),
        ] {
            let task = task(&ids, goal, groups);
            assert_eq!(task.check_interchangeable(), Ok(()));
            assert_eq!(judged(&task), expected);
        }
    }

    #[test]
    fn invalid_groups_are_refused() {
        let ids = ["1", "1#2", "1#3", "1#4", "1#5", "8", "8#2", "8#3", "8#4"];
        for (groups, expected) in [
            (&[&["1"][..]][..], "a group of 1"),
            (&[&["1", "1#2", "1#3", "1#4", "1#5"]], "a group of 5"),
            (&[&["1", "7"]], "`7` is not a node"),
            (&[&["1", "1"]], "`1` is listed twice"),
            (&[&["1", "1#2"], &["1#2", "1#3"]], "`1#2` is listed twice"),
            (&[&["1", "8"]], "different assets"),
            (&[&["1", "1#2", "1#3", "1#4"], &["8", "8#2", "8#3", "8#4"]], "144 alternatives"),
        ] {
            let goal = vec![vec![on("1", "8"), on("1#2", "8#2")]];
            let message = task(&ids, goal, groups).check_interchangeable().unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
        }
    }
}
