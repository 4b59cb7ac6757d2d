//! Rejection reasons of layout attempts, with data and counts.

use std::collections::BTreeMap;
use std::fmt;

use genmanip_core::{Atom, InstanceId};
use genmanip_relations::PosedObject;

/// Maximum number of different reasons in a message.
const MAX_LISTED: usize = 4;

/// Reason for rejecting a layout attempt.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Rejection {
    /// The relations contradict each other or the table's extent.
    RelationsInfeasible,
    /// An object to be moved would be too close to or too far from the robot.
    OutOfReach,
    /// A lowered object misses its carrier.
    BesideItsCarrier,
    /// Two objects would be closer than the minimum gap.
    TooClose,
    /// An edge of the graph would not hold with the required margin.
    EdgeUnsatisfied,
    /// No candidate pose of an object was valid.
    NoPlace(NamedObject),
    /// The references of a `between` goal leave no space for the object.
    NoSpaceBetween(NamedObject),
    /// The target region of an object is occupied.
    NoSpaceAtGoal(NamedObject),
    /// The goal already holds.
    GoalHolds,
    /// The simulation became unstable; the text is its error message.
    Physics(String),
    /// Objects do not come to rest within the time limit.
    NoRest,
    /// An object moves too far while settling.
    Slides(NamedObject),
    /// An object tilts too far while settling.
    FallsOver(NamedObject),
    /// Objects penetrate each other after settling.
    Penetration,
    /// An edge of the graph no longer holds after settling.
    EdgeLost,
    /// A state of the graph no longer holds after settling.
    StateLost(Atom),
    /// A settled object starts to move.
    Drifts(NamedObject),
    /// The arm cannot bring an object into a goal state.
    UnreachableState {
        /// Object whose state the goal changes.
        object: NamedObject,
        /// Goal state that the arm cannot set.
        state: String,
    },
    /// The robot's home configuration touches an object.
    AtHome(NamedObject),
    /// No grasp of an object is reachable.
    NoGrasp(NamedObject),
    /// Grasp sampling fails on the object's geometry; the text is its error message.
    NoGraspGeometry {
        /// Object without grasps.
        object: NamedObject,
        /// Error message of the grasp sampler.
        reason: String,
    },
    /// No prompt camera sees enough of an object.
    Unseen(NamedObject),
}

/// Id and name of an object in a rejection.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct NamedObject {
    /// Id of the object in the scene.
    pub id: InstanceId,
    /// Display name, e.g. `Red Mug`.
    pub name: String,
}

/// Number of rejections by reason, and of conflicts by edge.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Rejections {
    reasons: BTreeMap<Rejection, usize>,
    edges: BTreeMap<Atom, usize>,
}

impl Rejections {
    /// Adds a rejection to the number of its reason.
    pub fn count(&mut self, reason: Rejection) {
        *self.reasons.entry(reason).or_default() += 1;
    }

    /// Counts an edge as conflicting.
    pub fn blame(&mut self, edge: &Atom) {
        *self.edges.entry(edge.clone()).or_default() += 1;
    }

    /// Reasons with counts, most frequent first, ties in alphabetical order.
    pub fn reasons(&self) -> Vec<(&Rejection, usize)> {
        ranked(&self.reasons)
    }

    /// Number of `Unseen` rejections of the object with most of them.
    pub(crate) fn most_unseen(&self) -> usize {
        let unseen = self.reasons.iter().filter(|(reason, _)| matches!(reason, Rejection::Unseen(_)));
        unseen.map(|(_, &count)| count).max().unwrap_or(0)
    }

    /// Edges that caused rejections, most frequent first.
    pub fn conflicting_edges(&self) -> Vec<(&Atom, usize)> {
        let mut edges: Vec<_> = self.edges.iter().map(|(edge, &count)| (edge, count)).collect();
        edges.sort_by_key(|&(_, count)| std::cmp::Reverse(count));
        edges
    }
}

