//! What can be wrong with a description of a robot.

use crate::collision::RobotError;

/// Why a description is no robot that can be planned for.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum DescriptionError {
    /// Not well-formed XML; the message says where.
    #[error("not well-formed XML: {0}")]
    NotXml(String),
    /// XML of something else.
    #[error("expected <robot> as the outermost element, found <{found}>")]
    NotARobot {
        /// The element.
        found: String,
    },
    /// A link is named that is not there.
    #[error("{by} names link {name}, which does not exist")]
    UnknownLink {
        /// The link.
        name: String,
        /// Who names it.
        by: String,
    },
    /// Two elements of one name.
    #[error("there are two {kind}s named {name}")]
    Twice {
        /// `link` or `joint`.
        kind: &'static str,
        /// The name.
        name: String,
    },
    /// A link is the child of two joints.
    #[error("link {0} is the child of two joints")]
    TwoParents(String),
    /// Not one tree: no base, several, or a ring.
    #[error("the links are no tree with one base: {0}")]
    NotATree(String),
    /// An attribute is missing or makes no sense.
    #[error("{place}: {attribute} should be {expected}, got {got:?}")]
    BadAttribute {
        /// Link or joint.
        place: String,
        /// Attribute or element.
        attribute: &'static str,
        /// What was expected.
        expected: &'static str,
        /// What is there.
        got: String,
    },
    /// Too large to be meant.
    #[error("{what} has {size} {unit}; at most {limit} are read")]
    Huge {
        /// What is too large.
        what: String,
        /// Its size.
        size: usize,
        /// The bound.
        limit: usize,
        /// Unit of both.
        unit: &'static str,
    },
    /// A number that no robot has.
    #[error("{place}: {what} should be {expected}, got {got}")]
    Implausible {
        /// Link or joint.
        place: String,
        /// What is out of bounds.
        what: &'static str,
        /// The bounds, with their unit.
        expected: String,
        /// What is there.
        got: String,
        /// What most likely happened.
        hint: &'static str,
    },
    /// A mesh is missing or cannot be read as one.
    #[error("mesh {name} of link {link}: {what}")]
    Mesh {
        /// Name in the file.
        name: String,
        /// Link.
        link: String,
        /// What is wrong.
        what: String,
    },
    /// There is no moving joint, hence no arm and no tip.
    #[error("no joint moves: there is no arm and no tip")]
    NothingMoves,
    /// It reads well, but is no robot that can be tested for collision.
    #[error(transparent)]
    Robot(#[from] RobotError),
}

impl DescriptionError {
    /// What a person can do about it.
    pub fn hint(&self) -> &'static str {
        match self {
            Self::Implausible { hint, .. } => hint,
            Self::NotXml(_) | Self::NotARobot { .. } => "expected URDF: <robot> with <link> and <joint> elements",
            Self::Huge { .. } => "expected one robot; take links and pieces out that planning does not need",
            Self::UnknownLink { .. } | Self::Twice { .. } => "names of links and joints must match and differ",
            Self::TwoParents(_) | Self::NotATree(_) => "expected every link but the base to be the child of one joint",
            Self::Mesh { .. } => {
                "expected STL or OBJ in metres; a simpler hull beside it as MESH.convex.stl is preferred"
            }
            Self::BadAttribute { .. } => "the URDF specification says what each attribute holds",
            Self::NothingMoves => "expected at least one revolute, continuous or prismatic joint",
            Self::Robot(_) => "expected convex or nearly convex collision geometry (box, cylinder, sphere, STL, OBJ)",
        }
    }
}
