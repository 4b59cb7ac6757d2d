//! Refusals of a build without the feature `learn`.

use std::path::Path;
use std::sync::Arc;

use genmanip_core::{Policy, RobotModel};
use genmanip_policy::PolicyDescription;
use genmanip_rollout::Stage;
use genmanip_workspace::WorkspaceError;

/// A learned policy that cannot be loaded.
#[derive(Clone, Debug)]
pub(crate) enum Learned {}

/// Refuses to load a policy.
///
/// # Errors
/// Always, with the command that installs learned policies.
pub(crate) fn load(_folder: &Path) -> Result<Arc<Learned>, WorkspaceError> {
    Err(refusal())
}

impl Learned {
    /// The policy for one episode.
    pub(crate) fn act_on(self: &Arc<Self>, _stage: &Stage) -> Result<Box<dyn Policy>, WorkspaceError> {
        match **self {}
    }

    /// Its description.
    pub(crate) fn description(&self) -> &PolicyDescription {
        match *self {}
    }

    /// The policy for a robot without a simulator.
    pub(crate) fn act_unseen(self: &Arc<Self>, _robot: &Arc<RobotModel>) -> Box<dyn Policy> {
        match **self {}
    }
}

/// Refusal that names the command that installs learned policies.
pub(crate) fn refusal() -> WorkspaceError {
    WorkspaceError::input("this program was built without learned policies")
        .with_hint("build it with them: cargo xtask install --learn")
}
