//! Derived parts of a task: groups of interchangeable instances, and named surfaces.

use genmanip_core::{Atom, NamedSurface, ReferenceId, Scenario, SupportSurface};
use genmanip_tasks::references;

use super::error::EditError;

/// Flags of the parts that were derived, not set by hand, before an operation; only these are derived again after it.
pub(super) struct Derived {
    /// True if the groups of interchangeable instances equal those that the rule-based reader finds in the instruction.
    pub groups_follow: bool,
    /// True if the named surfaces are exactly those that goal and scene graph refer to.
    surfaces_follow: bool,
}

impl Derived {
    /// Flags for a scenario.
    pub fn of(scenario: &Scenario) -> Self {
        Self {
            groups_follow: references::interchangeable(&scenario.task) == scenario.task.interchangeable,
            surfaces_follow: surfaces(scenario) == scenario.task.surfaces,
        }
    }

    /// Derives the flagged parts again, and checks the parts that depend on them.
    pub fn complete(&self, scenario: &mut Scenario) -> Result<(), EditError> {
        if self.groups_follow {
            scenario.task.interchangeable = references::interchangeable(&scenario.task);
        }
        if self.surfaces_follow {
            scenario.task.surfaces = surfaces(scenario);
        }
        scenario.task.check_interchangeable().map_err(|error| {
            EditError::invalid("task.interchangeable", error.to_string(), "say in the instruction which copy is meant")
        })
    }
}

/// Surfaces of the world that goal or scene graph refer to, in the order of the world.
fn surfaces(scenario: &Scenario) -> Vec<NamedSurface> {
    let task = &scenario.task;
    let goal = task.goal.alternatives.iter().flatten().flat_map(Atom::references);
    let edges = task.scene_graph.edges.iter();
    let edges = edges.flat_map(|edge| [Some(&edge.reference), edge.second_reference.as_ref()]);
    let named: Vec<&ReferenceId> = goal.chain(edges.flatten()).collect();
    let surfaces = scenario.world.surfaces.iter().filter(|surface| named.iter().any(|id| surface.id == **id));
    surfaces.map(SupportSurface::named).collect()
}
