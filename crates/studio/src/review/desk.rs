//! Review desk: the scenarios under review with the log of reviews, and for each reviewer the work to do and the
//! visible reviews.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use genmanip_assets::Catalogue;
use genmanip_benchmark::balance::{self, Axes, Balance, MeasuredContent, Offered};
use genmanip_benchmark::suite_format::{Candidate, Targets, sha256};
use genmanip_core::{Document, Scenario, TaskKind};
use serde::Serialize;

use super::agreement::{Agreement, agreement};
use super::content::content_sha256;
use super::inputs::{LeftOut, ReviewInputs};
use super::likeness::{features, groups};
use super::log::{ExpertTrials, ReviewError, ReviewLog};
use super::queue::{Work, visible_to, work_for};
use super::reviewed::{Decision, Reason, Review};
use super::standing::{REVIEWS, Standing, current, standing};

/// Maximum number of candidates that a dashboard names.
const NAMED: usize = 20;

/// A scenario under review.
#[derive(Clone, Debug)]
pub struct Reviewable {
    /// Key of the scenario in URLs.
    pub key: String,
    /// Id of the scenario.
    pub id: String,
    /// File of the scenario.
    pub path: PathBuf,
    /// Collection that the scenario belongs to.
    pub source: String,
    /// Kind of its task.
    pub kind: TaskKind,
    /// Instruction of the task.
    pub instruction: String,
    /// SHA-256 of the scenario's file.
    pub file_sha256: String,
    /// SHA-256 of scenario, assets and engine, see [`content_sha256`].
    pub content_sha256: String,
    /// Name of the camera whose image a contact sheet shows; `None` without cameras.
    pub camera: Option<String>,
    /// True if an edited copy replaces this scenario in reviews.
    pub is_superseded: bool,
    /// Candidate for a suite; its traits are the values on the axes of balance.
    pub candidate: Candidate,
    features: BTreeSet<String>,
}

impl Reviewable {
    /// A scenario under review, from the content of its file.
    pub fn of(key: &str, path: PathBuf, source: &str, scenario: &Scenario) -> Self {
        let task = &scenario.task;
        Self {
            key: key.into(),
            id: scenario.id.clone(),
            path,
            source: source.into(),
            kind: task.kind,
            instruction: task.instruction.clone(),
            file_sha256: sha256(scenario.to_json().as_bytes()),
            content_sha256: content_sha256(scenario),
            camera: scenario.world.cameras.first().map(|camera| camera.name.clone()),
            is_superseded: false,
            candidate: balance::candidate(task, balance::axes(task, Catalogue::all()), false),
            features: features(scenario),
        }
    }
}

/// Row of a scenario in a reviewer's queue.
#[derive(Clone, Debug, Serialize)]
pub struct QueueRow {
    /// Key of the scenario in URLs.
    pub key: String,
    /// Id of the scenario.
    pub id: String,
    /// Kind of its task.
    pub kind: TaskKind,
    /// Collection that the scenario belongs to.
    pub source: String,
    /// Instruction of the task.
    pub instruction: String,
    /// Name of the camera whose image is shown; `None` without cameras.
    pub camera: Option<String>,
    /// Standing of the scenario, which follows from its current reviews.
    #[serde(flatten)]
    pub standing: Standing,
    /// Work that the scenario offers to the reviewer; `None` if there is none.
    pub work: Option<Work>,
    /// True if the reviewer has reviewed the present content.
    pub has_said: bool,
    /// True if the expert solved this content in every trial.
    pub is_certified: bool,
    /// Number of the scenario's group of near-duplicates; `None` if it has none.
    pub group: Option<usize>,
}

/// The queue of a reviewer.
#[derive(Clone, Debug, Serialize)]
pub struct ReviewQueue {
    /// All scenarios in the order of the collection.
    pub scenarios: Vec<QueueRow>,
    /// Key of the scenario to review next; null if nothing is left.
    pub next: Option<String>,
}

/// Reviews of a scenario, as far as a reviewer may see them.
#[derive(Clone, Debug, Serialize)]
pub struct ReviewState {
    /// Row of the scenario in the reviewer's queue.
    #[serde(flatten)]
    pub row: QueueRow,
    /// SHA-256 of the content that a review is bound to.
    pub content_sha256: String,
    /// Reviews that the reviewer may see.
    pub reviews: Vec<Review>,
    /// Latest trials of the expert on this content; `None` before the first.
    pub trials: Option<ExpertTrials>,
}

