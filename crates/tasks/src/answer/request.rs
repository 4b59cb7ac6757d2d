//! Request that an answer replies to.

use genmanip_core::{InstanceId, NamedSurface, ObjectCard, ReferenceId, TaskKind};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Maximum length of an answer, bytes; longer ones are rejected without parsing.
pub const MAX_ANSWER_BYTES: usize = 1 << 20;

/// Request that an answer responds to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TaskRequest {
    /// Id of the resulting task.
    pub id: String,
    /// Requested kind of task.
    pub kind: TaskKind,
    /// Cards of the offered objects, one per instance: the second card of an asset offers its second instance, with the
    /// uid `001#2`.
    pub offered: Vec<ObjectCard>,
    /// Support surfaces, other than the table, that objects may be put on or near.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub surfaces: Vec<NamedSurface>,
    /// Minimum number of objects in the scene.
    pub min_objects: usize,
    /// True to allow the position `between`, with the second reference in `obj3` and `obj3_uid`; not part of the
    /// published exchange format.
    #[serde(default)]
    pub between: bool,
    /// Origin of the answer, stored in the task.
    pub source: String,
}

impl TaskRequest {
    /// Ids of the offered objects: uids, numbered from the second instance of an asset on; then those of the surfaces.
    pub fn ids(&self) -> Vec<ReferenceId> {
        let surfaces = self.surfaces.iter().map(|surface| surface.id.clone().into());
        self.instances().into_iter().map(ReferenceId::from).chain(surfaces).collect()
    }

    /// Ids of the offered objects.
    pub(super) fn instances(&self) -> Vec<InstanceId> {
        InstanceId::numbered(self.offered.iter().map(|card| &card.uid))
    }

    /// Names of the objects and surfaces, in the order of [`TaskRequest::ids`].
    pub(super) fn names(&self) -> Vec<&str> {
        let objects = self.offered.iter().map(|card| card.name.as_str());
        objects.chain(self.surfaces.iter().map(|surface| surface.name.as_str())).collect()
    }

    /// True if the id with this index is a surface.
    pub(super) fn is_surface(&self, index: usize) -> bool {
        index >= self.offered.len()
    }
}
