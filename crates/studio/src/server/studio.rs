//! State shared by all requests: the collection, the open rooms, and everything needed to render and judge scenarios.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use genmanip_assets::Catalogue;
use genmanip_core::{Episode, Frame, ObjectModel, Scenario, World};
use genmanip_llm::FolderAnswers;
use genmanip_workspace::WorkspaceError;
use genmanip_workspace::scenarios::read_scenario;
use serde_json::{Value, json};
use tokio::sync::Semaphore;

use super::access::Token;
use super::answer::Refusal;
use super::catalogue::CatalogueSearch;
use super::jobs::Runs;
use super::review_desk::Reviews;
use super::room::{Request, Revision, Room, StageVerdict, Steps};
use super::settings::StudioSettings;
use crate::collections::{Collection, Listed, Summary};
use crate::edit::{EditLog, EditedScenario};
use crate::review::{ReviewDesk, ReviewInputs, read_desk};
use crate::scene::exported::models;
use crate::scene::images::{CameraImage, Drawn, Painters};
use crate::scene::scene_message::{SceneAssets, SceneMessage};
use crate::teleop::Sessions;
use crate::verdict::{Equipment, EquipmentCache, Inspection, Stage};

/// State shared by all requests.
pub struct Studio {
    /// Author of requests that give no name.
    pub author: String,
    /// Secret that requests must contain; `None` if anybody may use the studio.
    pub token: Option<Token>,
    /// Search index of the catalogue.
    pub catalogue: CatalogueSearch,
    /// Caches of robot models, meshes and shapes for all scenes.
    pub scenes: SceneAssets,
    /// Limits the number of simultaneous computations.
    pub permits: Semaphore,
    /// Reviews of the scenarios.
    pub reviews: Reviews,
    review_inputs: ReviewInputs,
    /// Episodes that are running or have ended.
    pub runs: Runs,
    /// Scenarios that people teleoperate.
    pub teleoperations: Sessions,
    /// Questions that people answer in place of a model; `None` if the studio offers none.
    pub questions: Option<FolderAnswers>,
    out: PathBuf,
    collection: Mutex<Collection>,
    rooms: Mutex<BTreeMap<String, Arc<Room>>>,
    /// Lock held while a scenario is created, so that only one is at a time.
    creating: Mutex<()>,
    painters: Painters,
    equipment: EquipmentCache,
}

/// A change that was applied.
pub struct Changed {
    /// Room of the scenario, or of its copy if the scenario is read-only.
    pub room: Arc<Room>,
    /// State of the scenario, without the fields that depend on the author.
    pub state: Arc<Value>,
    /// For each author, if undo and redo are possible.
    pub steps: Arc<Steps>,
}

impl Studio {
    /// A studio for a collection; copies of read-only scenarios are written below `out` of the settings.
    pub fn new(collection: Collection, settings: StudioSettings) -> Self {
        let StudioSettings { address: _, out, author, token, policies, questions, review } = settings;
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        Self {
            author,
            token,
            catalogue: CatalogueSearch::default(),
            scenes: SceneAssets::default(),
            permits: Semaphore::new(cores + 1), // one more than cores, for an image while each core judges a stage
            reviews: Reviews::default(),
            review_inputs: review,
            runs: Runs::new(out.join("runs"), policies),
            teleoperations: Sessions::default(),
            questions: questions.map(FolderAnswers::new),
            out,
            collection: Mutex::new(collection),
            rooms: Mutex::default(),
            creating: Mutex::default(),
            painters: Painters::default(),
            equipment: EquipmentCache::default(),
        }
    }

    /// Folder for copies, new scenarios, built suites, the log of reviews, and episodes.
    pub fn out(&self) -> &Path {
        &self.out
    }

    /// Runs `work` on the review desk after updating it with the scenarios and the log of reviews.
    ///
    /// # Errors
    /// When the log of reviews or a suite's file is damaged, and any error of `work`.
    pub fn at_desk<T>(&self, work: impl FnOnce(&mut ReviewDesk) -> Result<T, Refusal>) -> Result<T, Refusal> {
        let edited = self.edited();
        let listed: Vec<Listed> = self.lock_collection().iter().cloned().collect();
        let read = || {
            let (mut desk, _) = read_desk(&self.lock_collection(), &self.out)?;
            desk.set_inputs(self.review_inputs.clone());
            Ok(desk)
        };
        self.reviews.at_desk(&listed, &edited, read, work)
    }