/// Balance of the approved scenarios.
#[derive(Clone, Debug, Serialize)]
pub struct Dashboard {
    /// Distribution of the approved scenarios over the axes.
    pub balance: Balance,
    /// Largest total variation distance of an axis from its target, 0 to 1.
    pub worst: f64,
    /// Candidates that would improve the balance most if approved, best first.
    pub helpful: Vec<Helpful>,
    /// Number of scenarios by standing.
    pub standings: BTreeMap<&'static str, usize>,
    /// Reference policies, the strongest first.
    pub policies: Vec<ReferencePolicy>,
    /// Scenarios that reference policies tried, the hardest first.
    pub measured: Vec<MeasuredScenario>,
    /// Episodes of reference policies that measure none of these scenarios, by reason.
    pub left_out: Vec<LeftOutEpisodes>,
}

/// Episodes of reference policies that measure no scenario of the review.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LeftOutEpisodes {
    /// Number of them.
    pub episodes: usize,
    /// Reason, for people.
    pub reason: &'static str,
}

/// Success of a reference policy on the scenarios under review.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ReferencePolicy {
    /// Name of the policy.
    pub policy: String,
    /// Number of scenarios that it tried.
    pub scenarios: usize,
    /// Number of its episodes.
    pub episodes: usize,
    /// Number of its successful episodes.
    pub successes: usize,
}

/// Measured difficulty of a scenario.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MeasuredScenario {
    /// Key of the scenario in URLs.
    pub key: String,
    /// Id of the scenario.
    pub id: String,
    /// Value on the axis `difficulty`.
    pub difficulty: &'static str,
    /// Mean success rate of the policies, each with the same weight, 0 to 1.
    pub mean_success: f64,
    /// Numbers of successes and of episodes, by policy.
    pub policies: BTreeMap<String, (usize, usize)>,
}

/// A candidate that would improve the balance if approved.
#[derive(Clone, Debug, Serialize)]
pub struct Helpful {
    /// Key of the scenario in URLs.
    pub key: String,
    /// Id of the scenario.
    pub id: String,
    /// Mean relative shortfall of its values, -1 to 1; negative if they are too frequent already.
    pub gain: f64,
    /// Its rarest value with share and target, for people.
    pub reason: String,
}

/// Scenarios under review, with the log of reviews and trials.
#[derive(Debug)]
pub struct ReviewDesk {
    items: BTreeMap<String, Reviewable>,
    log: ReviewLog,
    /// Certificates from suites, by hash of the content.
    certificates: BTreeMap<String, ExpertTrials>,
    inputs: ReviewInputs,
}

impl ReviewDesk {
    /// A desk without scenarios.
    pub fn new(log: ReviewLog) -> Self {
        Self { items: BTreeMap::new(), log, certificates: BTreeMap::new(), inputs: ReviewInputs::default() }
    }

    /// Adds a scenario to the desk, or replaces an earlier revision of it.
    pub fn put(&mut self, item: Reviewable) {
        self.items.insert(item.key.clone(), item);
    }

    /// Sets the results of reference policies, the targets and the planted scenarios.
    pub fn set_inputs(&mut self, inputs: ReviewInputs) {
        self.inputs = inputs;
    }

    /// Target shares that the user named.
    pub fn targets(&self) -> &Targets {
        &self.inputs.targets
    }

    /// Marks the scenarios with these keys, and no others, as replaced by edited copies.
    pub fn supersede(&mut self, keys: &BTreeSet<String>) {
        self.items.values_mut().for_each(|item| item.is_superseded = keys.contains(&item.key));
    }

    /// Scenario with a key; `None` if there is none.
    pub fn get(&self, key: &str) -> Option<&Reviewable> {
        self.items.get(key)
    }

    /// Scenarios that no edited copy replaces, ordered by key.
    pub fn items(&self) -> impl Iterator<Item = &Reviewable> {
        self.items.values().filter(|item| !item.is_superseded)
    }

    /// Log of reviews and trials.
    pub fn log_mut(&mut self) -> &mut ReviewLog {
        &mut self.log
    }

    /// Latest trials of the expert on a scenario's content; `None` without any.
    pub fn trials(&self, item: &Reviewable) -> Option<&ExpertTrials> {
        let content = &item.content_sha256;
        self.log.trials(content).or_else(|| self.certificates.get(content))
    }

    /// Adds a certificate from a suite, which is not written to the log.
    pub fn certify(&mut self, trials: ExpertTrials) {
        self.certificates.insert(trials.content_sha256.clone(), trials);
    }

    /// Standing of a scenario, which follows from its current reviews.
    pub fn standing(&self, item: &Reviewable) -> Standing {
        self.standing_of(item, &self.log.reviews())
    }

    fn standing_of(&self, item: &Reviewable, reviews: &[Review]) -> Standing {
        standing(&current(reviews, &item.id, &item.content_sha256), self.is_certified(item))
    }

    fn is_certified(&self, item: &Reviewable) -> bool {
        self.trials(item).is_some_and(|trials| trials.certificate().is_some())
    }

