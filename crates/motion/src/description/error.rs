//! Errors in robot descriptions.

use crate::collision::RobotError;

/// Error in a robot description.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum DescriptionError {
    /// Not well-formed XML; the message has the location.
    #[error("not well-formed XML: {0}")]
    NotXml(String),
    /// The root element is not `<robot>`.
    #[error("expected <robot> as the outermost element, found <{found}>")]
    NotARobot {
        /// The element.
        found: String,
    },
    /// A reference to a missing link.
    #[error("{by} refers to link {name}, which does not exist")]
    UnknownLink {
        /// The link.
        name: String,
        /// The referring element.
        by: String,
    },
    /// Two elements have the same name.
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
    /// Not one tree: no base, several, or a cycle.
    #[error("the links do not form a tree with one base: {0}")]
    NotATree(String),
    /// An attribute is missing or invalid.
    #[error("{place}: {attribute} should be {expected}, got {got:?}")]
    BadAttribute {
        /// Link or joint.
        place: String,
        /// Attribute or element.
        attribute: &'static str,
        /// Expected value.
        expected: &'static str,
        /// Actual value.
        got: String,
    },
    /// Too large.
    #[error("{what} has {size} {unit}, at most {limit} are allowed")]
    Huge {
        /// The oversized element.
        what: String,
        /// Its size.
        size: usize,
        /// The limit.
        limit: usize,
        /// Unit of both.
        unit: &'static str,
    },
    /// An implausible value.
    #[error("{place}: {what} should be {expected}, got {got}")]
    Implausible {
        /// Link or joint.
        place: String,
        /// The quantity.
        what: &'static str,
        /// Allowed range with unit.
        expected: String,
        /// Actual value.
        got: String,
        /// Likely cause.
        hint: &'static str,
    },
    /// A mesh is missing or invalid.
    #[error("mesh {name} of link {link}: {what}")]
    Mesh {
        /// Name in the file.
        name: String,
        /// Link.
        link: String,
        /// Description of the problem.
        what: String,
    },
    /// No joint moves.
    #[error("no joint moves")]
    NothingMoves,
    /// The robot cannot be compiled for collision checking.
    #[error(transparent)]
    Robot(#[from] RobotError),
}

impl DescriptionError {
    /// Advice for fixing the error.
    pub fn hint(&self) -> &'static str {
        match self {
            Self::Implausible { hint, .. } => hint,
            Self::NotXml(_) | Self::NotARobot { .. } => "expected URDF: <robot> with <link> and <joint> elements",
            Self::Huge { .. } => "remove links and pieces that planning does not need",
            Self::UnknownLink { .. } | Self::Twice { .. } => {
                "link and joint names must be unique and references must match them"
            }
            Self::TwoParents(_) | Self::NotATree(_) => "every link but the base must be the child of exactly one joint",
            Self::Mesh { .. } => "expected STL or OBJ in metres; a simplified hull in MESH.convex.stl is preferred",
            Self::BadAttribute { .. } => "see the URDF specification of the attribute",
            Self::NothingMoves => "expected at least one revolute, continuous or prismatic joint",
            Self::Robot(_) => "expected convex or nearly convex collision geometry (box, cylinder, sphere, STL, OBJ)",
        }
    }
}
