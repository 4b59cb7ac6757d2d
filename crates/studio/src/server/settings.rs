//! Settings of the studio's server.

use std::net::SocketAddr;
use std::path::PathBuf;

use super::access::Token;
use crate::review::ReviewInputs;
use crate::run::OfferedPolicies;

/// Settings of the studio's server.
#[derive(Clone, Debug)]
pub struct StudioSettings {
    /// Address to listen at.
    pub address: SocketAddr,
    /// Folder for copies of read-only scenarios, reviews and suites.
    pub out: PathBuf,
    /// Author of tabs that give no name.
    pub author: String,
    /// Secret that every request must contain; `None` for a server on a loopback address.
    pub token: Option<Token>,
    /// Policies that the page may run.
    pub policies: OfferedPolicies,
    /// Folder with the questions that people answer in place of a model; `None` without such an agent.
    pub questions: Option<PathBuf>,
    /// Results of reference policies, target shares and planted scenarios for the review.
    pub review: ReviewInputs,
}