    /// Rooms of all scenarios with a log of edits, opened if necessary.
    fn edited(&self) -> Vec<(Listed, Arc<Room>)> {
        let edited: Vec<Listed> = {
            let collection = self.lock_collection();
            collection.iter().filter(|listed| EditLog::path_of(&listed.path).is_file()).cloned().collect()
        };
        // Scenarios with an unreadable log are skipped here; the error is reported when they are opened.
        edited.into_iter().filter_map(|listed| self.room(&listed.key).ok().map(|room| (listed, room))).collect()
    }

    /// Rows of all scenarios as JSON, for the page's list.
    pub fn list(&self) -> Value {
        drop(self.edited());
        let open: BTreeMap<String, Arc<Room>> = self.lock_rooms().clone();
        let collection = self.lock_collection();
        let row = |listed: &crate::collections::Listed| {
            let now = open.get(&listed.key).map(|room| room.revision());
            let summary = now.as_ref().map_or_else(|| listed.summary.clone(), |now| Summary::of(&now.scenario));
            json!({
                "key": listed.key, "id": summary.id, "kind": summary.kind, "instruction": summary.instruction,
                "source": listed.source, "read_only": listed.copies.is_some(), "objects": summary.objects,
                "revision": now.map_or(0, |now| now.number),
            })
        };
        collection.iter().map(row).collect()
    }

    /// Room of the scenario with this key, opened if necessary.
    ///
    /// # Errors
    /// [`Refusal::Unknown`] for an unknown key, and when the scenario's file or log cannot be read.
    pub fn room(&self, key: &str) -> Result<Arc<Room>, Refusal> {
        let mut rooms = self.lock_rooms();
        if let Some(room) = rooms.get(key) {
            return Ok(Arc::clone(room));
        }
        let collection = self.lock_collection();
        let Some(listed) = collection.get(key) else {
            let shown: String = key.chars().take(80).collect();
            return Err(Refusal::Unknown { message: format!("no scenario {shown}") });
        };
        let document = EditedScenario::open(&listed.path, Catalogue::all())?;
        let parent = document.parent().and_then(|parent| collection.key_of(parent.path.as_ref()));
        let room = Room::new(key.to_owned(), listed.source.clone(), listed.copies.clone(), parent, document);
        let room = Arc::new(room);
        rooms.insert(key.to_owned(), Arc::clone(&room));
        Ok(room)
    }

    /// Room in which a scenario is edited: its own, or that of its copy if it is read-only. The copy is made on the
    /// first edit.
    fn editable(&self, key: &str) -> Result<Arc<Room>, Refusal> {
        let room = self.room(key)?;
        let Some(folder) = &room.copies else { return Ok(room) };
        // Under the lock, so that two simultaneous first edits use the same copy.
        let copy = {
            let mut collection = self.lock_collection();
            let path = collection.get(key).map(|listed| listed.path.clone()).unwrap_or_default();
            let folder = self.out.join(folder);
            let place = folder.join(path.file_name().unwrap_or_default());
            let document = if place.is_file() {
                EditedScenario::open(&place, Catalogue::all())?
            } else {
                let unwritable = |error| WorkspaceError::file("write", &folder, error).with_hint("name another --out");
                std::fs::create_dir_all(&folder).map_err(unwritable)?;
                EditedScenario::copy_into(&path, &folder, Catalogue::all())?
            };
            collection.add(&place, "studio", None, document.scenario())
        };
        self.room(&copy)
    }

    /// Adds a scenario that `make` writes into the studio's folder, and returns its key; one call at a time.
    ///
    /// # Errors
    /// Those of `make`, and when the written file cannot be read.
    pub fn create(&self, make: impl FnOnce(&Path) -> Result<PathBuf, WorkspaceError>) -> Result<String, Refusal> {
        let _alone = self.creating.lock().unwrap_or_else(PoisonError::into_inner);
        let file = make(&self.out)?;
        let scenario = read_scenario(&file)?;
        Ok(self.lock_collection().add(&file, "studio", None, &scenario))
    }

    /// Scene message of a scenario's newest revision as JSON, with the undo and redo flags of `author`.
    ///
    /// # Errors
    /// When an object is unknown, the robot cannot be loaded, or a mesh cannot be made.
    pub fn scene(&self, room: &Room, author: &str) -> Result<Value, Refusal> {
        let mut message = self.scene_at(room, &room.revision())?;
        (message.state.can_undo, message.state.can_redo) = room.steps(author);
        serde_json::to_value(&message).map_err(|error| Refusal::of_error(&error))
    }

