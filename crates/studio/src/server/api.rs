//! HTTP API for scenarios: reading, editing, verdicts, repairs, settling and camera images; and for the catalogue and
//! meshes.

use std::sync::Arc;

use axum::body::Body;
use axum::extract::{Path, Query, Request as HttpRequest, State};
use axum::http::header::{CACHE_CONTROL, CONTENT_TYPE, HeaderName};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Json, Router};
use genmanip_core::{AssetUid, InstanceId, Pose, ReferenceId, Scenario};
use genmanip_workspace::WorkspaceError;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};

use super::answer::{Refusal, not_found};
use super::making;
use super::requests::{body, work};
use super::room::{Request, Revision};
use super::studio::Studio;
use crate::edit::{Command, Placement, Stamp};
use crate::scene::settling::settle;
use crate::verdict::{Inspection, ProblemCode, Stage};

/// Default of the maximum number of search results.
const FOUND: usize = 40;
/// Displacement below which an object that was not dropped itself keeps its pose, m.
const NUDGE_M: f64 = 0.002;

/// Routes of this module; unknown paths below `/api` are answered with status 404.
pub fn routes() -> Router<Arc<Studio>> {
    Router::new()
        .route("/api/session", get(session))
        .route("/api/scenarios", get(list).post(making::create))
        .route("/api/scenarios/{key}", get(scene))
        .route("/api/scenarios/{key}/commands", post(command))
        .route("/api/scenarios/{key}/undo", post(undo))
        .route("/api/scenarios/{key}/redo", post(redo))
        .route("/api/scenarios/{key}/revert", post(revert))
        .route("/api/scenarios/{key}/history", get(history))
        .route("/api/scenarios/{key}/difference", get(difference))
        .route("/api/scenarios/{key}/snapshots", post(snapshot))
        .route("/api/scenarios/{key}/verdict", get(verdict))
        .route("/api/scenarios/{key}/repairs", post(repairs))
        .route("/api/scenarios/{key}/settle", post(drop_objects))
        .route("/api/scenarios/{key}/images/{camera}", get(image))
        .route("/api/catalogue", get(search))
        .route("/api/catalogue/{uid}/thumbnail", get(thumbnail))
        .route("/meshes/{file}", get(mesh))
        .route("/api/{*path}", get(unknown).post(unknown))
}

type Shared = State<Arc<Studio>>;

async fn session(State(studio): Shared) -> Json<Value> {
    Json(json!({
        "version": env!("CARGO_PKG_VERSION"), "author": studio.author, "needs_token": studio.token.is_some(),
        "asks": studio.questions.is_some(),
    }))
}

async fn list(State(studio): Shared) -> Response {
    work(&studio, |studio| Ok(Json(studio.list()).into_response())).await
}

/// Author who reads a scenario, and revision to read; the newest if `None`.
#[derive(Deserialize)]
struct Reader {
    author: Option<String>,
    revision: Option<u64>,
}

async fn scene(State(studio): Shared, Path(key): Path<String>, Query(reader): Query<Reader>) -> Response {
    work(&studio, move |studio| {
        let author = reader.author.as_deref().unwrap_or(&studio.author);
        let room = studio.room(&key)?;
        if let Some(number) = reader.revision {
            let scenario = room.read(|document| document.at_revision(number))?;
            return Ok(Json(studio.scene_at(&room, &Revision { number, scenario })?).into_response());
        }
        Ok(Json(studio.scene(&room, author)?).into_response())
    })
    .await
}

async fn command(State(studio): Shared, Path(key): Path<String>, request: HttpRequest) -> Response {
    change(&studio, key, request, |command: Command| Request::Command(Box::new(command))).await
}

async fn undo(State(studio): Shared, Path(key): Path<String>, request: HttpRequest) -> Response {
    change(&studio, key, request, Request::Undo).await
}

async fn redo(State(studio): Shared, Path(key): Path<String>, request: HttpRequest) -> Response {
    change(&studio, key, request, Request::Redo).await
}

/// Revision whose command is to be reverted, with author, time and id of the request.
#[derive(Deserialize)]
struct Reverted {
    revision: u64,
    #[serde(flatten)]
    stamp: Stamp,
}

async fn revert(State(studio): Shared, Path(key): Path<String>, request: HttpRequest) -> Response {
    change(&studio, key, request, |one: Reverted| Request::Revert(one.revision, one.stamp)).await
}

async fn change<T: DeserializeOwned>(
    studio: &Arc<Studio>,
    key: String,
    request: HttpRequest,
    read: impl FnOnce(T) -> Request,
) -> Response {
    let request = match body(request).await {
        Ok(body) => read(body),
        Err(refusal) => return refusal.into_response(),
    };
    work(studio, move |studio| {
        let changed = studio.change(&key, &request)?;
        let state = changed.steps.complete(&changed.state, &request.stamp().author);
        Ok(Json(json!({ "state": state })).into_response())
    })
    .await
}

