//! Grasps from points, tried out in physics.

use std::sync::Arc;

use genmanip_assets::{Catalogue, panda};
use genmanip_core::Seed;
use genmanip_motion::{Planner, PlannerSettings};
use genmanip_rollout::grasp_trial::{Class, Ending, GraspTrials, Pick, Trial, View, ViewSettings};
use genmanip_sim::SimSettings;

fn trials(sim: SimSettings) -> GraspTrials {
    GraspTrials {
        catalogue: Catalogue::builtin(),
        planner: Arc::new(Planner::new(panda(), PlannerSettings::default()).unwrap()),
        robot: panda(),
        sim,
        view: ViewSettings::default(),
    }
}

fn held(trials: &GraspTrials, class: Class, view: View, count: u64) -> (usize, Vec<Trial>) {
    let run = |index| trials.run(class, view, Pick::Best, Seed::new(5).fork_index(index), &mut || 0.0).unwrap();
    let done: Vec<Trial> = (0..count).map(run).collect();
    (done.iter().filter(|trial| trial.ending == Ending::Held).count(), done)
}

#[test]
fn most_things_are_lifted_shaken_and_held_by_friction_alone() {
    let real = trials(SimSettings::default());
    let (count, done) = held(&real, Class::Compact, View::One, 4);
    assert!(count >= 3, "{done:?}");
    let again = held(&real, Class::Compact, View::One, 1).1;
    assert_eq!(serde_json::to_string(&done[..1]).unwrap(), serde_json::to_string(&again).unwrap(), "same seed");

    // The same grasps without friction: nothing else may carry what was held.
    let slippery = SimSettings { pad_friction: [0.01, 1e-5, 1e-5], ..SimSettings::default() };
    let (count, done) = held(&trials(slippery), Class::Compact, View::One, 4);
    assert!(count <= 1, "{done:?}");
}
