//! HTTP API of episodes: running a policy on a scenario, one job at a time per scenario, and playback of stored
//! episodes.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, PoisonError};

use axum::body::Body;
use axum::extract::{Path, Query, Request as HttpRequest, State};
use axum::http::header::{CACHE_CONTROL, CONTENT_SECURITY_POLICY, CONTENT_TYPE};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Json, Router};
use genmanip_benchmark::suites;
use genmanip_core::Episode;
use genmanip_data::EpisodeStore;
use genmanip_workspace::WorkspaceError;
use serde::Deserialize;
use serde_json::{Value, json};

use super::answer::{Refusal, not_found};
use super::jobs::{Job, Played, Stage};
use super::requests::{body, work};
use super::room::{Revision, Room};
use super::studio::Studio;
use crate::run::{EpisodeJob, EpisodeRow, KeptEpisode, Moments, Place, kept_episodes, playback};

/// Content security policy of a transcript's page: only its own images and styles.
const TRANSCRIPT_POLICY: &str = "default-src 'none'; img-src 'self' data:; style-src 'unsafe-inline'";

/// Routes of this module.
pub fn routes() -> Router<Arc<Studio>> {
    Router::new()
        .route("/api/policies", get(policies))
        .route("/api/scenarios/{key}/run", get(state).post(start))
        .route("/api/scenarios/{key}/run/cancel", post(cancel))
        .route("/api/scenarios/{key}/episodes", get(list))
        .route("/api/scenarios/{key}/episodes/{episode}", get(episode))
        .route("/api/scenarios/{key}/episodes/{episode}/states", get(states))
        .route("/api/scenarios/{key}/episodes/{episode}/images/{camera}", get(image))
        .route("/api/scenarios/{key}/episodes/{episode}/transcript/{file}", get(transcript))
}

type Shared = State<Arc<Studio>>;

async fn policies(State(studio): Shared) -> Json<Value> {
    Json(json!(studio.runs.offered.all()))
}

/// A policy to run.
#[derive(Deserialize)]
struct Asked {
    policy: String,
}

async fn start(State(studio): Shared, Path(key): Path<String>, request: HttpRequest) -> Response {
    let Asked { policy } = match body(request).await {
        Ok(asked) => asked,
        Err(refusal) => return refusal.into_response(),
    };
    let own = Arc::clone(&studio);
    work(&studio, move |studio| {
        check_offered(studio, &policy)?;
        let room = studio.room(&key)?;
        let now = room.revision();
        let episode = EpisodeJob {
            scenario: Arc::clone(&now.scenario),
            policy: policy.clone(),
            horizon_s: horizon_s(&room.read(|document| document.path().to_owned())),
            runs: studio.runs.folder.clone(),
        };
        let job = studio.runs.add(&key, &policy, now.number)?;
        job.change(&room, |_| {});
        let answer = Json(json!({ "run": job.now() })).into_response();
        tokio::spawn(run(own, room, job, move |stop, advance| Ok(episode.run(stop, advance)?.map(|ran| ran.place))));
        Ok(answer)
    })
    .await
}

/// Error for a policy that the studio does not offer.
pub fn check_offered(studio: &Studio, policy: &str) -> Result<(), Refusal> {
    if studio.runs.offered.has(policy) {
        return Ok(());
    }
    let offered: Vec<&str> = studio.runs.offered.all().iter().map(|one| one.policy.as_str()).collect();
    let hint = format!("it offers {}; start it with --policy for others", offered.join(", "));
    Err(Refusal::unsuited(format!("this studio does not offer the policy `{policy}`"), hint))
}

/// Time limit of a scenario in its frozen suite, simulated s; `None` if it is in no suite.
fn horizon_s(file: &std::path::Path) -> Option<f64> {
    let id = file.file_stem()?.to_string_lossy();
    let folder = file.parent().filter(|folder| folder.ends_with("scenarios"))?.parent()?;
    let entries = folder.join("suite.json").is_file().then(|| suites::open(folder).ok()).flatten()?.scenarios;
    entries.into_iter().find(|entry| entry.id == id).map(|entry| entry.horizon_s)
}

