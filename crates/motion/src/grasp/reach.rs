//! Which grasps the arm can carry out where the object is: reach, limits, and room among the neighbours.

use genmanip_core::{Grasp, Pose};
use glam::DVec3;

use crate::planner::{Planner, PlanningScene};

/// A grasp with the arm configurations to carry it out.
#[derive(Clone, Debug, PartialEq)]
pub struct ReachableGrasp {
    /// The grasp in the object's frame; perhaps turned by half a circle against the candidate it came from.
    pub object_from_tcp: Grasp,
    /// Pose of the tcp at the grasp.
    pub world_from_tcp: Pose,
    /// Opening while approaching, m.
    pub opening: f64,
    /// Arm configuration at the grasp.
    pub config: Vec<f64>,
    /// Arm configuration before the straight approach; same branch as `config`.
    pub pregrasp: Vec<f64>,
}

impl Planner {
    /// The first `wanted` of `candidates` (object frame, in their order) that the arm can carry out where the object
    /// is: grasp and pre-grasp are in reach, and the robot touches nothing there but `target` with its open gripper.
    ///
    /// `around` should hold the target as an obstacle of that name; its gripper width is replaced by the grasp's own.
    /// The straight way between pre-grasp and grasp is not tested here: see [`Planner::straight`].
    pub fn reachable_grasps(
        &self,
        around: &PlanningScene,
        target: &str,
        world_from_object: &Pose,
        candidates: &[Grasp],
        reference: &[f64],
        wanted: usize,
    ) -> Vec<ReachableGrasp> {
        let try_one = |candidate: &Grasp| {
            [candidate.clone(), candidate.flipped()]
                .into_iter()
                .filter_map(|grasp| carry_out(self, around, target, world_from_object, grasp, reference))
                .min_by(|a, b| {
                    let far = |grasp: &ReachableGrasp| crate::path::distance(&grasp.config, reference);
                    far(a).total_cmp(&far(b))
                })
        };
        candidates.iter().filter_map(try_one).take(wanted).collect()
    }
}

fn carry_out(
    planner: &Planner,
    around: &PlanningScene,
    target: &str,
    world_from_object: &Pose,
    grasp: Grasp,
    reference: &[f64],
) -> Option<ReachableGrasp> {
    let settings = &planner.settings().reach;
    let opening = planner.opening(&grasp);
    let world_from_tcp = *world_from_object * grasp.pose;
    let world_from_pregrasp = world_from_tcp * Pose::from_position(DVec3::Z * -settings.approach);
    let touching = around.allowed.clone().and_gripper(planner.robot(), target);
    let at_grasp = PlanningScene { allowed: &touching, gripper_width: opening, ..*around };
    let mut solutions = planner.ik_each(&world_from_tcp, reference).take(settings.configurations).peekable();
    solutions.peek()?;
    let checker = planner.checker(&at_grasp, settings.padding);
    solutions.find_map(|config| {
        if !checker.is_free(&config) {
            return None;
        }
        let pregrasp = planner.ik_near(&world_from_pregrasp, &config, 1.0)?;
        let object_from_tcp = grasp.clone();
        checker.is_free(&pregrasp).then_some(ReachableGrasp {
            object_from_tcp,
            world_from_tcp,
            opening,
            config,
            pregrasp,
        })
    })
}
