//! Settings of the studio's server.

use std::net::SocketAddr;
use std::path::PathBuf;

use super::access::Token;
use crate::run::OfferedPolicies;

/// Settings of the studio's server.
#[derive(Clone, Debug)]
pub struct StudioSettings {
    /// Folder for copies of read-only scenarios, reviews and suites.
    pub address: SocketAddr,
    /// Author of tabs that give no name.
    pub out: PathBuf,
    /// Secret that every request must contain; `None` for a server on a loopback address.
    pub author: String,
    /// Secret that every request must hold; none on loopback.
    pub token: Option<Token>,
    /// Folder with the questions that people answer in place of a model; `None` without such an agent.
    pub policies: OfferedPolicies,
    /// Folder of questions that people answer in place of a model.
    pub questions: Option<PathBuf>,
}