/// Runs a job as soon as a permit is free, unless it was cancelled before. `compute` takes the job's stop flag and a
/// callback for the simulated time (s), and returns the place of the stored episode, or `None` if none was stored.
pub async fn run<F>(studio: Arc<Studio>, room: Arc<Room>, job: Arc<Job>, compute: F)
where
    F: FnOnce(&Arc<AtomicBool>, Box<dyn Fn(f64) + Send + Sync>) -> Result<Option<Place>, WorkspaceError>
        + Send
        + 'static,
{
    let shared = Arc::clone(&studio);
    let Ok(_turn) = shared.runs.turns.acquire().await else { return };
    if job.stop.load(Ordering::Relaxed) {
        return job.change(&room, |run| run.state = Stage::Cancelled);
    }
    job.change(&room, |run| run.state = Stage::Running);
    let (own, own_room) = (Arc::clone(&job), Arc::clone(&room));
    let computed = tokio::task::spawn_blocking(move || {
        let (advancing, advancing_room) = (Arc::clone(&own), Arc::clone(&own_room));
        let advance = move |time_s| advancing.advance(&advancing_room, time_s);
        let Some(place) = compute(&own.stop, Box::new(advance))? else { return Ok(None) };
        let row = episodes(&studio, &own_room).into_iter().find(|kept| kept.place == place);
        Ok::<_, WorkspaceError>(row.and_then(|kept| kept.row()))
    })
    .await;
    job.change(&room, |run| match computed {
        Ok(Ok(Some(row))) => {
            (run.state, run.time_s, run.episode) = (Stage::Done, row.duration_s, Some(row));
        }
        Ok(Ok(None)) => run.state = Stage::Cancelled,
        Ok(Err(_)) if job.stop.load(Ordering::Relaxed) => run.state = Stage::Cancelled,
        Ok(Err(error)) => (run.state, run.error) = (Stage::Failed, Some(Refusal::from(error).error())),
        Err(_) => {
            let error = json!({ "message": "the episode panicked; please report this bug", "hint": "" });
            (run.state, run.error) = (Stage::Failed, Some(error));
        }
    });
}

async fn cancel(State(studio): Shared, Path(key): Path<String>) -> Response {
    work(&studio, move |studio| {
        let job = studio.runs.newest(&key).filter(|job| !job.is_over());
        let Some(job) = job else {
            return Err(Refusal::unsuited("no episode of this scenario is under way", ""));
        };
        job.stop.store(true, Ordering::Relaxed);
        Ok(Json(json!({ "run": job.now() })).into_response())
    })
    .await
}

async fn state(State(studio): Shared, Path(key): Path<String>) -> Response {
    work(&studio, move |studio| {
        studio.room(&key)?;
        let job = studio.runs.newest(&key).map(|job| job.now());
        Ok(Json(json!({ "run": job })).into_response())
    })
    .await
}

async fn list(State(studio): Shared, Path(key): Path<String>) -> Response {
    work(&studio, move |studio| {
        let rows: Vec<EpisodeRow> =
            episodes(studio, &*studio.room(&key)?).iter().filter_map(KeptEpisode::row).collect();
        Ok(Json(rows).into_response())
    })
    .await
}

/// Stored episodes of a scenario, at all of its revisions.
fn episodes(studio: &Studio, room: &Room) -> Vec<KeptEpisode> {
    let (file, id, hashes) =
        room.read(|document| (document.path().to_owned(), document.scenario().id.clone(), document.hashes()));
    kept_episodes(&file, &id, &hashes, &studio.runs.folder)
}

/// Stored episode of a scenario, by the key in its row.
fn find(studio: &Studio, room: &Room, episode: &str) -> Result<KeptEpisode, Refusal> {
    let mut kept = episodes(studio, room).into_iter();
    let shown = || episode.chars().take(40).collect::<String>();
    kept.find(|kept| kept.place.key() == episode)
        .ok_or_else(|| Refusal::Unknown { message: format!("no episode {} of this scenario", shown()) })
}

fn read(kept: &KeptEpisode) -> Result<Episode, Refusal> {
    let unreadable = |error| WorkspaceError::broken(format!("cannot read episode {}", kept.place.id), error);
    EpisodeStore::open(&kept.place.store)
        .and_then(|store| store.read(&kept.place.id))
        .map_err(|error| Refusal::from(unreadable(error)))
}

