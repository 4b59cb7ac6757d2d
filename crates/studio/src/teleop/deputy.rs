//! Policies and planned motions that a person hands the command to.

use genmanip_assets::GraspLibrary;
use genmanip_core::{Failure, Policy, Pose};
use genmanip_pipeline::PolicyFactory;
use genmanip_pipeline::policies::PolicyContext;
use genmanip_rollout::Stage;
use genmanip_rollout::collect::PipelineSettings;
use genmanip_rollout::go_to::{self, GoTo};
use genmanip_workspace::{WorkspaceError, worlds};

/// Stand-in for the person in command.
pub(super) enum Deputy {
    /// A policy, by its name with arguments.
    Policy(String),
    /// The planner, which moves the tool to a pose, `world_from_tcp`, until the person touches the device.
    GoTo(Pose),
}

impl Deputy {
    /// Name in the log.
    pub fn name(&self) -> &str {
        match self {
            Self::Policy(name) => name,
            Self::GoTo(_) => go_to::NAME,
        }
    }

    /// The policy for a stage.
    pub fn policy(&self, stage: &Stage) -> Result<Box<dyn Policy>, WorkspaceError> {
        let settings = PipelineSettings::in_world(stage.scenario.world.clone());
        let planner = worlds::planner(&settings.world, &settings.planner)?;
        match self {
            Self::Policy(name) => {
                let (settings, planner, grasps) = (&settings, &planner, GraspLibrary::builtin());
                let context = PolicyContext { stage, recorded: None, planner, grasps, settings, cores: None };
                PolicyFactory::resolve(name)?.make(&context)
            }
            Self::GoTo(goal) => Ok(Box::new(GoTo::new(stage, &planner, *goal))),
        }
    }

    /// Note on its end; `None` if the person goes on at once.
    pub fn note(&self, gave_up: Option<&Failure>) -> Option<String> {
        let what = match (self, gave_up) {
            (Self::GoTo(_), None) => return None,
            (Self::GoTo(_), Some(failure)) => format!("the tool stays where it is, {}", failure.evidence),
            (Self::Policy(name), None) => format!("{name} has finished"),
            (Self::Policy(name), Some(failure)) => {
                format!("{name} gave up ({}: {})", failure.cause.name(), failure.evidence)
            }
        };
        Some(format!("{what}: you are in command"))
    }
}
