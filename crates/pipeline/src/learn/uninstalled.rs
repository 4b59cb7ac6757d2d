//! Stand-ins for training in a build without the feature `learn`: each fails with the command that installs it.

use std::path::Path;
use std::sync::atomic::AtomicBool;

use genmanip_workspace::{Progress, WorkspaceError};

use crate::learned::refusal;
use crate::policies::PolicyFactory;

use super::options::{CheckOptions, Checked, SuiteDemonstrations, TrainOptions, Trained};

/// Fails instead of training.
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

/// Fails instead of building the controls of a policy.
///
/// # Errors
/// Always, with the command that installs learned policies.
pub fn controls(
    _policy: &Path,
    _run: &Path,
    _workers: usize,
    _progress: &dyn Progress,
    _stop: &AtomicBool,
) -> Result<Option<Vec<PolicyFactory>>, WorkspaceError> {
    Err(refusal())
}

/// Fails instead of collecting demonstrations for training.
///
/// # Errors
/// Always, with the command that installs training.
pub fn demonstrate(
    _options: &SuiteDemonstrations,
    _progress: &dyn Progress,
    _stop: &AtomicBool,
) -> Result<bool, WorkspaceError> {
    Err(refusal())
}

/// Fails instead of checking the demonstrations.
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