    /// Queue of a reviewer: all scenarios, and the one to review next.
    pub fn queue(&self, reviewer: &str) -> ReviewQueue {
        let reviews = self.log.reviews();
        let features: Vec<&BTreeSet<String>> = self.items().map(|item| &item.features).collect();
        let rows = self.items().zip(groups(&features)).map(|(item, group)| self.row(item, group, reviewer, &reviews));
        let scenarios: Vec<QueueRow> = rows.collect();
        // `min_by_key` returns the first of several minima, so the order of the collection decides.
        let next = scenarios.iter().filter(|row| row.work.is_some()).min_by_key(|row| row.work);
        ReviewQueue { next: next.map(|row| row.key.clone()), scenarios }
    }

    fn row(&self, item: &Reviewable, group: Option<usize>, reviewer: &str, reviews: &[Review]) -> QueueRow {
        let now = current(reviews, &item.id, &item.content_sha256);
        QueueRow {
            key: item.key.clone(),
            id: item.id.clone(),
            kind: item.kind,
            source: item.source.clone(),
            instruction: item.instruction.clone(),
            camera: item.camera.clone(),
            standing: self.standing_of(item, reviews),
            work: work_for(reviewer, &now),
            has_said: now.iter().any(|review| review.reviewer.name == reviewer),
            is_certified: self.is_certified(item),
            group,
        }
    }

    /// Reviews of a scenario as far as a reviewer may see them; `None` if there is no such scenario.
    pub fn state(&self, key: &str, reviewer: &str) -> Option<ReviewState> {
        let item = self.get(key)?;
        let reviews = self.log.reviews();
        let now = current(&reviews, &item.id, &item.content_sha256);
        Some(ReviewState {
            row: self.row(item, None, reviewer, &reviews),
            content_sha256: item.content_sha256.clone(),
            reviews: visible_to(reviewer, &now).into_iter().cloned().collect(),
            trials: self.trials(item).cloned(),
        })
    }

    /// Writes a review of a scenario to the log.
    ///
    /// # Errors
    /// [`ReviewError`].
    pub fn add(&mut self, key: &str, review: Review) -> Result<(), ReviewError> {
        let Some(item) = self.items.get(key) else { return Err(ReviewError::Invalid(format!("no scenario {key}"))) };
        if item.is_superseded {
            return Err(ReviewError::Invalid("an edited copy has taken the place of this scenario".into()));
        }
        if review.scenario != item.id {
            return Err(ReviewError::Invalid(format!(
                "expected a review of {}, got one of {}",
                item.id, review.scenario
            )));
        }
        self.log.add(review, &item.content_sha256)
    }

    /// Agreement of the reviewers, with their detection of the planted faults.
    pub fn agreement(&self) -> Agreement {
        agreement(&self.log.reviews(), &self.inputs.planted)
    }

    /// Balance of the approved scenarios; all scenarios that are neither rejected nor planted are candidates.
    pub fn dashboard(&self, targets: &Targets) -> Dashboard {
        let offered = self.offered();
        let is_out =
            |one: &(Standing, Offered)| one.0 == Standing::Rejected || self.inputs.planted.contains(&one.1.scenario);
        let is_in = |one: &(Standing, Offered)| one.0 == Standing::Approved && !is_out(one);
        let decided: BTreeSet<usize> = (0..offered.len()).filter(|&index| is_in(&offered[index])).collect();
        let chosen: Vec<&Axes> = decided.iter().map(|&index| &offered[index].1.candidate.traits).collect();
        let possible = offered.iter().filter(|one| !is_out(one));
        let candidates: Vec<&Axes> = possible.map(|one| &one.1.candidate.traits).collect();
        let reached = balance::balance(&chosen, &candidates, targets);
        let mut standings = BTreeMap::new();
        offered.iter().for_each(|one| *standings.entry(one.0.name()).or_default() += 1);
        let keys: Vec<String> = self.items().map(|item| item.key.clone()).collect();
        let undecided = |one: &(Standing, Offered)| Offered {
            refused: one.1.refused.clone().filter(|_| is_out(one)),
            ..one.1.clone()
        };
        let pool: Vec<Offered> = offered.iter().map(undecided).collect();
        let ranked = balance::helpful(&pool, &decided, targets).into_iter().take(NAMED);
        let helpful = ranked.map(|(index, gain, reason)| Helpful {
            key: keys[index].clone(),
            id: pool[index].scenario.clone(),
            gain,
            reason,
        });
        Dashboard {
            worst: reached.axes.iter().map(|axis| axis.total_variation).fold(0.0, f64::max),
            helpful: helpful.collect(),
            balance: reached,
            standings,
            policies: self.policies(),
            measured: self.measured(),
            left_out: self.left_out(),
        }
    }

