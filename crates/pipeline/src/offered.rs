//! Policies that this program can serve to other programs.

use std::sync::Arc;

use genmanip_assets::robots;
use genmanip_core::{Policy, PolicySpec, RobotModel};
use genmanip_workspace::WorkspaceError;

use crate::policies::load_learned;

/// A policy for use outside the simulator, on the observations that its clients send.
pub struct OfferedPolicy {
    /// Robot that the policy controls.
    pub robot: Arc<RobotModel>,
    /// Observations and actions of the policy.
    pub spec: PolicySpec,
    /// Creates an instance for one client.
    pub make: Arc<dyn Fn() -> Box<dyn Policy> + Send + Sync>,
}

/// A policy to serve, given as `learned:FOLDER` or `learned:FOLDER,key=value`.
///
/// # Errors
/// When there is no such policy, its robot is unknown, or it reads simulator ground truth, which clients do not have.
pub fn offered(policy: &str) -> Result<OfferedPolicy, WorkspaceError> {
    let Some(folder) = policy.strip_prefix("learned:").filter(|folder| !folder.is_empty()) else {
        return Err(WorkspaceError::input(format!("policy `{policy}` cannot be served"))
            .with_hint("expected learned:FOLDER, a policy as `genmanip train` writes it"));
    };
    let learned = load_learned(folder)?;
    let description = learned.description();
    if description.privileged {
        return Err(WorkspaceError::input(format!("{folder} reads simulator ground truth, which no client can send"))
            .with_hint("train one that sees images: genmanip train RUN --preset tiny"));
    }
    let robot = robots::named(&description.contract.robot)
        .map_err(|error| WorkspaceError::input(format!("{folder} cannot be served")).because(error))?;
    let made = Arc::clone(&robot);
    let make: Arc<dyn Fn() -> Box<dyn Policy> + Send + Sync> = Arc::new(move || learned.act_unseen(&made));
    Ok(OfferedPolicy { robot, spec: make().spec(), make })
}