/// Scenario of an episode as a revision for display, with number 0.
fn revision_of(episode: &Episode) -> Revision {
    Revision { number: 0, scenario: Arc::new(episode.scenario.clone()) }
}

async fn episode(State(studio): Shared, Path((key, episode)): Path<(String, String)>) -> Response {
    work(&studio, move |studio| {
        let room = studio.room(&key)?;
        let kept = find(studio, &room, &episode)?;
        let row = kept.row();
        let episode = read_once(studio, &key, &episode, || Ok(kept))?;
        let scene = studio.scene_at(&room, &revision_of(&episode))?;
        let message = json!({
            "episode": row, "result": &episode.result, "timeline": Moments::of(&episode), "scene": scene,
        });
        Ok(Json(message).into_response())
    })
    .await
}

async fn states(State(studio): Shared, Path((key, episode)): Path<(String, String)>) -> Response {
    work(&studio, move |studio| {
        let room = studio.room(&key)?;
        let episode = played(studio, &key, &episode)?;
        let now = revision_of(&episode);
        let scene = studio.scene_at(&room, &now)?;
        let models = studio.models(&now.scenario)?;
        let robot = studio.scenes.robot(&now.scenario.world)?;
        let track = playback::track(&episode, &scene, &robot, &models);
        let head = [
            (CONTENT_TYPE, "application/octet-stream".to_owned()),
            (axum::http::HeaderName::from_static("x-frames"), track.frames.to_string()),
            (axum::http::HeaderName::from_static("x-width"), track.width.to_string()),
        ];
        Ok((head, Body::from(track.to_bytes())).into_response())
    })
    .await
}

/// State of an episode, by its index among those of `…/states`.
#[derive(Deserialize)]
struct AtState {
    #[serde(default)]
    state: usize,
}

async fn image(
    State(studio): Shared,
    Path((key, episode, camera)): Path<(String, String, String)>,
    Query(at): Query<AtState>,
) -> Response {
    work(&studio, move |studio| {
        let episode = played(studio, &key, &episode)?;
        let Some(frame) = playback::states(&episode).nth(at.state) else {
            return Err(Refusal::Unknown { message: format!("the episode has no state {}", at.state) });
        };
        // A painter of its own: that of the scenario continues its last image.
        let jpeg = studio.state_image(&format!("{key} played"), &episode, &camera, frame)?;
        Ok(([(CONTENT_TYPE, "image/jpeg"), (CACHE_CONTROL, "no-store")], Body::from(jpeg)).into_response())
    })
    .await
}

/// An episode for playback.
fn played(studio: &Studio, key: &str, name: &str) -> Result<Arc<Episode>, Refusal> {
    read_once(studio, key, name, || find(studio, &*studio.room(key)?, name))
}

/// An episode, kept until another one is read: its result, its states and images of them are requested one after the
/// other. The lock is held while it is read, since the page requests result and states at the same time.
fn read_once(
    studio: &Studio,
    key: &str,
    name: &str,
    find: impl FnOnce() -> Result<KeptEpisode, Refusal>,
) -> Result<Arc<Episode>, Refusal> {
    let mut kept = studio.runs.played.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(played) = kept.as_ref().filter(|played| played.scenario == key && played.name == name) {
        return Ok(Arc::clone(&played.episode));
    }
    let episode = Arc::new(read(&find()?)?);
    *kept = Some(Played { scenario: key.to_owned(), name: name.to_owned(), episode: Arc::clone(&episode) });
    Ok(episode)
}

async fn transcript(State(studio): Shared, Path((key, episode, file)): Path<(String, String, String)>) -> Response {
    work(&studio, move |studio| {
        let room = studio.room(&key)?;
        let kept = find(studio, &room, &episode)?;
        Ok(match kept.transcript_file(&file) {
            Some((bytes, kind)) => {
                let head = [(CONTENT_TYPE, kind), (CONTENT_SECURITY_POLICY, TRANSCRIPT_POLICY)];
                (head, Body::from(bytes)).into_response()
            }
            None => not_found("the transcript has no such file"),
        })
    })
    .await
}
