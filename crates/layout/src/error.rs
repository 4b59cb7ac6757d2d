//! Layout errors.

use genmanip_assets::AssetError;
use genmanip_core::{Atom, InstanceId, InterchangeError, PlacedObject, ReferenceId, SurfaceId};
use genmanip_relations::Window;
use genmanip_render::RenderError;
use genmanip_sim::SimError;

use crate::Rejections;

/// Reason why no layout was made.
#[derive(Debug, thiserror::Error)]
pub enum LayoutError {
    /// An object is missing from the catalogue or cannot be built.
    #[error(transparent)]
    UnknownObject(#[from] AssetError),
    /// The planner's robot differs from the world's.
    #[error("world field {field}: expected {expected}, the planner has {got}")]
    OtherRobot {
        /// Differing field of the world.
        field: &'static str,
        /// Value in the world.
        expected: String,
        /// Value of the planner's robot.
        got: String,
    },
    /// An edge refers to an object that is not a node of the graph.
    #[error("edge `{edge}` refers to {id}, which is not a node of the scene graph")]
    NotANode {
        /// The edge as text.
        edge: String,
        /// Id of the object that is not a node.
        id: ReferenceId,
    },
    /// The task refers to a surface that the world does not have.
    #[error("the task needs surface `{id}`, but the world has {}", if known.is_empty() { "only a table".into() } else { known.join(", ") })]
    UnknownSurface {
        /// Unknown id of the surface.
        id: SurfaceId,
        /// Ids of the world's surfaces besides the table.
        known: Vec<SurfaceId>,
    },
    /// An object id equals the id of a surface of the world.
    #[error("object id `{id}` is also the id of a surface of the world")]
    ObjectLikeSurface {
        /// Id of both the object and the surface.
        id: InstanceId,
    },
    /// The task's groups of interchangeable copies are invalid.
    #[error(transparent)]
    Interchangeable(#[from] InterchangeError),
    /// Objects support each other in a cycle.
    #[error("support cycle: {}", ids.join(" → "))]
    SupportCycle {
        /// Ids of the objects that could not be ordered.
        ids: Vec<InstanceId>,
    },
    /// Grasps of an object were tested with different physics; a defect, independent of the task.
    #[error(transparent)]
    StaleGrasps(AssetError),
    /// The camera images cannot be rendered, so visibility is unknown; a defect, independent of the task.
    #[error("cannot render the camera images to check visibility")]
    Render(#[from] RenderError),
    /// The simulation could not run: out of memory, a broken library or an invalid world; a defect, independent of the
    /// task.
    #[error("the simulation cannot run: {0}")]
    Physics(SimError),
    /// Every attempt was rejected.
    #[error("no layout for task {task} in {restarts} attempts: {rejections}")]
    Infeasible {
        /// Id of the task.
        task: String,
        /// Number of layouts begun from scratch; 0 if the task was rejected before.
        restarts: usize,
        /// Rejections by reason.
        rejections: Rejections,
        /// The attempt that placed most objects; `None` if no attempt got stuck during placement.
        furthest: Option<Box<Unfinished>>,
    },
}

/// A layout in which some object has no valid pose.
#[derive(Clone, Debug, PartialEq)]
pub struct Unfinished {
    /// Placed objects; if no attempt placed any, all objects of a layout without the conflicting edges.
    pub placed: Vec<PlacedObject>,
    /// Id of the object without a valid pose.
    pub object: InstanceId,
    /// Region of its centre allowed by each of its relations to a placed object.
    pub windows: Vec<(Atom, Window)>,
}

impl LayoutError {
    /// True for a defect that affects every task and seed.
    pub fn is_defect(&self) -> bool {
        matches!(self, Self::Render(_) | Self::StaleGrasps(_) | Self::Physics(_))
    }
}
