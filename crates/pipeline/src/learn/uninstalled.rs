//! Refusals of a build without the feature `learn`.

use std::sync::atomic::AtomicBool;

use genmanip_workspace::{Progress, WorkspaceError};

use super::options::{CheckOptions, Checked, TrainOptions, Trained};

/// Refuses to train.
///
/// # Errors
/// Always, with the command that installs training.
pub fn train(
    _options: &TrainOptions,
    _progress: &dyn Progress,
    _stop: &AtomicBool,
) -> Result<Option<Trained>, WorkspaceError> {
    Err(refusal())
}

/// Refuses to check.
///
/// # Errors
/// Always, with the command that installs training.
pub fn check(
    _options: &CheckOptions,
    _progress: &dyn Progress,
    _stop: &AtomicBool,
) -> Result<Option<Checked>, WorkspaceError> {
    Err(refusal())
}

fn refusal() -> WorkspaceError {
    WorkspaceError::input("this program was built without learned policies")
        .with_hint("build it with them: cargo xtask install --learn")
}

/// Learned policies of the registry.
pub(crate) mod policy {
    use std::path::Path;
    use std::sync::Arc;

    use genmanip_core::Policy;
    use genmanip_rollout::Stage;
    use genmanip_workspace::WorkspaceError;

    /// A learned policy that cannot be loaded.
    #[derive(Clone, Debug)]
    pub(crate) enum Learned {}

    /// Refuses to load a policy.
    pub(crate) fn load(_folder: &Path) -> Result<Arc<Learned>, WorkspaceError> {
        Err(super::refusal())
    }

    impl Learned {
        /// The policy for one episode.
        pub(crate) fn act_on(self: &Arc<Self>, _stage: &Stage) -> Result<Box<dyn Policy>, WorkspaceError> {
            match **self {}
        }
    }
}
