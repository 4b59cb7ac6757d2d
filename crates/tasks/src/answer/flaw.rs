//! Flaws of an answer.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Kinds of flaws; serialised in snake case.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FlawKind {
    /// The text is longer than [`super::MAX_ANSWER_BYTES`].
    TooLarge,
    /// The text contains no JSON object.
    NoJson,
    /// The text ends before the object is closed.
    TruncatedJson,
    /// The object is invalid JSON, and its meaning is ambiguous.
    MalformedJson,
    /// Comments, trailing commas, single quotes and the like.
    SloppyJson,
    /// A key occurs twice with different values.
    DuplicateKey,
    /// The text contains several different answers.
    SeveralAnswers,
    /// The answer sits inside another object, or parts of it one level too high.
    WrongNesting,
    /// A required key is missing, or an optional one is missing instead of `"none"`.
    MissingField,
    /// A key that the format does not have.
    UnknownField,
    /// A value of the wrong JSON type.
    WrongType,
    /// The goal is one condition or a flat list instead of a list of lists.
    FlatDnf,
    /// The instruction is empty.
    EmptyInstruction,
    /// The instruction has more than 30 words.
    InstructionTooLong,
    /// The goal, or an alternative of it, has no condition.
    EmptyGoal,
    /// The uid is not among the offered objects.
    UnknownUid,
    /// The uid is an offered one written differently (`7` or `O07` for `007`).
    UidSpelling,
    /// An object has a name but no uid.
    MissingUid,
    /// The name is exactly that of another offered object.
    UidNameMismatch,
    /// The position is not a word of the format.
    UnknownRelation,
    /// The position is a longer form of one of the format (`in front of`).
    RelationSpelling,
    /// The state is not in the object's list.
    UnknownState,
    /// The state is in the object's list, written differently (`Top Open`).
    StateSpelling,
    /// The goal tests the state of an object without initial state.
    MissingState,
    /// An edge with `none` as object.
    MissingEdgeObject,
    /// An edge that names the table.
    EdgeOnTable,
    /// An edge without a relation.
    MissingRelation,
    /// A relation of an object to itself.
    SelfRelation,
    /// Edges that cannot hold together.
    ContradictoryEdges,
    /// An object of an edge or of the goal has no node.
    MissingNode,
    /// An object has two nodes.
    DuplicateNode,
    /// A node without an edge.
    IsolatedObject,
    /// Fewer nodes than [`TaskRequest::min_objects`](super::TaskRequest::min_objects).
    TooFewObjects,
    /// A condition without relation and state, or without one of its objects.
    IncompleteCondition,
    /// A condition with both a relation and a state.
    MixedCondition,
    /// A condition against the table.
    GoalOnTable,
    /// Conditions of one conjunction that cannot hold together.
    ContradictoryGoal,
    /// A conjunction of the goal holds in the initial graph.
    GoalAlreadySatisfied,
    /// The initial graph implies a conjunction of the goal by an inverse relation (A left of B is B right of A).
    CircularGoal,
    /// The goal moves an object that the gripper cannot carry.
    NotGraspable,
    /// Something is put *in* an object without a cavity.
    NotAContainer,
    /// The goal does not match the requested kind of task.
    WrongKind,
    /// The instruction states another goal, or does not name an object of the goal.
    SentenceMismatch,
    /// An object is on or in two others at once.
    TwoSupports,
    /// The description of the scene is the placeholder of the prompt.
    Placeholder,
}

impl FlawKind {
    /// Name in files.
    pub fn name(self) -> String {
        serde_json::to_value(self).ok().and_then(|name| name.as_str().map(String::from)).unwrap_or_default()
    }
}

/// A flaw of an answer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Flaw {
    /// Kind of the flaw.
    pub kind: FlawKind,
    /// JSON path, e.g. `$.goal_conditions[0][1].obj1_uid`; for a flaw of the text, line and column.
    pub path: String,
    /// Expected and actual contents, as a sentence.
    pub message: String,
    /// Advice; empty if the message suffices.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub hint: String,
    /// True if the flaw was repaired unambiguously.
    pub repaired: bool,
}

/// A change made to an answer.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Repair {
    /// The repaired flaw.
    pub flaw: FlawKind,
    /// JSON path of the change.
    pub path: String,
    /// Description of the change.
    pub what: String,
}

/// Flaws and repairs found so far.
#[derive(Default)]
pub(super) struct Findings {
    pub flaws: Vec<Flaw>,
    pub repairs: Vec<Repair>,
    pub left_out: usize,
    rejecting: usize,
}

/// Maximum number of listed flaws; further ones are only counted.
const MAX_LISTED: usize = 64;

impl Findings {
    /// Records a flaw that cannot be repaired.
    pub fn reject(
        &mut self,
        kind: FlawKind,
        path: impl Into<String>,
        message: impl Into<String>,
        hint: impl Into<String>,
    ) {
        self.rejecting += 1;
        self.list(Flaw { kind, path: path.into(), message: message.into(), hint: hint.into(), repaired: false });
    }

    /// Records a flaw and its repair.
    pub fn repair(
        &mut self,
        kind: FlawKind,
        path: impl Into<String>,
        message: impl Into<String>,
        what: impl Into<String>,
    ) {
        let path = path.into();
        if self.flaws.len() < MAX_LISTED {
            self.repairs.push(Repair { flaw: kind, path: path.clone(), what: what.into() });
        }
        self.list(Flaw { kind, path, message: message.into(), hint: String::new(), repaired: true });
    }

    /// True if any flaw makes the answer unusable.
    pub fn rejects(&self) -> bool {
        self.rejecting > 0
    }

    fn list(&mut self, flaw: Flaw) {
        if self.flaws.len() < MAX_LISTED {
            self.flaws.push(flaw);
        } else {
            self.left_out += 1;
        }
    }
}
