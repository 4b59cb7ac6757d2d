//! Why a layout cannot be made.

use genmanip_assets::AssetError;
use genmanip_core::{Atom, InterchangeError, PlacedObject};
use genmanip_relations::Window;
use genmanip_render::RenderError;
use genmanip_sim::SimError;

use crate::Rejections;

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
    /// The task puts things on or near a surface that the world does not have.
    #[error("the task needs a surface `{id}`, the world has {}", if known.is_empty() { "a table only".into() } else { known.join(", ") })]
    UnknownSurface {
        /// The surface.
        id: String,
        /// What surfaces the world has besides the table.
        known: Vec<String>,
    },
    /// An object is called like one of the world's surfaces.
    #[error("object `{id}` is called like a surface of the world")]
    ObjectLikeSurface {
        /// The id of both.
        id: String,
    },
    /// The task's groups of interchangeable copies make no sense.
    #[error(transparent)]
    Interchangeable(#[from] InterchangeError),
    /// Objects that stand on or lie in each other.
    #[error("{} stand on each other in a circle", ids.join(", "))]
    SupportCircle {
        /// The objects that could not be ordered.
        ids: Vec<String>,
    },
    /// Grasps of an object were tried with other physics than it has; a defect, not the task's fault.
    #[error(transparent)]
    StaleGrasps(AssetError),
    /// The cameras' pictures cannot be drawn, so that nobody knows what they see; a defect, not the task's fault.
    #[error("cannot tell what the cameras see")]
    Render(#[from] RenderError),
    /// The physics engine could not be used: a shortage of memory, a broken library or a world that it refuses; a
    /// defect, not the task's fault.
    #[error("physics cannot be computed: {0}")]
    Physics(SimError),
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

impl LayoutError {
    /// Whether something is broken, whatever the task: then other tasks and seeds will do no better.
    pub fn is_defect(&self) -> bool {
        matches!(self, Self::Render(_) | Self::StaleGrasps(_) | Self::Physics(_))
    }
}
