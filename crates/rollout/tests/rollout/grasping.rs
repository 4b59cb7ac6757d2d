//! Grasps from point clouds, tested in simulation.

use std::sync::Arc;

use genmanip_assets::worlds::default_world;
use genmanip_assets::{Catalogue, panda};
use genmanip_core::glam::DVec3;
use genmanip_core::{Grasp, PolicyError, Pose, RobotModel, Seed};
use genmanip_motion::{GraspSettings, Planner, PlannerSettings};
use genmanip_rollout::expert::{GraspProposer, ObservedObject};
use genmanip_rollout::grasp_trial::{
    CandidateChoice, GraspTrials, RobustnessSettings, Trial, TrialClass, TrialEnding, TrialView, ViewSettings,
    verified_grasps,
};

fn trials(robot: Arc<RobotModel>) -> GraspTrials {
    GraspTrials {
        catalogue: Catalogue::builtin(),
        planner: Arc::new(Planner::new(panda(), PlannerSettings::default()).unwrap()),
        detector: None,
        robot,
        world: default_world(),
        view: ViewSettings::default(),
    }
}

fn held(trials: &GraspTrials, class: TrialClass, view: TrialView, count: u64) -> (usize, Vec<Trial>) {
    let run =
        |index| trials.run(class, view, CandidateChoice::Best, Seed::new(5).fork_index(index), &mut || 0.0).unwrap();
    let done: Vec<Trial> = (0..count).map(run).collect();
    (done.iter().filter(|trial| trial.ending == TrialEnding::Held).count(), done)
}

#[test]
fn most_objects_are_lifted_shaken_and_held_by_friction_alone() {
    let real = trials(panda());
    let (count, done) = held(&real, TrialClass::Compact, TrialView::One, 4);
    assert!(count >= 3, "{done:?}");
    let again = held(&real, TrialClass::Compact, TrialView::One, 1).1;
    assert_eq!(serde_json::to_string(&done[..1]).unwrap(), serde_json::to_string(&again).unwrap(), "same seed");

    // The same grasps without friction: nothing else may hold the objects.
    let mut slippery = (*panda()).clone();
    slippery.drives.as_mut().unwrap().pad_friction = [0.01, 1e-5, 1e-5];
    let (count, done) = held(&trials(Arc::new(slippery)), TrialClass::Compact, TrialView::One, 4);
    assert!(count <= 1, "{done:?}");
}

/// A detector that knows one grasp: straight down onto the middle of the points, or far beside them.
struct Down(f64);

impl GraspProposer for Down {
    fn grasps(&self, seen: &ObservedObject) -> Result<Vec<Grasp>, PolicyError> {
        assert!(seen.world_from_camera.position.z > 0.2, "a camera above the table");
        let middle = seen.points.iter().sum::<DVec3>() / seen.points.len() as f64;
        let pose = Pose::from_axes(middle + DVec3::Y * self.0, DVec3::X, -DVec3::Y, -DVec3::Z);
        Ok(vec![Grasp { pose, width: 0.05, score: 0.5 }])
    }
}

#[test]
fn grasps_of_a_foreign_detector_are_executed() {
    for (aside_m, holds) in [(0.0, true), (0.25, false)] {
        let real = GraspTrials { detector: Some(Arc::new(Down(aside_m))), ..trials(panda()) };
        let (count, done) = held(&real, TrialClass::Compact, TrialView::Three, 4);
        assert!(done.iter().all(|trial| trial.candidates == 1), "{done:?}");
        assert_eq!(count > 0, holds, "{done:?}");
        assert!(done.iter().flat_map(|trial| &trial.grasp).all(|grasp| grasp.features.is_none()));
    }
}

#[test]
fn catalogue_grasps_are_tried_with_errors() {
    let grasp = GraspSettings { max_candidates: 1, ..GraspSettings::default() };
    let planner = Planner::new(panda(), PlannerSettings { grasp, ..PlannerSettings::default() }).unwrap();
    let real = GraspTrials { planner: Arc::new(planner), ..trials(panda()) };
    let ball = real.catalogue.build("050").unwrap();
    let settings = RobustnessSettings { trials: 2, ..RobustnessSettings::default() };
    let tried = verified_grasps(&real, &ball, &settings, Seed::new(5)).unwrap();
    assert!(tried.len() == 1 && tried[0].trials == 2 && tried[0].held >= 1, "{tried:?}");
    assert_eq!(tried, verified_grasps(&real, &ball, &settings, Seed::new(5)).unwrap(), "same seed");

    let blind = RobustnessSettings { offset_m: 0.2, ..settings };
    let tried = verified_grasps(&real, &ball, &blind, Seed::new(6)).unwrap();
    assert!(tried.iter().all(|grasp| grasp.held == 0), "errors of decimetres grasp nothing: {tried:?}");
}
