//! Why attempts at a layout are rejected: reasons with their data, counted; text only where people read it.

use std::collections::BTreeMap;
use std::fmt;

use genmanip_core::Atom;
use genmanip_relations::PosedObject;

/// Reasons listed in a message; more do not help whoever reads it.
const LISTED: usize = 4;

/// Why an attempt at a layout was rejected.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Rejection {
    /// The relations alone contradict each other or the table's edges.
    RelationsLeaveNoRoom,
    /// An object that is to be moved would lie too near to the robot or too far from it.
    OutOfReach,
    /// An object that is let down misses what is to carry it.
    BesideItsCarrier,
    /// Two objects would be closer than the smallest gap.
    TooClose,
    /// An edge of the graph would not hold by the margin of the settings.
    EdgeUnsatisfied,
    /// An object found no place in any of its tries.
    NoPlace(NamedObject),
    /// The goal wants an object between two others that leave no room for it.
    NoRoomBetween(NamedObject),
    /// The goal wants an object where nothing is free.
    NoRoomAtGoal(NamedObject),
    /// The goal holds before anything is done.
    GoalHolds,
    /// The simulator cannot compile or step the scene, in its own words.
    Physics(String),
    /// Objects do not come to rest in the settling time.
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
    /// An object moves when it is left alone.
    Drifts(NamedObject),
    /// The arm cannot bring an object into a state of the goal.
    NoWayToState {
        /// The object.
        object: NamedObject,
        /// The state.
        state: String,
    },
    /// No grasp of an object is in reach where it lies.
    NoGrasp(NamedObject),
    /// The geometry of an object allows no grasp at all, in the words of the grasp generator.
    NoGraspGeometry {
        /// The object.
        object: NamedObject,
        /// What is wrong with it.
        reason: String,
    },
    /// No camera that prompts are made with sees enough of an object.
    Unseen(NamedObject),
}

/// An object as a rejection names it.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct NamedObject {
    /// What the scene calls it.
    pub id: String,
    /// What people call it.
    pub name: String,
}

/// Counted rejections, the edges that conflict named.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Rejections {
    reasons: BTreeMap<Rejection, usize>,
    edges: BTreeMap<Atom, usize>,
}

impl Rejections {
    /// Counts a rejection.
    pub fn count(&mut self, reason: Rejection) {
        *self.reasons.entry(reason).or_default() += 1;
    }

    /// Names an edge as one that stood in the way.
    pub fn blame(&mut self, edge: &Atom) {
        *self.edges.entry(edge.clone()).or_default() += 1;
    }

    /// Reasons with their counts, most frequent first, equals in the order of their words.
    pub fn reasons(&self) -> Vec<(&Rejection, usize)> {
        ranked(&self.reasons)
    }

    /// How often an object was not seen; of several the one that was so most often.
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
    /// The name of an object of a scene.
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
            Self::RelationsLeaveNoRoom => f.write_str("the relations leave no room"),
            Self::OutOfReach => f.write_str("out of reach"),
            Self::BesideItsCarrier => f.write_str("not above its carrier"),
            Self::TooClose => f.write_str("too close to a neighbour"),
            Self::EdgeUnsatisfied => f.write_str("an edge cannot be satisfied"),
            Self::NoPlace(object) => write!(f, "no free place for {object}"),
            Self::NoRoomBetween(object) => write!(f, "no room for {object} between what the goal wants it between"),
            Self::NoRoomAtGoal(object) => write!(f, "no room for {object} where the goal wants it"),
            Self::GoalHolds => f.write_str("the goal holds already"),
            Self::Physics(error) => write!(f, "physics refuses the layout: {error}"),
            Self::NoRest => f.write_str("objects do not come to rest"),
            Self::Slides(object) => write!(f, "{object} slides or rolls while settling"),
            Self::FallsOver(object) => write!(f, "{object} falls over while settling"),
            Self::Penetration => f.write_str("objects penetrate each other"),
            Self::EdgeLost => f.write_str("an edge does not hold after settling"),
            Self::StateLost(atom) => write!(f, "not so after settling: {atom}"),
            Self::Drifts(object) => write!(f, "{object} does not stay where it lies"),
            Self::NoWayToState { object, state } => {
                write!(f, "no way for the arm to bring {object} into the state {state}")
            }
            Self::NoGrasp(object) => write!(f, "{object} cannot be grasped where it lies"),
            Self::NoGraspGeometry { object, reason } => write!(f, "{object} cannot be grasped: {reason}"),
            Self::Unseen(object) => write!(f, "{object} is not seen by any prompt camera"),
        }
    }
}

impl fmt::Display for Rejections {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", list(&self.reasons()))?;
        if !self.edges.is_empty() {
            write!(f, "; edges in conflict: {}", list(&self.conflicting_edges()))?;
        }
        Ok(())
    }
}

fn list<T: fmt::Display>(entries: &[(T, usize)]) -> String {
    entries.iter().take(LISTED).map(|(name, count)| format!("{name} ({count}×)")).collect::<Vec<_>>().join(", ")
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
        NamedObject { id: "001#2".into(), name: name.into() }
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
        let words = "no free place for Red Mug (2×), no free place for Blue Cube (1×), out of reach (1×), the goal holds \
                     already (1×)";
        assert_eq!(rejections.to_string(), words);
    }
}
