//! Settings of the studio's server.

use std::net::SocketAddr;
use std::path::PathBuf;

use super::access::Token;
use crate::review::ReviewInputs;
use crate::run::OfferedPolicies;

/// Settings of the studio's server.
#[derive(Clone, Debug)]
pub struct StudioSettings {
    /// Address and port to listen on.
    pub address: SocketAddr,
    /// Folder for copies of read-only scenarios, new scenarios, reviews, suites, and episodes (in `runs`).
    pub out: PathBuf,
    /// Author of requests that give no name.
    pub author: String,
    /// Secret that every request must contain; `None` if none is required, as on a loopback address.
    pub token: Option<Token>,
    /// Policies that users may run on scenarios.
    pub policies: OfferedPolicies,
    /// Folder with the questions that people answer in place of a model; `None` if the studio offers none.
    pub questions: Option<PathBuf>,
    /// Results of reference policies, target shares and planted scenarios for the review.
    pub review: ReviewInputs,
}
