//! Skills in the hands of the expert: moves and tasks that they serve.

use std::sync::Arc;

use genmanip_core::{Atom, ObjectModel, Policy, Seed, Task};
use genmanip_layout::Move;
use genmanip_layout::articulation::joint_changes;
use genmanip_motion::Planner;
use genmanip_relations::PosedScene;
use genmanip_rollout::Stage;
use genmanip_rollout::expert::MoveSkills;

use crate::handle::verb;
use crate::tasks::serves;
use crate::{Skill, Transfer, TransferSettings};

/// Skills that the expert chooses from.
#[derive(Clone, Debug)]
pub struct SkillSet {
    /// The skills.
    pub skills: Arc<[Skill]>,
    /// Settings of their transfer.
    pub settings: TransferSettings,
}

impl SkillSet {
    /// Skills with the default settings of their transfer.
    pub fn new(skills: impl Into<Arc<[Skill]>>) -> Self {
        Self { skills: skills.into(), settings: TransferSettings::default() }
    }

    /// True if a skill serves the change that a move asks for: the kind of manipulation and the kind of joint are those
    /// of its source.
    fn serves(&self, stage: &Stage, scene: &PosedScene, step: &Move) -> bool {
        let Some(state) = step.state() else { return false };
        let Some(change) = joint_changes(scene, step.object, state).into_iter().next() else { return false };
        let model = &stage.models[step.object];
        let kind = model.links.get(change.link).and_then(|link| link.joint.as_ref()).map(|joint| joint.kind);
        let wanted = verb(model, &change);
        self.skills.iter().any(|skill| skill.serves_joint(wanted, kind))
    }
}

impl MoveSkills for SkillSet {
    fn policy(
        &self,
        stage: &Stage,
        planner: &Arc<Planner>,
        scene: &PosedScene,
        step: &Move,
        seed: Seed,
    ) -> Option<Box<dyn Policy>> {
        if !self.serves(stage, scene, step) {
            return None;
        }
        let transfer = Transfer::new(stage, planner, Arc::clone(&self.skills), self.settings.clone());
        Some(Box::new(transfer.of_move(step.clone(), seed)))
    }
}

/// True if a skill serves a change of state that the goal of a task asks for or implies, as the opening of a container
/// that something is to be put into; `model` gives the model of each of the task's objects, by its index.
pub fn serves_task(skill: &Skill, task: &Task, model: &dyn Fn(usize) -> Option<Arc<ObjectModel>>) -> bool {
    let graph = &task.scene_graph;
    task.goal.alternatives.iter().flatten().any(|atom| {
        let (object, wanted) = match atom {
            Atom::State { object, state } => (&**object, Some(state.as_str())),
            Atom::Relation { relation, reference, .. } if relation.is_inside() => (reference, None),
            Atom::Relation { .. } => return false,
        };
        let Some((index, model)) = graph.index_of(object).and_then(|index| Some((index, model(index)?))) else {
            return false;
        };
        let states = || model.joint_states.iter().map(|state| state.name.as_str());
        let fits = |name: &str, given: Option<&str>| given.is_none_or(|given| given == name);
        let mut begins = states().filter(|name| fits(name, graph.nodes[index].state.as_deref()));
        begins.any(|from| states().any(|to| fits(to, wanted) && serves(skill, &model, from, to)))
    })
}
