//! Errors of compiling and stepping a simulation.

/// Reason why a scene cannot be compiled or stepped.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SimError {
    /// Settings that contradict each other or the robot.
    #[error("simulation settings: {0}")]
    Settings(String),
    /// Two objects of a scene have the same name.
    #[error("two objects of the scene are both named `{0}`; names must be unique")]
    DuplicateName(String),
    /// A name that the engine's name table cannot hold.
    #[error("object name `{0}` is empty or contains a control character")]
    BadName(String),
    /// A non-finite number in the input.
    #[error("{0} contains a non-finite number")]
    NotFinite(String),
    /// Wrong number of joint positions for an articulated object.
    #[error("object `{object}` has {expected} joints, got {got} joint positions")]
    JointPositions {
        /// Name of the object.
        object: String,
        /// Number of joints of the model.
        expected: usize,
        /// Number of positions given.
        got: usize,
    },
    /// The linked physics engine has an untested version.
    #[error("expected {expected}, but {got} is linked; run `cargo xtask setup` and build again")]
    EngineVersion {
        /// Version for which this program was built.
        expected: String,
        /// Version of the linked library.
        got: String,
    },
    /// The engine rejected the assembled model, e.g. for an invalid inertia; carries its message.
    #[error("the physics engine rejected the scene: {0}")]
    Compile(String),
    /// The engine rejected a file in MJCF; carries its message.
    #[error("MuJoCo: {0}")]
    Mjcf(String),
    /// A command of the wrong length.
    #[error("a command has {expected} numbers (arm joint targets, then gripper width), got {got}")]
    CommandLength {
        /// Required length: number of arm joints + 1.
        expected: usize,
        /// Length given.
        got: usize,
    },
    /// A command with a non-finite number.
    #[error("command number {index} is {value}, expected a finite number")]
    CommandNotFinite {
        /// Index of the number.
        index: usize,
        /// Value of the number.
        value: f32,
    },
    /// A saved state of a different scene.
    #[error("a state of this scene has {expected} numbers, got {got}: it was saved from a different scene")]
    StateLength {
        /// Length of this scene's states.
        expected: usize,
        /// Length given.
        got: usize,
    },
    /// A command for a scene without a robot.
    #[error("this scene was compiled without a robot and cannot take commands")]
    NoRobot,
    /// The integration diverged: a position, speed or acceleration is not finite or far too large.
    #[error("the simulation became unstable at {time_s:.4} s: {what}")]
    Unstable {
        /// Simulated time, s.
        time_s: f64,
        /// Quantity that diverged.
        what: String,
    },
    /// The contact memory is full; the engine would drop contacts silently.
    #[error("the contact memory was exhausted at {time_s:.4} s; raise `arena_mib` above {arena_mib}")]
    ContactsDropped {
        /// Simulated time, s.
        time_s: f64,
        /// Configured memory, MiB.
        arena_mib: usize,
    },
}
