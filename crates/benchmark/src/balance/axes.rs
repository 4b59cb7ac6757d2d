//! Axes along which a collection is balanced.

use std::collections::{BTreeMap, BTreeSet};

use genmanip_assets::Catalogue;
use genmanip_core::{Atom, JointKind, ReferenceId, Task};

use crate::suites::candidates::{need, traits};

/// Values of a task by name of the axis.
pub type Axes = BTreeMap<String, Vec<String>>;

/// Number of steps from which all tasks share one value (`4` means four or more).
const MOST_STEPS: usize = 4;

/// Values of a task on all axes that it has: those of a suite's entry ([`crate::suite_format::balanced_traits`]), and
///
/// - `kind`: kind of the task.
/// - `goal`: `single` condition, `conjunction`, or `alternatives`.
/// - `steps`: conditions of the shortest alternative.
/// - `clutter`: number of objects that the goal does not name, in three ranges (up to 2, 3-4, 5 or more).
/// - `need`: sentence of a common-sense task that states an everyday need.
/// - `joint`: kinds of the joints whose states the goal requires, for articulated objects.
pub fn axes(task: &Task, catalogue: &Catalogue) -> Axes {
    let alternatives = &task.goal.alternatives;
    let goal = match alternatives.as_slice() {
        [only] if only.len() == 1 => "single",
        [_] => "conjunction",
        _ => "alternatives",
    };
    let steps = alternatives.iter().map(Vec::len).min().unwrap_or(0).clamp(1, MOST_STEPS);
    let named: BTreeSet<&ReferenceId> = alternatives.iter().flatten().flat_map(Atom::ids).collect();
    let others = task.scene_graph.nodes.iter().filter(|node| !named.contains(&*node.id)).count();
    let clutter = match others {
        0..=2 => "up to 2",
        3..=4 => "3-4",
        _ => "5 or more",
    };
    let mut axes = traits(task, catalogue);
    let mut put = |axis: &str, value: &str| axes.insert(axis.into(), vec![value.into()]);
    put("kind", task.kind.name());
    put("goal", goal);
    put("steps", &steps.to_string());
    put("clutter", clutter);
    if let Some(need) = need(task) {
        put("need", &need);
    }
    let joints = joints(task, catalogue);
    if !joints.is_empty() {
        axes.insert("joint".into(), joints.into_iter().map(String::from).collect());
    }
    // An axis without a value is omitted: a task without relations, such as opening a drawer, has no `relation`.
    axes.retain(|_, values| !values.is_empty());
    axes
}

/// Kinds of the joints that define the states of the goal.
fn joints(task: &Task, catalogue: &Catalogue) -> BTreeSet<&'static str> {
    let mut kinds = BTreeSet::new();
    for atom in task.goal.alternatives.iter().flatten() {
        let Atom::State { object, state } = atom else { continue };
        let Ok(model) = catalogue.build(&object.asset()) else { continue };
        let meant = model.joint_states.iter().filter(|known| known.name == *state);
        let names: BTreeSet<&str> = meant.flat_map(|known| &known.intervals).map(|(name, _)| name.as_str()).collect();
        let joints = model.links.iter().filter_map(|link| link.joint.as_ref());
        kinds.extend(joints.filter(|joint| names.contains(joint.name.as_str())).map(|joint| match joint.kind {
            JointKind::Revolute => "revolute",
            JointKind::Prismatic => "prismatic",
        }));
    }
    kinds
}
