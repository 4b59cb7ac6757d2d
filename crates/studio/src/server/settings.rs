//! Settings of the server.

use std::net::SocketAddr;
use std::path::PathBuf;

use super::access::Token;
use crate::run::OfferedPolicies;

/// Settings of the server.
#[derive(Clone, Debug)]
pub struct StudioSettings {
    /// Listening address; port 0 picks a free one.
    pub address: SocketAddr,
    /// Folder for copies of read-only scenarios.
    pub out: PathBuf,
    /// Author of tabs that name none.
    pub author: String,
    /// Secret that every request must hold; none on loopback.
    pub token: Option<Token>,
    /// Policies that the page may run.
    pub policies: OfferedPolicies,
    /// Folder of questions that people answer in place of a model.
    pub questions: Option<PathBuf>,
}
