//! Tasks as task-oriented scene graphs (ToSG): an instruction, a goal and an initial scene.

use std::collections::BTreeMap;
use std::sync::Arc;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::upgrade;
use crate::{
    AssetRef, AssetUid, Document, InstanceId, ObjectCard, ReferenceId, Relation, SurfaceId, Upgrade, named_enum,
};

/// A task: instruction, goal and initial scene described by relations. Valid by construction: only the validator in
/// `tasks` makes one from a language model's answer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Task {
    /// Id, unique in its collection and usable as a file name.
    pub id: String,
    /// Category of the task.
    pub kind: TaskKind,
    /// Instruction given to the robot, at most 30 words.
    pub instruction: String,
    /// Success condition.
    pub goal: Goal,
    /// Initial objects, states and relations.
    pub scene_graph: SceneGraph,
    /// Cards of the instances, one per node of the graph and in its order; see [`SharedCards`].
    pub objects: Vec<Arc<ObjectCard>>,
    /// Support surfaces of the world to which goal or graph refer; the table only if the goal names it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub surfaces: Vec<NamedSurface>,
    /// Groups of interchangeable instances of one asset: the goal holds if it holds for any permutation.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub interchangeable: Vec<Vec<InstanceId>>,
    /// Origin of the task, e.g. `recorded answer 001_long_horizon.json` or `rules`.
    pub source: String,
}

impl Document for Task {
    const SCHEMA: &'static str = "genmanip.task/2";
    const PREVIOUS: Option<Upgrade> = Some(upgrade::task::FROM_1);
}

/// Deduplicates object cards across tasks; cards are most of a task's memory.
///
/// ```
/// # use std::sync::Arc;
/// # use genmanip_core::{SharedCards, Task};
/// # fn both(mut one: Task, mut other: Task) {
/// let mut cards = SharedCards::default();
/// cards.share(&mut one);
/// cards.share(&mut other);
/// if one.objects[0] == other.objects[0] {
///     assert!(Arc::ptr_eq(&one.objects[0], &other.objects[0]));
/// }
/// # }
/// ```
#[derive(Debug, Default)]
pub struct SharedCards {
    by_uid: BTreeMap<AssetUid, Shared>,
}

/// Card and asset of an object, shared by tasks that contain it.
#[derive(Debug)]
struct Shared {
    card: Arc<ObjectCard>,
    asset: Arc<AssetRef>,
}

impl SharedCards {
    /// Replaces a task's cards by known equal ones, remembers the others, and shrinks its lists to fit. The task's
    /// value does not change.
    pub fn share(&mut self, task: &mut Task) {
        for (card, node) in task.objects.iter_mut().zip(&mut task.scene_graph.nodes) {
            let known = self.by_uid.entry(card.uid.clone());
            let known = known.or_insert_with(|| Shared { card: Arc::clone(card), asset: Arc::clone(&node.asset) });
            // A few tasks use another version of the asset.
            if known.card == *card {
                *card = Arc::clone(&known.card);
            }
            if known.asset == node.asset {
                node.asset = Arc::clone(&known.asset);
            }
        }
        task.objects.shrink_to_fit();
        task.scene_graph.nodes.shrink_to_fit();
        task.scene_graph.edges.shrink_to_fit();
        task.goal.alternatives.shrink_to_fit();
        task.goal.alternatives.iter_mut().for_each(Vec::shrink_to_fit);
    }
}

named_enum! {
    /// Category of a task by its goal and the way it refers to objects.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
    #[serde(rename_all = "snake_case")]
    pub enum TaskKind {
        /// Everyday pick and place with named objects.
        PickAndPlace = "pick_and_place",
        /// Destinations are given relative to other objects.
        Spatial = "spatial",
        /// Objects are referred to by their appearance.
        Appearance = "appearance",
        /// Objects or destinations follow from an everyday need.
        CommonSense = "common_sense",
        /// Two to four pick-and-place or state-changing steps.
        LongHorizon = "long_horizon",
        /// The state of an articulated object changes.
        Articulated = "articulated",
    }
}

/// A support surface as named in a task: fixed furniture that is not an object of the scene, see
/// [`crate::SupportSurface`].
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NamedSurface {
    /// Id in the world, e.g. `side_table`.
    pub id: SurfaceId,
    /// Display name, e.g. `side table`.
    pub name: String,
}

/// Disjunction of conjunctions: holds if every atom of one alternative holds.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(transparent)]
pub struct Goal {
    /// Conjunctions, of which one must hold.
    pub alternatives: Vec<Vec<Atom>>,
}

