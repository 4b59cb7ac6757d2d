//! Stand-ins for learned policies in a build without the feature `learn`.

use std::path::Path;
use std::sync::Arc;

use genmanip_core::{Policy, RobotModel};
use genmanip_policy::PolicyDescription;
use genmanip_rollout::Stage;
use genmanip_workspace::WorkspaceError;

use super::Execution;

/// Type without values, since no learned policy can be loaded.
#[derive(Clone, Debug)]
pub(crate) enum Learned {}

/// Fails instead of loading a policy.
///
/// # Errors
/// Always, with the command that installs learned policies.
pub(crate) fn load(_folder: &Path, _execution: Execution) -> Result<Arc<Learned>, WorkspaceError> {
    Err(refusal())
}

impl Learned {
    /// Policy for one episode; never called.
    pub(crate) fn act_on(self: &Arc<Self>, _stage: &Stage) -> Result<Box<dyn Policy>, WorkspaceError> {
        match **self {}
    }

    /// Description of the policy; never called.
    pub(crate) fn description(&self) -> &PolicyDescription {
        match *self {}
    }

    /// Policy for a robot without a simulator; never called.
    pub(crate) fn act_unseen(self: &Arc<Self>, _robot: &Arc<RobotModel>) -> Box<dyn Policy> {
        match **self {}
    }
}

/// Error with the command that installs learned policies.
pub(crate) fn refusal() -> WorkspaceError {
    WorkspaceError::input("this program was built without learned policies")
        .with_hint("build it with them: cargo xtask install --learn")
}
