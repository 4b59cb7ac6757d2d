//! How the scene's bodies are named to others: by index, not by the engine's numbers.

/// A body of the scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum BodyId {
    /// The table's slab.
    Table,
    /// A further support surface.
    Surface {
        /// Index in the world's surfaces, from 1.
        surface: usize,
    },
    /// The ground beneath.
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
