//! Overlap between a training and a test data set.

use std::collections::BTreeMap;

use super::DatasetCheck;
use super::findings::Finding;
use super::metadata::EpisodeEntry;

/// Properties by which an episode is recognised in another data set.
#[derive(Clone, Debug)]
pub struct Identity {
    pub(super) episode: i64,
    pub(super) scenario: Option<String>,
    pub(super) sentence: String,
    pub(super) content: u64,
    pub(super) file: String,
}

impl Identity {
    pub(super) fn of(episode: &EpisodeEntry, content: u64) -> Self {
        Self {
            episode: episode.index,
            scenario: episode.scenario_id.clone(),
            sentence: episode.sentence.clone(),
            content,
            file: episode.listed_in.0.clone(),
        }
    }
}

/// Train-test overlap: scenarios, instructions and episodes of the second (test) data set that also occur in the first
/// (training) data set.
pub fn leaks(first: &DatasetCheck, second: &DatasetCheck) -> Vec<Finding> {
    let mut findings = Vec::new();
    let mut shared = |what: &str, key: &dyn Fn(&Identity) -> Option<String>| {
        let mut known: BTreeMap<String, i64> = BTreeMap::new();
        for identity in &first.identities {
            if let Some(key) = key(identity) {
                known.entry(key).or_insert(identity.episode);
            }
        }
        let mut reported: BTreeMap<String, ()> = BTreeMap::new();
        for identity in &second.identities {
            let Some(key) = key(identity).filter(|key| known.contains_key(key)) else { continue };
            if reported.insert(key.clone(), ()).is_none() {
                findings.push(Finding {
                    check: "leak",
                    file: format!("{}/{}", second.dataset, identity.file),
                    place: format!("episode {}", identity.episode),
                    expected: format!("{what} not in {}", first.dataset),
                    found: format!("also in its episode {}: {key}", known[&key]),
                });
            }
        }
    };
    shared("a scenario", &|identity| identity.scenario.clone());
    shared("a sentence", &|identity| Some(identity.sentence.trim().to_lowercase()));
    shared("states and actions", &|identity| Some(format!("{:016x}", identity.content)));
    findings
}
