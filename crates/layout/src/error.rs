//! Why a layout cannot be made.

use std::collections::BTreeMap;
use std::fmt;

use genmanip_assets::AssetError;
use genmanip_core::{Atom, PlacedObject};
use genmanip_scene::relations::Window;

/// Why a task has no layout.
#[derive(Debug, thiserror::Error)]
pub enum LayoutError {
    /// An object is not in the catalogue or cannot be built.
    #[error(transparent)]
    UnknownObject(#[from] AssetError),
    /// The planner is for another robot than the world's.
    #[error("world field {field}: expected {expected}, the planner has {got}")]
    OtherRobot {
        /// Which field of the world differs.
        field: &'static str,
        /// What the world says.
        expected: String,
        /// What the planner's robot has.
        got: String,
    },
    /// The graph names an object that is not among its nodes.
    #[error("edge `{edge}` names {id}, which is no node of the scene graph")]
    NotANode {
        /// The edge in words.
        edge: String,
        /// The object.
        id: String,
    },
    /// Objects that stand on or lie in each other.
    #[error("{} stand on each other in a circle", ids.join(", "))]
    SupportCircle {
        /// The objects that could not be ordered.
        ids: Vec<String>,
    },
    /// Every attempt was rejected.
    #[error("no layout for task {task} in {restarts} attempts: {rejections}")]
    Infeasible {
        /// Id of the task.
        task: String,
        /// Number of whole layouts tried.
        restarts: usize,
        /// What stood in the way, by reason.
        rejections: Rejections,
        /// The attempt that got furthest.
        furthest: Option<Box<Unfinished>>,
    },
}

/// A layout in which some object found no place.
#[derive(Clone, Debug, PartialEq)]
pub struct Unfinished {
    /// What had its place; when no attempt got anywhere, all objects as they would stand without the edges in conflict.
    pub placed: Vec<PlacedObject>,
    /// Uid of the object that found none.
    pub object: String,
    /// Where each of its relations to placed objects alone would have had the middle of it.
    pub windows: Vec<(Atom, Window)>,
}

/// Counted reasons, the edges that conflict named.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Rejections {
    reasons: BTreeMap<String, usize>,
    edges: BTreeMap<Atom, usize>,
}

impl Rejections {
    /// Counts a rejection.
    pub fn count(&mut self, reason: impl Into<String>) {
        *self.reasons.entry(reason.into()).or_default() += 1;
    }

    /// Counts a rejection caused by one edge.
    pub fn count_edge(&mut self, reason: &str, edge: &Atom) {
        self.count(reason);
        self.blame(edge);
    }

    /// Names an edge as one that stood in the way.
    pub fn blame(&mut self, edge: &Atom) {
        *self.edges.entry(edge.clone()).or_default() += 1;
    }

    /// Reasons with their counts, most frequent first.
    pub fn reasons(&self) -> Vec<(&str, usize)> {
        ranked(&self.reasons).into_iter().map(|(reason, count)| (reason.as_str(), count)).collect()
    }

    /// Edges that caused rejections, most frequent first.
    pub fn conflicting_edges(&self) -> Vec<(&Atom, usize)> {
        ranked(&self.edges)
    }
}

impl fmt::Display for Rejections {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", list(self.reasons()))?;
        if !self.edges.is_empty() {
            write!(f, "; edges in conflict: {}", list(self.conflicting_edges()))?;
        }
        Ok(())
    }
}

fn list<T: fmt::Display>(entries: Vec<(T, usize)>) -> String {
    entries.iter().take(4).map(|(name, count)| format!("{name} ({count}×)")).collect::<Vec<_>>().join(", ")
}

/// Most frequent first, then in their order.
fn ranked<K: Ord>(counts: &BTreeMap<K, usize>) -> Vec<(&K, usize)> {
    let mut entries: Vec<_> = counts.iter().map(|(key, &count)| (key, count)).collect();
    entries.sort_by_key(|&(_, count)| std::cmp::Reverse(count));
    entries
}