    /// Scene message of a revision; undo and redo flags, which depend on the author, are false.
    ///
    /// # Errors
    /// As [`Studio::scene`].
    pub fn scene_at(&self, room: &Room, now: &Revision) -> Result<SceneMessage, Refusal> {
        let (surfaces, robot) = self.scenes.fixed(&now.scenario.world)?;
        Ok(SceneMessage {
            key: room.key.clone(),
            id: now.scenario.id.clone(),
            read_only: room.copies.is_some(),
            source: room.source.clone(),
            parent: room.parent.clone(),
            revision: now.number,
            state: self.state(&room.key, now)?,
            surfaces,
            workspace: now.scenario.world.workspace,
            robot,
        })
    }

    fn state(&self, key: &str, now: &Revision) -> Result<crate::scene::scene_message::SceneState, Refusal> {
        let models = self.models(&now.scenario)?;
        self.scenes.state(key, &now.scenario, &models, now.number).map_err(Refusal::from)
    }

    /// Applies a change to a scenario, or to the copy of a read-only one; all its tabs get the new state.
    ///
    /// # Errors
    /// When the scenario cannot be opened or copied, and as [`Room::change`].
    pub fn change(&self, key: &str, request: &Request) -> Result<Changed, Refusal> {
        let room = self.editable(key)?;
        let describe = |now: &Revision| {
            let state = self.state(&room.key, now)?;
            serde_json::to_value(&state).map_err(|error| Refusal::of_error(&error))
        };
        let (state, steps) = room.change(request, describe)?;
        Ok(Changed { room, state, steps })
    }

    /// Models of a scenario's objects, in the order of the objects.
    ///
    /// # Errors
    /// When an object is unknown or has changed.
    pub fn models(&self, scenario: &Scenario) -> Result<Vec<Arc<ObjectModel>>, Refusal> {
        models(scenario, Catalogue::all()).map_err(Refusal::from)
    }

    /// Image of the named camera in the initial state of a scenario; `key` identifies the scenario in the renderer
    /// cache.
    ///
    /// # Errors
    /// When there is no such camera, or the image cannot be rendered.
    pub fn image(&self, key: &str, scenario: &Scenario, camera: &str) -> Result<CameraImage, Refusal> {
        let models = self.models(scenario)?;
        let draw = || {
            let robot = self.scenes.robot(&scenario.world)?;
            self.painters.draw(Drawn { key, scenario, models: &models, robot: &robot }, camera)
        };
        draw().map_err(|error: WorkspaceError| Refusal::from(error))
    }

    /// JPEG of the named camera in a recorded frame of an episode.
    ///
    /// # Errors
    /// As [`Studio::image`].
    pub fn state_image(&self, key: &str, episode: &Episode, camera: &str, frame: &Frame) -> Result<Vec<u8>, Refusal> {
        let models = self.models(&episode.scenario)?;
        let draw = || {
            let robot = self.scenes.robot(&episode.scenario.world)?;
            let scene = Drawn { key, scenario: &episode.scenario, models: &models, robot: &robot };
            self.painters.draw_state(scene, camera, frame)
        };
        draw().map_err(|error: WorkspaceError| Refusal::from(error))
    }

    /// Judges the given stages of a revision in order. `go_on` is called with `None` before and with the verdict after
    /// each stage; judging stops when it returns false.
    ///
    /// # Errors
    /// When the world's robot cannot be loaded, or a stage fails.
    pub fn judge(
        &self,
        now: &Revision,
        stages: &[Stage],
        mut go_on: impl FnMut(Option<StageVerdict>) -> bool,
    ) -> Result<(), Refusal> {
        let equipment = self.equipment(&now.scenario.world)?;
        let mut inspection = Inspection::new(Arc::clone(&now.scenario), &equipment);
        for (index, &stage) in stages.iter().enumerate() {
            if !go_on(None) {
                return Ok(());
            }
            let problems = inspection.problems(stage)?;
            let done = index + 1 == stages.len();
            if !go_on(Some(StageVerdict { revision: now.number, stage, problems, done })) {
                return Ok(());
            }
        }
        Ok(())
    }

    /// Planner and settings for verdicts on scenarios in this world.
    ///
    /// # Errors
    /// When the world's robot cannot be loaded.
    pub fn equipment(&self, world: &World) -> Result<Arc<Equipment>, Refusal> {
        self.equipment.get(world).map_err(Refusal::from)
    }

    // A panic of another thread leaves the values consistent, so poisoned locks are used. To avoid deadlock, `rooms` is
    // locked before `collection`.
    fn lock_rooms(&self) -> MutexGuard<'_, BTreeMap<String, Arc<Room>>> {
        self.rooms.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn lock_collection(&self) -> MutexGuard<'_, Collection> {
        self.collection.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
