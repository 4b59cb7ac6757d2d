//! `genmanip assets import`: imports files into a pack and tests each object on the table and with grasps.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, PoisonError};

use crate::report::Guess;
use crate::units_and_frame::lying_from_standing;
use crate::{Given, Imported, pack};
use genmanip_assets::{Catalogue, GraspFile, GraspProvenance, ObjectGrasps, cache_grasps};
use genmanip_core::glam::DQuat;
use genmanip_core::{AssetRef, AssetUid, Document, Pose, Seed, VerifiedGrasp, World, limits};
use genmanip_data::{files, panics};
use genmanip_motion::PlannerSettings;
use genmanip_rollout::collect::in_parallel;
use genmanip_rollout::grasp_trial::{
    GraspTrials, MAX_FAILED_GRASPS, RobustnessSettings, ViewSettings, WANTED_GRASPS, robust_grasps,
};
use genmanip_workspace::text_table;
use serde::Serialize;
use serde_json::json;

use super::{AtRest, Candidate, LIST, PackEntry, PackList, at_rest, grasps_file, object_file};
use genmanip_viz::object_images::portrait;
use genmanip_workspace::Progress;
use genmanip_workspace::WorkspaceError;
use genmanip_workspace::documents;
use genmanip_workspace::worlds;
/// Rotation while settling beyond which an object counts as toppled, rad. Chosen by hand.
const TOPPLED_RAD: f64 = 0.3;
/// Maximum number of times that an object is re-imported in its resting pose. Once is nearly always enough, since the
/// new base is flattened where the object touches the table.
const MAX_TURNS: u32 = 3;
/// Maximum drift in 2 s of an object at rest, mm. Chosen by hand.
const DRIFT_MM: f64 = 1.0;
/// Side of the preview images, pixels.
const PREVIEW_PX: u32 = 256;

/// Settings of the import of objects into a pack.
#[derive(Clone, Debug)]
pub struct ImportSettings {
    /// Folder that contains the packs.
    pub folder: PathBuf,
    /// Name of the pack.
    pub pack: String,
    /// The user's choices for unit and up axis of the files.
    pub given: Given,
    /// Licence, if the files do not state one; `None` if the user gives none.
    pub licence: Option<String>,
    /// True to skip grasp trials.
    pub without_grasps: bool,
    /// Seed of the grasp trials.
    pub seed: Seed,
}

/// Result of importing one file.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ImportRow {
    /// Path of the imported file.
    pub file: String,
    /// Reason why the file was rejected; `None` if it was imported.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
    /// Advice on how to fix the error. `None` if there is none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub hint: Option<String>,
    /// Uid of the imported object; `None` if the file was rejected.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub uid: Option<AssetUid>,
    /// Name of the object.
    pub name: String,
    /// True if it stays where it is placed on the table.
    pub rests: bool,
    /// Drift in 2 s at rest, mm.
    pub drift_mm: f64,
    /// Number of convex collision pieces.
    pub pieces: usize,
    /// True if size and mass allow the gripper to hold it.
    pub can_grasp: bool,
    /// Number of grasps that held in every trial.
    pub grasps: usize,
    /// Guessed properties with the reasons.
    pub guesses: Vec<Guess>,
    /// Repairs, downscaled textures and omissions.
    pub repairs: Vec<String>,
}