impl NamedObject {
    /// Id and name of an object in a scene.
    pub fn of(object: &PosedObject) -> Self {
        Self { id: object.id.clone(), name: object.model.card.name.clone() }
    }
}

impl fmt::Display for NamedObject {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.name)
    }
}

impl fmt::Display for Rejection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::RelationsInfeasible => f.write_str("the relations leave no feasible region"),
            Self::OutOfReach => f.write_str("out of reach"),
            Self::BesideItsCarrier => f.write_str("not above its carrier"),
            Self::TooClose => f.write_str("too close to a neighbour"),
            Self::EdgeUnsatisfied => f.write_str("an edge cannot be satisfied"),
            Self::NoPlace(object) => write!(f, "no free pose for {object}"),
            Self::NoSpaceBetween(object) => write!(f, "no space for {object} between its two goal references"),
            Self::NoSpaceAtGoal(object) => write!(f, "no space for {object} at its goal"),
            Self::GoalHolds => f.write_str("the goal already holds"),
            Self::Physics(error) => write!(f, "the simulation rejects the layout: {error}"),
            Self::NoRest => f.write_str("objects do not come to rest"),
            Self::Slides(object) => write!(f, "{object} slides or rolls while settling"),
            Self::FallsOver(object) => write!(f, "{object} falls over while settling"),
            Self::Penetration => f.write_str("objects penetrate each other"),
            Self::EdgeLost => f.write_str("an edge does not hold after settling"),
            Self::StateLost(atom) => write!(f, "not true after settling: {atom}"),
            Self::Drifts(object) => write!(f, "{object} does not stay at rest"),
            Self::UnreachableState { object, state } => {
                write!(f, "the arm cannot bring {object} into state {state}")
            }
            Self::AtHome(object) => write!(f, "{object} touches the robot at its home"),
            Self::NoGrasp(object) => write!(f, "{object} cannot be grasped at its pose"),
            Self::NoGraspGeometry { object, reason } => write!(f, "{object} cannot be grasped: {reason}"),
            Self::Unseen(object) => write!(f, "{object} is not visible to any prompt camera"),
        }
    }
}

impl fmt::Display for Rejections {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", list(&self.reasons()))?;
        if !self.edges.is_empty() {
            write!(f, "; conflicting edges: {}", list(&self.conflicting_edges()))?;
        }
        Ok(())
    }
}

fn list<T: fmt::Display>(entries: &[(T, usize)]) -> String {
    entries.iter().take(MAX_LISTED).map(|(name, count)| format!("{name} ({count}×)")).collect::<Vec<_>>().join(", ")
}

fn ranked(counts: &BTreeMap<Rejection, usize>) -> Vec<(&Rejection, usize)> {
    let mut entries: Vec<_> = counts.iter().map(|(reason, &count)| (reason, count)).collect();
    entries.sort_by_cached_key(|&(reason, count)| (std::cmp::Reverse(count), reason.to_string()));
    entries
}

#[cfg(test)]
mod tests {
    use super::*;

    fn named(name: &str) -> NamedObject {
        NamedObject { id: "001#2".parse().unwrap(), name: name.into() }
    }

    #[test]
    fn reasons_are_counted_by_their_data_and_ranked_by_count_and_words() {
        let mut rejections = Rejections::default();
        let mug = Rejection::NoPlace(named("Red Mug"));
        for reason in [
            Rejection::TooClose,
            Rejection::OutOfReach,
            mug.clone(),
            Rejection::NoPlace(named("Blue Cube")),
            mug.clone(),
            Rejection::GoalHolds,
        ] {
            rejections.count(reason);
        }
        assert_eq!(rejections.reasons()[0], (&mug, 2));
        let words = "no free pose for Red Mug (2×), no free pose for Blue Cube (1×), out of reach (1×), the goal already \
                     holds (1×)";
        assert_eq!(rejections.to_string(), words);
    }
}
