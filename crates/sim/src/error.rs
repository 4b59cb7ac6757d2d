//! What can go wrong, with what was expected and what was met.

/// Why a scene cannot be compiled or stepped.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SimError {
    /// The settings contradict each other or the robot.
    #[error("simulation settings: {0}")]
    Settings(String),
    /// Two objects of a scene have the same name.
    #[error("two objects of the scene are both named `{0}`; names must be unique")]
    DuplicateName(String),
    /// A name that cannot stand in the engine's name table.
    #[error("object name `{0}` is empty or holds a control character")]
    BadName(String),
    /// A number that is not finite where the engine would only produce nonsense.
    #[error("{0} holds a number that is not finite")]
    NotFinite(String),
    /// Too few or too many joint positions for an articulated object.
    #[error("object `{object}` has {expected} joints, got {got} joint positions")]
    JointPositions {
        /// Name of the object.
        object: String,
        /// Joints of the model.
        expected: usize,
        /// Positions given.
        got: usize,
    },
    /// Another version of the physics engine is linked than this program was written for.
    #[error("expected {expected}, linked is {got}; run `cargo xtask setup` and build again")]
    EngineVersion {
        /// Version whose results are known.
        expected: String,
        /// Version found.
        got: String,
    },
    /// The engine refused the assembled model, e.g. for an impossible inertia; its words follow.
    #[error("the physics engine refused the scene: {0}")]
    Compile(String),
    /// A command of the wrong length.
    #[error("a command has {expected} numbers (arm joint targets, then gripper width), got {got}")]
    CommandLength {
        /// Arm joints + 1.
        expected: usize,
        /// Length given.
        got: usize,
    },
    /// A command with a number that is not finite.
    #[error("command number {index} is {value}, expected a finite number")]
    CommandNotFinite {
        /// Which number.
        index: usize,
        /// Its value.
        value: f32,
    },
    /// A saved state of another scene.
    #[error("a state of this scene has {expected} numbers, got {got}: it was saved from another scene")]
    StateLength {
        /// Length of a state of this scene.
        expected: usize,
        /// Length given.
        got: usize,
    },
    /// A scene without a robot was asked to control one.
    #[error("this scene was compiled without a robot and cannot take commands")]
    NoRobot,
    /// The integration diverged.
    #[error("the simulation became unstable at {time_s:.4} s: {what}")]
    Unstable {
        /// Simulated time.
        time_s: f64,
        /// Which quantity left its bounds.
        what: String,
    },
    /// The engine ran out of room for contacts and would silently drop some.
    #[error("the simulation ran out of room for contacts at {time_s:.4} s; raise `arena_mib` above {arena_mib}")]
    ContactsDropped {
        /// Simulated time.
        time_s: f64,
        /// Room in use.
        arena_mib: usize,
    },
}
