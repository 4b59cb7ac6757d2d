//! Typed ids of the simulated bodies, independent of the engine's numbering.

/// A simulated body.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum BodyId {
    /// The table top.
    Table,
    /// Another support surface.
    Surface {
        /// Index in the world's surfaces, from 1.
        surface: usize,
    },
    /// The floor.
    Floor,
    /// A link of the robot.
    Robot {
        /// Index in the robot's links.
        link: usize,
    },
    /// A link of an object.
    Object {
        /// Index in the scene's objects.
        object: usize,
        /// Index in the object's links.
        link: usize,
    },
}