/// Imports objects into a pack; files that cannot be read become rows with an error. Objects from the same files are
/// replaced.
///
/// When `stop` becomes true, objects in progress are finished and the rest is skipped.
///
/// # Errors
/// If the robot is unavailable or the pack cannot be written.
pub fn import(
    candidates: &[Candidate],
    world: &World,
    settings: &ImportSettings,
    workers: usize,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<Vec<ImportRow>, WorkspaceError> {
    let folder = settings.folder.join(&settings.pack);
    let list_path = folder.join(LIST);
    let known =
        if list_path.exists() { documents::read_document(&list_path, limits::PACK)? } else { PackList::default() };
    let trials = GraspTrials {
        catalogue: Catalogue::builtin(),
        planner: worlds::planner(world, &PlannerSettings::default())?,
        robot: worlds::robot(world)?,
        world: Arc::new(world.clone()),
        detector: None,
        view: ViewSettings::default(),
    };
    let robot = trials.robot.name.clone();
    let grasps_path = grasps_file(&folder, &robot);
    let kept = Mutex::new(PackContents {
        entries: known.objects.into_iter().map(|entry| (entry.card.uid.clone(), entry)).collect(),
        grasps: known_grasps(&grasps_path, &trials, settings.seed)?,
    });
    progress.begin("importing", candidates.len());
    let rows = in_parallel(candidates, workers, stop, &|candidate: &Candidate| {
        let (row, object) = guarded(candidate, &trials, settings);
        if let Some((object, tried)) = object {
            let uid = object.model.card.uid.clone();
            documents::write_file(&object_file(&folder, &uid), &pack::to_bytes(&object))?;
            let model = Arc::new(object.model);
            let rgb = portrait(&model, &vec![0.0; model.joint_count()], PREVIEW_PX)?;
            let preview = genmanip_render::encode::png_rgb(PREVIEW_PX, PREVIEW_PX, &rgb)
                .map_err(|error| WorkspaceError::broken("the preview cannot be encoded", error))?;
            documents::write_file(&folder.join(format!("{uid}.png")), &preview)?;
            let mut kept = kept.lock().unwrap_or_else(PoisonError::into_inner);
            if !settings.without_grasps {
                let physics_hash = model.physics_hash();
                cache_grasps(&trials.robot.physics_hash(), &physics_hash, tried.clone());
                kept.grasps.objects.insert(uid.clone(), ObjectGrasps { physics_hash, grasps: tried });
            }
            kept.entries
                .insert(uid, PackEntry { card: model.card.clone(), origin: object.origin, report: object.report });
        }
        progress.advance();
        Ok::<_, WorkspaceError>(row)
    })?;
    progress.end();
    let kept = kept.into_inner().unwrap_or_else(PoisonError::into_inner);
    if !kept.entries.is_empty() {
        if !kept.grasps.objects.is_empty() {
            documents::write_file(&grasps_path, kept.grasps.to_text().as_bytes())?;
        }
        // The index is written last, so that everything it lists is complete.
        let list = PackList { objects: kept.entries.into_values().collect() };
        documents::write_file(&list_path, list.to_json().as_bytes())?;
    }
    Ok(rows)
}

/// Entries and grasps of the pack so far.
struct PackContents {
    entries: BTreeMap<AssetUid, PackEntry>,
    grasps: GraspFile,
}

/// The pack's existing grasps, if they were tried with the same robot.
fn known_grasps(path: &Path, trials: &GraspTrials, seed: Seed) -> Result<GraspFile, WorkspaceError> {
    let made_by = GraspProvenance {
        seed,
        genmanip_version: env!("CARGO_PKG_VERSION").into(),
        engine: genmanip_sim::engine_version(),
        robot: trials.robot.name.clone(),
        robot_hash: Some(trials.robot.physics_hash()),
        settings: json!({ "trying": RobustnessSettings::fast(), "physics": trials.world.physics, "drives": trials.robot.drives }),
    };
    let nothing = GraspFile { made_by: made_by.clone(), objects: BTreeMap::new() };
    if !path.exists() {
        return Ok(nothing);
    }
    let known = crate::grasps::read(path)?;
    Ok(if known.made_by.robot_hash == made_by.robot_hash { GraspFile { made_by, ..known } } else { nothing })
}

/// Imports and tests one object; a panic costs this object only.
fn guarded(
    candidate: &Candidate,
    trials: &GraspTrials,
    settings: &ImportSettings,
) -> (ImportRow, Option<(Imported, Vec<VerifiedGrasp>)>) {
    panics::caught(|| one(candidate, trials, settings)).unwrap_or_else(|reason| {
        let row = ImportRow {
            file: candidate.root.join(&candidate.path).display().to_string(),
            error: Some(format!("{}: a defect of this program: {reason}", candidate.path)),
            hint: Some("please report it with the file; the other objects are not affected".into()),
            ..ImportRow::default()
        };
        (row, None)
    })
}

/// Imports and tests one object.
fn one(
    candidate: &Candidate,
    trials: &GraspTrials,
    settings: &ImportSettings,
) -> (ImportRow, Option<(Imported, Vec<VerifiedGrasp>)>) {
    let file = candidate.root.join(&candidate.path).display().to_string();
    let (mut object, rest) = match put_on_table(candidate, settings, &trials.world) {
        Ok(found) => found,
        Err((error, hint)) => return (ImportRow { file, error: Some(error), hint, ..ImportRow::default() }, None),
    };
    let model = Arc::new(object.model.clone());
    let mut row = ImportRow {
        file,
        uid: Some(model.card.uid.clone()),
        name: model.card.name.clone(),
        pieces: model.links.iter().map(|link| link.pieces.len()).sum(),
        can_grasp: model.card.can_grasp,
        rests: rests(&rest),
        drift_mm: rest.drift_mm,
        ..ImportRow::default()
    };
    if !row.rests {
        object.report.repairs.push("it does not stay where it is placed on a table".into());
    }
    let mut tried = Vec::new();
    if model.card.can_grasp && !settings.without_grasps {
        let AssetRef::Imported { hash } = &model.asset else { return (row, None) };
        let found = robust_grasps(
            trials,
            &model,
            &RobustnessSettings::fast(),
            WANTED_GRASPS,
            MAX_FAILED_GRASPS,
            settings.seed.fork(hash),
        );
        let because = match &found {
            Ok(found) if found.is_empty() => Some("no grasp held in every trial".to_owned()),
            Ok(_) => None,
            Err(error) => Some(format!("grasp trials failed: {error}")),
        };
        tried = found.unwrap_or_default();
        row.grasps = tried.len();
        if let Some(because) = because {
            // Grasp trials decide; the row still reports the estimate from size and mass.
            object.model.card.can_grasp = false;
            object.report.guesses.push(Guess::new(format!("can_grasp with {}", trials.robot.name), "false", because));
        }
    }
    (row.guesses, row.repairs) = (object.report.guesses.clone(), object.report.repairs.clone());
    (row, Some((object, tried)))
}

/// Imports one object and places it on the table. An object that topples and then rests is imported in its resting
/// pose, unless the user specified the up axis. Errors are a message and a hint.
fn put_on_table(
    candidate: &Candidate,
    settings: &ImportSettings,
    world: &World,
) -> Result<(Imported, AtRest), (String, Option<String>)> {
    let mut read = |path: &str, limit: limits::Limit| {
        files::read(&candidate.root.join(path), limit).map_err(|error| match error {
            genmanip_data::DataError::Io { source, .. } => source.to_string(),
            other => other.to_string(),
        })
    };
    let mut given = settings.given.clone();
    let mut turns = 0;
    loop {
        let object = crate::import(&candidate.path, &mut read, &given, settings.licence.as_deref())
            .map_err(|error| (error.to_string(), Some(error.hint).filter(|hint| !hint.is_empty())))?;
        let model = Arc::new(object.model.clone());
        let joints = model.joint_states.first().map_or_else(Vec::new, |state| state.nominal.clone());
        let rest = at_rest(&model, &Pose::IDENTITY, &joints, world).map_err(|error| {
            let hint = "fix the masses, inertias or joints in the message; pass --scale if the unit is wrong";
            let error = error.to_string().split_whitespace().collect::<Vec<_>>().join(" ");
            (format!("{}: rejected by the simulator: {error}", candidate.path), Some(hint.to_owned()))
        })?;
        // An object that rocked beyond the settling time may still be at rest at the end.
        let lies_still = rest.drift_mm < DRIFT_MM;
        if rests(&rest) || !lies_still || given.up.is_some() || turns == MAX_TURNS {
            return Ok((object, rest));
        }
        turns += 1;
        let lying_from_standing = given.tipped_up.map_or(DQuat::IDENTITY, lying_from_standing);
        given.tipped_up = Some(lying_from_standing.inverse() * rest.up);
    }
}

/// True if the object stays where it is placed.
fn rests(rest: &AtRest) -> bool {
    rest.settled && rest.tilt_rad < TOPPLED_RAD && rest.drift_mm < DRIFT_MM
}

/// Formats the rows as a table, followed by errors, guesses and repairs.
pub fn table(rows: &[ImportRow]) -> String {
    let mut lines = vec![["file", "uid", "rests", "pieces", "grasps"].map(String::from).to_vec()];
    for row in rows {
        let grasps = if row.can_grasp { row.grasps.to_string() } else { "-".into() };
        lines.push(vec![
            row.file.clone(),
            row.uid.as_ref().map_or_else(|| "rejected".into(), ToString::to_string),
            if row.rests { "yes" } else { "no" }.into(),
            row.pieces.to_string(),
            grasps,
        ]);
    }
    let mut text = text_table(&lines);
    for row in rows {
        if let Some(error) = &row.error {
            text += &format!("\n{}\n  {error}\n", row.file);
            text += &row.hint.as_ref().map_or_else(String::new, |hint| format!("  hint: {hint}\n"));
            continue;
        }
        text += &format!("\n{}\n", row.uid.as_ref().map_or("", AssetUid::as_str));
        for Guess { what, value, because } in &row.guesses {
            text += &format!("  {what}: {value} ({because})\n");
        }
        row.repairs.iter().for_each(|repair| text += &format!("  {repair}\n"));
    }
    text
}
