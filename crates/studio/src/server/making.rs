//! HTTP API for new scenarios from a sentence, camera presets, and the world of a scenario as a file.

use std::collections::BTreeMap;
use std::sync::Arc;

use axum::extract::{Path, Query, Request as HttpRequest, State};
use axum::http::header::{CONTENT_DISPOSITION, CONTENT_TYPE};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Json, Router};
use genmanip_core::camera::PRESETS;
use genmanip_core::names::fits_file_name;
use genmanip_core::sensor::SENSORS;
use genmanip_core::{AssetUid, Document};
use serde::Deserialize;
use serde_json::{Value, json};

use super::requests::{body, work};
use super::studio::Studio;
use crate::new_scenario;

/// Routes of this module.
pub fn routes() -> Router<Arc<Studio>> {
    Router::new()
        .route("/api/cameras", get(cameras))
        .route("/api/sentences", post(sentence))
        .route("/api/scenarios/{key}/world", get(world))
}

type Shared = State<Arc<Studio>>;

/// Presets of commercial cameras and sensors.
async fn cameras() -> Json<Value> {
    let presets = PRESETS
        .iter()
        .map(|preset| json!({ "name": preset.name, "about": preset.what, "intrinsics": preset.intrinsics() }));
    let sensors =
        SENSORS.iter().map(|preset| json!({ "name": preset.name, "about": preset.what, "sensor": preset.sensor }));
    Json(json!({ "presets": presets.collect::<Vec<_>>(), "sensors": sensors.collect::<Vec<_>>() }))
}

/// A sentence, with the chosen uid of each ambiguous phrase.
#[derive(Deserialize)]
struct Said {
    text: String,
    #[serde(default)]
    choices: BTreeMap<String, AssetUid>,
}

async fn sentence(State(studio): Shared, request: HttpRequest) -> Response {
    let Said { text, .. } = match body(request).await {
        Ok(said) => said,
        Err(refusal) => return refusal.into_response(),
    };
    work(&studio, move |_| {
        let phrases = new_scenario::choices(&text)?;
        Ok(Json(json!({ "phrases": phrases })).into_response())
    })
    .await
}

/// Creates a scenario from a sentence and returns its key.
pub async fn create(State(studio): Shared, request: HttpRequest) -> Response {
    let Said { text, choices } = match body(request).await {
        Ok(said) => said,
        Err(refusal) => return refusal.into_response(),
    };
    work(&studio, move |studio| {
        let key = studio.create(|folder| new_scenario::create(&text, &choices, folder))?;
        Ok(Json(json!({ "key": key })).into_response())
    })
    .await
}

/// Revision whose world is requested; the newest if `None`.
#[derive(Deserialize)]
struct AtRevision {
    revision: Option<u64>,
}

async fn world(State(studio): Shared, Path(key): Path<String>, Query(at): Query<AtRevision>) -> Response {
    work(&studio, move |studio| {
        let room = studio.room(&key)?;
        let scenario = match at.revision {
            Some(revision) => room.read(|document| document.at_revision(revision))?,
            None => room.revision().scenario,
        };
        let id: String = scenario.id.chars().filter(|&letter| fits_file_name(letter)).collect();
        let head = [
            (CONTENT_TYPE, "application/json".to_owned()),
            (CONTENT_DISPOSITION, format!("attachment; filename=\"{id}-world.json\"")),
        ];
        Ok((head, scenario.world.to_json()).into_response())
    })
    .await
}