async fn history(State(studio): Shared, Path(key): Path<String>) -> Response {
    work(&studio, move |studio| {
        let lines: Vec<Value> = studio.room(&key)?.read(|document| {
            let commands = document.history().map(|line| (line.revision, serde_json::to_value(line)));
            let snapshots = document.snapshots().iter().map(|named| (named.revision, serde_json::to_value(named)));
            let mut lines: Vec<_> = commands.chain(snapshots).collect();
            // The sort is stable: a snapshot stays behind the command that made its revision.
            lines.sort_by_key(|(revision, _)| *revision);
            lines.into_iter().filter_map(|(_, line)| line.ok()).collect()
        });
        Ok(Json(lines).into_response())
    })
    .await
}

/// Two revisions to compare; `to` is the newest if `None`.
#[derive(Deserialize)]
struct Between {
    from: u64,
    to: Option<u64>,
}

async fn difference(State(studio): Shared, Path(key): Path<String>, Query(between): Query<Between>) -> Response {
    work(&studio, move |studio| {
        let found = studio
            .room(&key)?
            .read(|document| document.difference(between.from, between.to.unwrap_or_else(|| document.revision())));
        Ok(Json(found?).into_response())
    })
    .await
}

/// Name for the newest revision. Without an operation id, one is made of name and time, so that a repeated request has
/// no further effect.
#[derive(Deserialize)]
struct Named {
    name: String,
    author: String,
    at: String,
    client_operation_id: Option<String>,
}

async fn snapshot(State(studio): Shared, Path(key): Path<String>, request: HttpRequest) -> Response {
    let Named { name, author, at, client_operation_id } = match body(request).await {
        Ok(named) => named,
        Err(refusal) => return refusal.into_response(),
    };
    work(&studio, move |studio| {
        let id = client_operation_id.unwrap_or_else(|| format!("snapshot {name} {at}"));
        let room = studio.room(&key)?;
        if room.copies.is_some() {
            return Err(Refusal::unsuited("this scenario is read-only", "edit it first: the first edit makes a copy"));
        }
        room.snapshot(&name, &Stamp { client_operation_id: id, author, at })?;
        Ok(Json(json!({ "snapshot": name, "revision": room.revision().number })).into_response())
    })
    .await
}

async fn verdict(State(studio): Shared, Path(key): Path<String>) -> Response {
    work(&studio, move |studio| {
        let now = studio.room(&key)?.revision();
        let mut problems = Vec::new();
        studio.judge(&now, &Stage::ALL, |found| {
            problems.extend(found.into_iter().flat_map(|found| found.problems));
            true
        })?;
        Ok(Json(json!({ "revision": now.number, "problems": problems })).into_response())
    })
    .await
}

/// Problem for which repairs are requested; without `other`, it matches a problem with any other object.
#[derive(Deserialize)]
struct Asked {
    stage: Stage,
    code: ProblemCode,
    object: Option<ReferenceId>,
    other: Option<ReferenceId>,
}

async fn repairs(State(studio): Shared, Path(key): Path<String>, request: HttpRequest) -> Response {
    let asked: Asked = match body(request).await {
        Ok(asked) => asked,
        Err(refusal) => return refusal.into_response(),
    };
    work(&studio, move |studio| {
        let now = studio.room(&key)?.revision();
        let equipment = studio.equipment(&now.scenario.world)?;
        let mut inspection = Inspection::new(Arc::clone(&now.scenario), &equipment);
        let problems = inspection.problems(asked.stage)?;
        let is_meant = |problem: &&crate::verdict::Problem| {
            let other = asked.other.is_none() || problem.other == asked.other;
            problem.code == asked.code && problem.object == asked.object && other
        };
        let repairs = match problems.iter().find(is_meant) {
            Some(problem) => inspection.repairs(problem)?,
            None => Vec::new(),
        };
        Ok(Json(json!({ "revision": now.number, "repairs": repairs })).into_response())
    })
    .await
}

/// Objects to drop in simulation, each from its present or from another pose; an empty list drops all objects.
#[derive(Deserialize)]
struct Dropped {
    #[serde(default)]
    objects: Vec<OneDropped>,
}

/// An object to drop.
#[derive(Deserialize)]
#[serde(untagged)]
enum OneDropped {
    /// Id of an object that is dropped from its present pose.
    Here(InstanceId),
    /// An object that is dropped from another pose.
    There(Placement),
}