/// A condition on the final scene that is true or false.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "test", rename_all = "snake_case")]
#[serde(bound(deserialize = "Subject: Deserialize<'de>, Reference: Deserialize<'de>"))]
#[schemars(rename = "Atom")]
// Templates of tasks name other subjects and references than a task does.
pub enum Atom<Subject = InstanceId, Reference = ReferenceId> {
    /// `subject` stands in `relation` to `reference`.
    Relation {
        /// Id of the placed instance.
        subject: Subject,
        /// Relation of the subject to the reference.
        relation: Relation,
        /// Id of the reference instance or support surface.
        reference: Reference,
        /// Second reference of `between`; `None` for all other relations.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        second_reference: Option<Reference>,
    },
    /// The object is in a named state.
    State {
        /// Id of the articulated instance.
        object: Subject,
        /// Name of the state.
        state: String,
    },
}

/// The initial scene: objects, their states and relations.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SceneGraph {
    /// Description of the scene in words.
    pub description: String,
    /// Objects of the scene with their initial states.
    pub nodes: Vec<GraphNode>,
    /// Relations that hold initially; objects without a supporting edge stand on the table.
    pub edges: Vec<GraphEdge>,
}

/// An instance in the scene.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct GraphNode {
    /// Instance id: the asset's uid, or `001#2` for its second copy.
    pub id: InstanceId,
    /// Asset of which the node is an instance.
    pub asset: Arc<AssetRef>,
    /// Initial state of an articulated object; `None` if none is given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub state: Option<String>,
}

/// A spatial relation that holds in the initial scene.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
pub struct GraphEdge {
    /// Id of the instance that stands in the relation.
    pub subject: InstanceId,
    /// Relation of the subject to the reference.
    pub relation: Relation,
    /// Id of the reference instance or support surface.
    pub reference: ReferenceId,
    /// Second reference of `between`; `None` for all other relations.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub second_reference: Option<ReferenceId>,
}

impl GraphEdge {
    /// The edge as a condition.
    pub fn atom(&self) -> Atom {
        Atom::Relation {
            subject: self.subject.clone(),
            relation: self.relation,
            reference: self.reference.clone(),
            second_reference: self.second_reference.clone(),
        }
    }
}

impl SceneGraph {
    /// Index of an instance's node by id; `None` if there is none.
    pub fn index_of(&self, id: &ReferenceId) -> Option<usize> {
        self.nodes.iter().position(|node| node.id == *id)
    }
}

impl GraphNode {
    /// Node for the first instance of a card's object, without a state.
    pub fn of(card: &ObjectCard) -> Self {
        Self { id: InstanceId::new(&card.uid, 1), asset: Arc::new(card.asset.clone()), state: None }
    }
}

impl Task {
    /// Card of an instance in the scene; `None` for an unknown id.
    pub fn card(&self, id: &ReferenceId) -> Option<&ObjectCard> {
        self.objects.get(self.scene_graph.index_of(id)?).map(Arc::as_ref)
    }

    /// A support surface by id; `None` if the task does not refer to it.
    pub fn surface(&self, id: &ReferenceId) -> Option<&NamedSurface> {
        self.surfaces.iter().find(|surface| surface.id == *id)
    }

    /// Display name of an instance: `Red Mug`, or `Red Mug #2` for its second copy; a surface's name; the id if there
    /// is no card.
    pub fn name_of(&self, id: &ReferenceId) -> String {
        if let Some(surface) = self.surface(id) {
            return surface.name.clone();
        }
        let (uid, copy) = id.parts();
        let name = self.card(id).map_or(uid, |card| &card.name);
        copy.map_or_else(|| name.to_owned(), |copy| format!("{name} #{copy}"))
    }
}

impl Atom {
    /// Ids of all instances and surfaces in the condition, the subject first.
    pub fn ids(&self) -> impl Iterator<Item = &ReferenceId> {
        std::iter::once(&**self.subject()).chain(self.references())
    }
}

impl<Subject, Reference> Atom<Subject, Reference> {
    /// Id of the instance whose place or state is tested.
    pub fn subject(&self) -> &Subject {
        match self {
            Self::Relation { subject, .. } => subject,
            Self::State { object, .. } => object,
        }
    }

    /// Ids of the references of a relation, none for a state.
    pub fn references(&self) -> impl Iterator<Item = &Reference> {
        let (reference, second) = match self {
            Self::Relation { reference, second_reference, .. } => (Some(reference), second_reference.as_ref()),
            Self::State { .. } => (None, None),
        };
        reference.into_iter().chain(second)
    }
}

impl std::fmt::Display for Atom {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Relation { subject, relation, reference, second_reference: None } => {
                write!(f, "{subject} {} {reference}", relation.name())
            }
            Self::Relation { subject, relation, reference, second_reference: Some(second) } => {
                write!(f, "{subject} {} {reference} and {second}", relation.name())
            }
            Self::State { object, state } => write!(f, "{object} is {state}"),
        }
    }
}
