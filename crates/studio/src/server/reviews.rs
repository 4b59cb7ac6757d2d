//! HTTP API of reviews: queue, reviews of a scenario, certificates, agreement, balance, and the suite of the approved
//! scenarios.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use axum::extract::{Path, Query, Request as HttpRequest, State};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Json, Router};
use genmanip_benchmark::suite_format::Targets;
use genmanip_workspace::{NoProgress, workers};
use serde::Deserialize;
use serde_json::{Value, json};

use super::answer::Refusal;

use super::requests::{body, work};
use super::review_desk::refused;
use super::studio::Studio;
use crate::review::{self, ReviewDesk, ReviewError, Reviewable};

/// Routes of this module.
pub fn routes() -> Router<Arc<Studio>> {
    Router::new()
        .route("/api/reviews", get(queue))
        .route("/api/reviews/{key}", get(state).post(add))
        .route("/api/reviews/{key}/certificate", post(certify))
        .route("/api/agreement", get(agreement))
        .route("/api/balance", get(balance).post(balance_against))
        .route("/api/suites", get(suites).post(build))
}

type Shared = State<Arc<Studio>>;

/// Reviewer whose view is requested; the studio's author if `None`.
#[derive(Deserialize)]
struct AsReviewer {
    reviewer: Option<String>,
}

async fn queue(State(studio): Shared, Query(who): Query<AsReviewer>) -> Response {
    work(&studio, move |studio| {
        let reviewer = who.reviewer.as_deref().unwrap_or(&studio.author);
        studio.at_desk(|desk| Ok(Json(desk.queue(reviewer)).into_response()))
    })
    .await
}

async fn state(State(studio): Shared, Path(key): Path<String>, Query(who): Query<AsReviewer>) -> Response {
    work(&studio, move |studio| {
        let reviewer = who.reviewer.as_deref().unwrap_or(&studio.author);
        studio.at_desk(|desk| answer(desk, &key, reviewer))
    })
    .await
}

async fn add(State(studio): Shared, Path(key): Path<String>, request: HttpRequest) -> Response {
    let said: Value = match body(request).await {
        Ok(said) => said,
        Err(refusal) => return refusal.into_response(),
    };
    work(&studio, move |studio| {
        studio.at_desk(|desk| {
            let item = found(desk, &key)?;
            let mut said = said;
            if let Some(fields) = said.as_object_mut() {
                fields.insert("scenario".into(), json!(item.id));
            }
            let review: review::Review = serde_json::from_value(said)
                .map_err(|error| Refusal::unsuited(format!("the review cannot be read: {error}"), HINT))?;
            let (sent, present) = (review.content_sha256.clone(), item.content_sha256.clone());
            let reviewer = review.reviewer.name.clone();
            desk.add(&key, review).map_err(|error| match error {
                ReviewError::Voided => Refusal::Conflict {
                    conflict: json!({ "field": "content_sha256", "mine": sent, "theirs": present }),
                },
                error => refused(error),
            })?;
            answer(desk, &key, &reviewer)
        })
    })
    .await
}

/// Hint for an invalid review.
const HINT: &str = "docs/formats/reviews.md lists the fields of a review";

/// Time of a request (RFC 3339), given by the client, and the reviewer; the studio's author if `None`.
#[derive(Deserialize)]
struct Timed {
    at: String,
    reviewer: Option<String>,
}

async fn certify(State(studio): Shared, Path(key): Path<String>, request: HttpRequest) -> Response {
    let Timed { at, reviewer } = match body(request).await {
        Ok(timed) => timed,
        Err(refusal) => return refusal.into_response(),
    };
    let _turn = studio.reviews.expert.lock().await;
    work(&studio, move |studio| {
        let reviewer = reviewer.as_deref().unwrap_or(&studio.author);
        let (item, is_tried) =
            studio.at_desk(|desk| found(desk, &key).map(|item| (item.clone(), desk.trials(item).is_some())))?;
        // A repeated request after a lost response gets the trials that were already made.
        if !is_tried {
            let mut tried = Vec::new();
            let keep = |trials| {
                tried.push(trials);
                Ok(())
            };
            let never = AtomicBool::new(false);
            review::certify(&[item], &at, workers::workers(None), &NoProgress, &never, keep)?;
            for trials in tried {
                studio.at_desk(|desk| desk.log_mut().add_trials(trials).map_err(refused))?;
            }
        }
        studio.at_desk(|desk| answer(desk, &key, reviewer))
    })
    .await
}

async fn agreement(State(studio): Shared) -> Response {
    work(&studio, |studio| studio.at_desk(|desk| Ok(Json(desk.agreement()).into_response()))).await
}

async fn balance(State(studio): Shared) -> Response {
    work(&studio, |studio| studio.at_desk(|desk| Ok(Json(desk.dashboard(desk.targets())).into_response()))).await
}

/// Targets to compare the approved scenarios with.
#[derive(Deserialize)]
struct Against {
    targets: Targets,
}

async fn balance_against(State(studio): Shared, request: HttpRequest) -> Response {
    let Against { targets } = match body(request).await {
        Ok(against) => against,
        Err(refusal) => return refusal.into_response(),
    };
    work(&studio, move |studio| {
        fit(&targets)?;
        studio.at_desk(|desk| Ok(Json(desk.dashboard(&targets)).into_response()))
    })
    .await
}

fn fit(targets: &Targets) -> Result<(), Refusal> {
    review::check_targets(targets).map_err(|message| Refusal::unsuited(message, review::TARGETS_HINT))
}

/// Name of the suite to write (the name of its folder), number of scenarios per task kind, and targets of its
/// composition.
#[derive(Deserialize)]
struct Wanted {
    name: String,
    per_kind: Option<usize>,
    /// Target shares; absent for those that the studio was started with.
    targets: Option<Targets>,
}

async fn suites(State(studio): Shared) -> Response {
    work(&studio, |studio| Ok(Json(json!({ "suites": review::written_suites(studio.out()) })).into_response())).await
}

async fn build(State(studio): Shared, request: HttpRequest) -> Response {
    let Wanted { name, per_kind, targets } = match body(request).await {
        Ok(wanted) => wanted,
        Err(refusal) => return refusal.into_response(),
    };
    work(&studio, move |studio| {
        let is_plain = |letter: char| letter.is_ascii_alphanumeric() || "-_".contains(letter);
        if name.is_empty() || name.len() > 64 || !name.chars().all(is_plain) {
            let message = format!("expected a name of 1 to 64 letters, digits, - and _, got {name:?}");
            return Err(Refusal::unsuited(message, "it is the name of a folder"));
        }
        targets.iter().try_for_each(fit)?;
        let folder = studio.out().join(&name);
        studio.at_desk(|desk| {
            let targets = targets.unwrap_or_else(|| desk.targets().clone());
            let built = review::build_suite(desk, &folder, &name, per_kind, &targets)?;
            let scenarios = built.suite.scenarios.len();
            Ok(Json(json!({ "folder": folder, "scenarios": scenarios, "choice": built.choice })).into_response())
        })
    })
    .await
}

fn found<'a>(desk: &'a ReviewDesk, key: &str) -> Result<&'a Reviewable, Refusal> {
    let shown: String = key.chars().take(80).collect();
    desk.get(key).ok_or_else(|| Refusal::Unknown { message: format!("no scenario {shown}") })
}

fn answer(desk: &ReviewDesk, key: &str, reviewer: &str) -> Result<Response, Refusal> {
    found(desk, key)?;
    Ok(Json(desk.state(key, reviewer)).into_response())
}
