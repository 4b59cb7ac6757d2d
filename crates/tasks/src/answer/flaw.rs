//! What can be wrong with an answer.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Kinds of flaws; the names in files are the snake-case ones.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FlawKind {
    /// The text is longer than [`super::MAX_ANSWER_BYTES`].
    TooLarge,
    /// There is no JSON object in the text.
    NoJson,
    /// The text ends before the object is closed.
    TruncatedJson,
    /// The object is no JSON, and what was meant is not certain.
    MalformedJson,
    /// Comments, trailing commas, single quotes and the like.
    SloppyJson,
    /// A key occurs twice with different values.
    DuplicateKey,
    /// The text holds several different answers.
    SeveralAnswers,
    /// The answer sits inside another object, or parts of it one level too high.
    WrongNesting,
    /// A required key is absent, or an optional one was left out instead of `"none"`.
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
    /// An object is named, but its uid is absent.
    MissingUid,
    /// The name is exactly that of another offered object.
    UidNameMismatch,
    /// The position is not a word of the format.
    UnknownRelation,
    /// The position is a wordier form of one of the format (`in front of`).
    RelationSpelling,
    /// The state is not in the object's list.
    UnknownState,
    /// The state is in the object's list, written differently (`Top Open`).
    StateSpelling,
    /// The goal tests the state of an object whose initial state is not given.
    MissingState,
    /// An edge with `none` as object.
    MissingEdgeObject,
    /// An edge that names the table.
    EdgeOnTable,
    /// An edge without a position.
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
    /// Fewer nodes than asked for.
    TooFewObjects,
    /// A condition that tests nothing, or lacks one of its objects.
    IncompleteCondition,
    /// A condition that tests a relation and a state.
    MixedCondition,
    /// A condition against the table.
    GoalOnTable,
    /// Conditions of one conjunction that cannot hold together.
    ContradictoryGoal,
    /// A conjunction of the goal holds in the initial graph.
    GoalAlreadySatisfied,
    /// The same, seen from the other object (A left of B is B right of A).
    CircularGoal,
    /// The goal moves an object that the hand cannot carry.
    NotGraspable,
    /// Something is put *in* an object that holds nothing.
    NotAContainer,
    /// The goal does not fit the kind of task asked for.
    WrongKind,
}

impl FlawKind {
    /// The name in files.
    pub fn name(self) -> String {
        serde_json::to_value(self).ok().and_then(|name| name.as_str().map(String::from)).unwrap_or_default()
    }
}

/// One thing that is wrong with an answer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Flaw {
    /// What kind of flaw.
    pub kind: FlawKind,
    /// JSON path of the place, e.g. `$.goal_conditions[0][1].obj1_uid`; for a flaw of the text, line and column.
    pub path: String,
    /// What was expected and what was found.
    pub message: String,
    /// What to do about it; empty when the message says it all.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub hint: String,
    /// Whether it could be mended with certainty.
    pub repaired: bool,
}

/// One change made to an answer.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Repair {
    /// The flaw that made it necessary.
    pub flaw: FlawKind,
    /// JSON path of the place.
    pub path: String,
    /// What was done.
    pub what: String,
}

/// The lists of a report while it is made.
#[derive(Default)]
pub(super) struct Findings {
    pub flaws: Vec<Flaw>,
    pub repairs: Vec<Repair>,
    pub left_out: usize,
    rejecting: usize,
}

/// Longest list of flaws; the rest is counted only.
const MAX_LISTED: usize = 64;

impl Findings {
    /// Notes a flaw that cannot be mended.
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

    /// Notes a flaw together with what was done about it.
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

    /// Whether anything makes the answer unusable.
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