async fn drop_objects(State(studio): Shared, Path(key): Path<String>, request: HttpRequest) -> Response {
    let dropped: Dropped = match body(request).await {
        Ok(dropped) => dropped,
        Err(refusal) => return refusal.into_response(),
    };
    work(&studio, move |studio| {
        let now = studio.room(&key)?.revision();
        let mut scenario = Scenario::clone(&now.scenario);
        let mut asked = Vec::new();
        for one in dropped.objects {
            let (id, pose) = match one {
                OneDropped::Here(id) => (id, None),
                OneDropped::There(placement) => (placement.id, Some((placement.pose, placement.joint_positions))),
            };
            let Some(index) = scenario.index_of(&id) else {
                return Err(Refusal::unsuited(format!("no object {id:?} in the scene"), "it may have been removed"));
            };
            if let Some((pose, joint_positions)) = pose {
                let object = &mut scenario.objects[index];
                object.pose = pose;
                // Joint positions are ignored if their number does not fit the object.
                let fits = |joints: &Vec<f64>| joints.len() == object.joint_positions.len();
                if let Some(joints) = joint_positions.filter(fits) {
                    object.joint_positions = joints;
                }
            }
            asked.push(index);
        }
        let models = studio.models(&scenario)?;
        let broken = |error| Refusal::from(WorkspaceError::broken("the objects cannot be dropped", error));
        let (moved, settled) = settle(&scenario, &models).map_err(broken)?;
        let before = |index: usize| scenario.objects[index].pose.position;
        let mut placed: Vec<(usize, Pose, Vec<f64>)> = moved
            .into_iter()
            .filter(|own| {
                asked.is_empty()
                    || asked.contains(&own.object)
                    || own.pose.position.distance(before(own.object)) > NUDGE_M
            })
            .map(|own| (own.object, own.pose, own.joint_positions))
            .collect();
        for &index in &asked {
            if !placed.iter().any(|(known, ..)| *known == index) {
                let object = &scenario.objects[index];
                placed.push((index, object.pose, object.joint_positions.clone()));
            }
        }
        let objects: Vec<Placement> = placed
            .into_iter()
            .map(|(index, pose, joints)| Placement {
                id: scenario.objects[index].id.clone(),
                pose,
                joint_positions: (!joints.is_empty()).then_some(joints),
            })
            .collect();
        Ok(Json(json!({ "op": "place", "args": { "objects": objects }, "settled": settled })).into_response())
    })
    .await
}

/// Revision that a camera image shows; the newest if `None`.
#[derive(Deserialize)]
struct AtRevision {
    revision: Option<u64>,
}

async fn image(
    State(studio): Shared,
    Path((key, camera)): Path<(String, String)>,
    Query(at): Query<AtRevision>,
) -> Response {
    work(&studio, move |studio| {
        let room = studio.room(&key)?;
        let now = room.revision();
        let (number, scenario) = match at.revision.filter(|&revision| revision != now.number) {
            Some(revision) => (revision, room.read(|document| document.at_revision(revision))?),
            None => (now.number, now.scenario),
        };
        let image = studio.image(&key, &scenario, &camera)?;
        let head = [
            (CONTENT_TYPE, "image/jpeg".to_owned()),
            (CACHE_CONTROL, "no-store".to_owned()),
            (HeaderName::from_static("x-visible-shares"), ascii_json(&image.visible_shares)),
            (HeaderName::from_static("x-revision"), number.to_string()),
        ];
        Ok((head, Body::from(image.jpeg)).into_response())
    })
    .await
}

/// JSON that fits into an HTTP header: characters outside ASCII as `\u` escapes.
fn ascii_json(value: &impl serde::Serialize) -> String {
    let text = serde_json::to_string(value).unwrap_or_default();
    let escaped = |letter: char| -> String {
        let mut units = [0; 2];
        match letter.is_ascii() {
            true => letter.to_string(),
            false => letter.encode_utf16(&mut units).iter().map(|unit| format!("\\u{unit:04x}")).collect(),
        }
    };
    text.chars().map(escaped).collect()
}

/// Query and filters of a catalogue search.
#[derive(Deserialize)]
struct Searched {
    #[serde(default)]
    query: String,
    graspable: Option<bool>,
    limit: Option<usize>,
}

async fn search(State(studio): Shared, Query(asked): Query<Searched>) -> Response {
    work(&studio, move |studio| {
        let limit = asked.limit.unwrap_or(FOUND);
        Ok(Json(studio.catalogue.find(&asked.query, asked.graspable, limit)).into_response())
    })
    .await
}

async fn thumbnail(State(studio): Shared, Path(uid): Path<AssetUid>) -> Response {
    work(&studio, move |studio| match studio.catalogue.thumbnail(&uid)? {
        Some(jpeg) => {
            let head = [(CONTENT_TYPE, "image/jpeg"), (CACHE_CONTROL, "max-age=86400")];
            Ok((head, Body::from(jpeg.to_vec())).into_response())
        }
        None => Ok(not_found("no such object in the catalogue")),
    })
    .await
}

async fn mesh(State(studio): Shared, Path(file): Path<String>) -> Response {
    work(&studio, move |studio| {
        let glb = file.strip_suffix(".glb").and_then(|hash| studio.scenes.meshes.file(hash));
        let head = [(CONTENT_TYPE, "model/gltf-binary"), (CACHE_CONTROL, "public, max-age=31536000, immutable")];
        Ok(match glb {
            Some(glb) => (head, Body::from(glb.to_vec())).into_response(),
            None => not_found("no such mesh; open its scenario again"),
        })
    })
    .await
}

async fn unknown() -> Response {
    not_found("no such operation; docs/guides/studio.md lists them")
}