    /// Success of each reference policy on the scenarios under review, the strongest first.
    fn policies(&self) -> Vec<ReferencePolicy> {
        let mut found = BTreeMap::<&str, ReferencePolicy>::new();
        let tried = self.items().filter_map(|item| self.tried(item)).flat_map(|tried| &tried.policies);
        for (policy, &(successes, episodes)) in tried {
            let new = || ReferencePolicy { policy: policy.clone(), scenarios: 0, episodes: 0, successes: 0 };
            let known = found.entry(policy).or_insert_with(new);
            known.scenarios += 1;
            known.episodes += episodes;
            known.successes += successes;
        }
        let mut found: Vec<ReferencePolicy> = found.into_values().collect();
        let rate = |one: &ReferencePolicy| one.successes as f64 / one.episodes.max(1) as f64;
        found.sort_by(|a, b| rate(b).total_cmp(&rate(a)));
        found
    }

    /// Scenarios that reference policies tried, the hardest first.
    fn measured(&self) -> Vec<MeasuredScenario> {
        let one = |item: &Reviewable| {
            let tried = self.tried(item)?;
            Some(MeasuredScenario {
                key: item.key.clone(),
                id: item.id.clone(),
                difficulty: tried.difficulty(),
                mean_success: tried.mean_success(),
                policies: tried.policies.clone(),
            })
        };
        let mut found: Vec<MeasuredScenario> = self.items().filter_map(one).collect();
        found.sort_by(|a, b| a.mean_success.total_cmp(&b.mean_success));
        found
    }

    /// Results of the reference policies on the present content of a scenario; `None` without any.
    fn tried(&self, item: &Reviewable) -> Option<&MeasuredContent> {
        self.inputs.measured.get(&item.file_sha256)
    }

    /// Episodes that measure nothing: those that were refused when they were read, and those of scenarios under review
    /// with another content.
    fn left_out(&self) -> Vec<LeftOutEpisodes> {
        let ids: BTreeSet<&str> = self.items().map(|item| item.id.as_str()).collect();
        let contents: BTreeSet<&str> = self.items().map(|item| item.file_sha256.as_str()).collect();
        let is_other = |content: &str, id: &str| ids.contains(id) && !contents.contains(content);
        let others = self.inputs.measured.iter().filter(|(content, tried)| is_other(content, &tried.scenario_id));
        let others = others.map(|(_, tried)| tried.episodes()).sum();
        let all = self.inputs.left_out.iter().map(|(reason, episodes)| (*reason, *episodes));
        let all = all.chain([(LeftOut::OtherContent, others)]).filter(|(_, episodes)| *episodes > 0);
        all.map(|(reason, episodes)| LeftOutEpisodes { episodes, reason: reason.text() }).collect()
    }

    /// Candidates for a suite with their standing; only approved ones can be chosen.
    pub fn offered(&self) -> Vec<(Standing, Offered)> {
        let reviews = self.log.reviews();
        let offer = |item: &Reviewable| {
            let standing = self.standing_of(item, &reviews);
            let now = current(&reviews, &item.id, &item.content_sha256);
            let mut candidate = item.candidate.clone();
            if let Some(tried) = self.tried(item) {
                candidate.traits.insert("difficulty".into(), vec![tried.difficulty().into()]);
            }
            let refused = match self.inputs.planted.contains(&item.id) {
                true => Some("it has a planted fault".into()),
                false => refusal(standing, &now),
            };
            (standing, Offered { scenario: item.id.clone(), candidate, refused })
        };
        self.items().map(offer).collect()
    }
}

/// Reason why a scenario with this standing cannot be in a suite; `None` if it can.
fn refusal(standing: Standing, now: &[&Review]) -> Option<String> {
    Some(match standing {
        Standing::Approved => return None,
        Standing::Open { missing } if missing == REVIEWS => "not reviewed".into(),
        Standing::Open { .. } => "one review is missing".into(),
        Standing::Adjudication => "the reviewers differ".into(),
        Standing::Uncertified => "the expert has not solved this content".into(),
        Standing::SentBack => {
            let sent_back = now.iter().find(|review| review.decision == Decision::SendBack);
            format!("sent back: {}", sent_back.map_or("", |review| review.note.as_str()))
        }
        Standing::Rejected => {
            let reasons: BTreeSet<&str> = now
                .iter()
                .filter_map(|review| match &review.decision {
                    Decision::Reject { reasons } => Some(reasons.iter().map(|reason| Reason::name(*reason))),
                    _ => None,
                })
                .flatten()
                .collect();
            format!("rejected: {}", reasons.into_iter().collect::<Vec<_>>().join(", "))
        }
    })
}
