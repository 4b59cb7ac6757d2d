//! Import of reviews and certificates that suites already hold: `review.json`, and the trials of the expert.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use genmanip_benchmark::suite_format::{self, ReviewVerdict};
use genmanip_benchmark::suites;
use genmanip_workspace::WorkspaceError;

use super::desk::{ReviewDesk, Reviewable};
use super::log::ExpertTrials;
use super::reviewed::{Decision, Reason, Review, Reviewer, ReviewerKind};

/// Adds to the desk the certificates of the suites that its scenarios lie in, if made with this version of the
/// physics engine, and the reviews of `review.json` that the log does not have yet. Neither has a time.
///
/// # Errors
/// When a `suite.json` or `review.json` is damaged.
pub fn take_from_suites(desk: &mut ReviewDesk) -> Result<(), WorkspaceError> {
    let suite_of = |item: &Reviewable| item.path.parent().and_then(Path::parent).map(Path::to_owned);
    let folders: BTreeSet<PathBuf> =
        desk.items().filter_map(suite_of).filter(|folder| folder.join("suite.json").is_file()).collect();
    for folder in folders {
        let suite = suites::open(&folder)?;
        let source = format!("suite {}", suite.name);
        let own: Vec<(String, String, &suite_format::SuiteEntry)> = desk
            .items()
            .filter(|item| suite_of(item).as_deref() == Some(&folder))
            .filter_map(|item| {
                let entry = suite.scenarios.iter().find(|entry| entry.id == item.id)?;
                (entry.sha256 == item.file_sha256).then(|| (item.id.clone(), item.content_sha256.clone(), entry))
            })
            .collect();
        if suite.engine == genmanip_sim::engine_version() {
            for (scenario, content_sha256, entry) in &own {
                desk.certify(ExpertTrials {
                    scenario: scenario.clone(),
                    content_sha256: content_sha256.clone(),
                    episodes: entry.certificate.episodes,
                    verified: entry.certificate.verified,
                    shortest_path_m: Some(entry.certificate.shortest_path_m),
                    shortest_s: Some(entry.certificate.shortest_s),
                    horizon_s: entry.horizon_s,
                    at: String::new(),
                });
            }
        }
        if desk.log_mut().has_imported(&source) {
            continue;
        }
        let file = suites::reviews(&folder)?;
        let current = file.reviews.iter().filter_map(|review| {
            let (scenario, content_sha256, _) = own
                .iter()
                .find(|(scenario, _, entry)| *scenario == review.scenario && entry.sha256 == review.sha256)?;
            Some(review_of(review, scenario, content_sha256))
        });
        let reviews: Vec<Review> = current.collect();
        if !file.reviews.is_empty() {
            desk.log_mut().import(&source, reviews);
        }
    }
    Ok(())
}

fn review_of(old: &suite_format::Review, scenario: &str, content_sha256: &str) -> Review {
    let reject = |reason| Decision::Reject { reasons: [reason].into() };
    let (decision, usual) = match old.verdict {
        ReviewVerdict::Sound => (Decision::Approve, ""),
        ReviewVerdict::Ambiguous => (reject(Reason::Ambiguous), ""),
        ReviewVerdict::Flawed => (reject(Reason::Other), "flawed"),
    };
    Review {
        scenario: scenario.into(),
        content_sha256: content_sha256.into(),
        reviewer: Reviewer { name: old.reviewer.clone(), kind: ReviewerKind::Human, version: None },
        decision,
        criteria: BTreeMap::new(),
        note: if old.note.is_empty() { usual.into() } else { old.note.clone() },
        adjudicates: false,
        duration_s: None,
        client_operation_id: String::new(),
        at: String::new(),
    }
}
