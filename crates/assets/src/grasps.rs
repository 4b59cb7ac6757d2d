//! Grasps that were tried in physics beforehand and ship as object data.
//!
//! A file records how the grasps were made and, per object, the physics hash that they were tried with. If the object
//! has changed since, its grasps are not used.

use std::collections::BTreeMap;
use std::sync::{Mutex, OnceLock, PoisonError};

use genmanip_core::{
    AssetRef, AssetUid, Document, DocumentError, Grasp, ObjectModel, Pose, RobotModel, Seed, Upgrade, VerifiedGrasp,
};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::AssetError;

const BUILTIN: &str = include_str!("../data/grasps.json");
/// Text of the file with four grasps per object of the full catalogue, made by `genmanip grasps bake --catalog full
/// --brief`.
const INSTANCES: &str = include_str!("../data/instance_grasps.json");

/// Tried grasps of several objects, written by `genmanip grasps bake`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GraspFile {
    /// Robot, engine and settings with which the grasps were tried.
    pub made_by: GraspProvenance,
    /// Tried grasps of each object, by uid.
    pub objects: BTreeMap<AssetUid, ObjectGrasps>,
}

/// Everything besides the objects that the grasps depend on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GraspProvenance {
    /// Seed of grasp candidates and trials.
    pub seed: Seed,
    /// Version of this program that tried the grasps.
    pub genmanip_version: String,
    /// Name and version of the physics engine.
    pub engine: String,
    /// Name of the robot that tried the grasps.
    pub robot: String,
    /// [`RobotModel::physics_hash`] of that robot; absent in older files, which are matched by name only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub robot_hash: Option<String>,
    /// Settings of grasp generator, trials and physics.
    pub settings: Value,
}

/// Tried grasps of one object.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObjectGrasps {
    /// [`ObjectModel::physics_hash`] at the time of the trials; `v1:` marks version 1.
    pub physics_hash: String,
    /// Grasps in the object frame, highest success rate first.
    #[serde(with = "rows")]
    pub grasps: Vec<VerifiedGrasp>,
}

/// Library of tried grasps by robot name and object physics.
///
/// Layouts and the expert use it; it returns only grasps that were tried with the given robot and object.
#[derive(Clone, Debug, Default)]
pub struct GraspLibrary {
    /// Grasps by robot and uid.
    tried: BTreeMap<(String, AssetUid), ObjectGrasps>,
    /// Uid of the first object with the same physics, by robot and physics hash.
    alike: BTreeMap<(String, String), AssetUid>,
    /// Physics hash of each robot at the time of the trials; absent if the file does not state it.
    robots: BTreeMap<String, String>,
}

impl GraspLibrary {
    /// Merges files; later files override earlier ones for the same robot and object.
    pub fn new(files: impl IntoIterator<Item = GraspFile>) -> Self {
        let (mut tried, mut robots) = (BTreeMap::new(), BTreeMap::new());
        for GraspFile { made_by, objects } in files {
            robots.extend(made_by.robot_hash.map(|hash| (made_by.robot.clone(), hash)));
            tried.extend(objects.into_iter().map(|(uid, grasps)| ((made_by.robot.clone(), uid), grasps)));
        }
        let mut alike = BTreeMap::new();
        for ((robot, uid), grasps) in &tried {
            alike.entry((robot.clone(), grasps.physics_hash.clone())).or_insert_with(|| uid.clone());
        }
        Self { tried, alike, robots }
    }

    /// Library of the grasps that ship with the program.
    pub fn builtin() -> &'static Self {
        static LIBRARY: OnceLock<GraspLibrary> = OnceLock::new();
        LIBRARY.get_or_init(|| Self::new([GraspFile::instances().clone(), GraspFile::builtin().clone()]))
    }

    /// Grasps that a robot tried on an object, or on one with the same physics, highest success rate first; empty if
    /// there are none. For objects missing from the files, [`cached_grasps`] are used.
    ///
    /// # Errors
    /// [`AssetError::StaleGrasps`] if the object's or the robot's physics have changed since.
    pub fn of(&self, robot: &RobotModel, model: &ObjectModel) -> Result<&[VerifiedGrasp], AssetError> {
        if let Some(expected) = self.robots.get(&robot.name) {
            let got = robot.physics_hash();
            if *expected != got {
                let (uid, robot) = (model.card.uid.clone(), Some(robot.name.clone()));
                return Err(AssetError::StaleGrasps { uid, robot, expected: expected.clone(), got });
            }
        }
        let of_uid = |uid: &AssetUid| self.tried.get(&(robot.name.clone(), uid.clone()));
        // A variant is looked up by its physics, since its card has the uid of the object that it varies.
        let own = match &model.asset {
            AssetRef::Builtin { uid, .. } => of_uid(uid),
            AssetRef::Generated { .. } | AssetRef::Imported { .. } => None,
        };
        let known = match own {
            Some(own) if !model.has_physics(&own.physics_hash) => return Err(stale(model, &own.physics_hash)),
            Some(own) => Some(own),
            None => {
                let physics_hash = model.physics_hash();
                let alike = self.alike.get(&(robot.name.clone(), physics_hash.clone())).and_then(of_uid);
                if alike.is_none() {
                    return Ok(cached_grasps(&robot.physics_hash(), &physics_hash).unwrap_or_default());
                }
                alike
            }
        };
        Ok(known.map_or(&[], |known| &known.grasps))
    }
}

/// Grasps tried at run time, by the physics hashes of robot and object.
static CACHE: Mutex<BTreeMap<(String, String), &'static [VerifiedGrasp]>> = Mutex::new(BTreeMap::new());

/// Caches grasps tried at run time, so that every [`GraspLibrary`] finds them for objects missing from its files.
/// Existing entries are kept. At most one list per object is leaked for the lifetime of the process.
pub fn cache_grasps(robot_hash: &str, physics_hash: &str, grasps: Vec<VerifiedGrasp>) {
    let mut known = CACHE.lock().unwrap_or_else(PoisonError::into_inner);
    known.entry((robot_hash.to_owned(), physics_hash.to_owned())).or_insert_with(|| grasps.leak());
}

/// Grasps cached by [`cache_grasps`]; `None` if there are none.
pub fn cached_grasps(robot_hash: &str, physics_hash: &str) -> Option<&'static [VerifiedGrasp]> {
    let known = CACHE.lock().unwrap_or_else(PoisonError::into_inner);
    known.get(&(robot_hash.to_owned(), physics_hash.to_owned())).copied()
}

fn stale(model: &ObjectModel, expected: &str) -> AssetError {
    let (uid, expected) = (model.card.uid.clone(), expected.into());
    AssetError::StaleGrasps { uid, robot: None, expected, got: model.physics_hash() }
}

impl Document for GraspFile {
    const SCHEMA: &'static str = "genmanip.grasps/2";
    const PREVIOUS: Option<Upgrade> = Some(Upgrade { schema: "genmanip.grasps/1", upgrade: mark_hashes });
}

/// Upgrade from version 1, whose files contain physics hashes of version 1 without prefix.
fn mark_hashes(file: &mut Map<String, Value>) -> Result<(), DocumentError> {
    let objects = file.get_mut("objects").and_then(Value::as_object_mut);
    for object in objects.into_iter().flat_map(|objects| objects.values_mut()) {
        let marked = object["physics_hash"].as_str().map(|digits| format!("v1:{digits}"));
        if let Some(marked) = marked {
            object["physics_hash"] = marked.into();
        }
    }
    Ok(())
}

impl GraspFile {
    /// Grasps of the hand-written objects that ship with the program.
    ///
    /// # Panics
    /// Never in a tested build: the data file is compiled in.
    pub fn builtin() -> &'static Self {
        static FILE: OnceLock<GraspFile> = OnceLock::new();
        FILE.get_or_init(|| Self::from_json(BUILTIN).expect("built-in data files are tested"))
    }

    /// A few grasps of every graspable object of the full catalogue, instances of families included.
    ///
    /// # Panics
    /// Never in a tested build: the data file is compiled in.
    pub fn instances() -> &'static Self {
        static FILE: OnceLock<GraspFile> = OnceLock::new();
        FILE.get_or_init(|| Self::from_json(INSTANCES).expect("built-in data files are tested"))
    }

    /// Tried grasps of an object; `None` if it is not in the file.
    ///
    /// # Errors
    /// [`AssetError::StaleGrasps`] if the object has changed since the trials.
    pub fn of(&self, model: &ObjectModel) -> Result<Option<&[VerifiedGrasp]>, AssetError> {
        let Some(object) = self.objects.get(&model.card.uid) else { return Ok(None) };
        if !model.has_physics(&object.physics_hash) {
            return Err(stale(model, &object.physics_hash));
        }
        Ok(Some(&object.grasps))
    }

    /// Text of the file, one line per object.
    pub fn to_text(&self) -> String {
        let line = |value: &dyn Fn() -> serde_json::Result<String>| value().unwrap_or_default();
        let objects: Vec<String> = self
            .objects
            .iter()
            .map(|(uid, object)| format!("\"{uid}\": {}", line(&|| serde_json::to_string(object))))
            .collect();
        let made_by = line(&|| serde_json::to_string(&self.made_by));
        format!(
            "{{\"schema\": \"{}\",\n\"made_by\": {made_by},\n\"objects\": {{\n{}\n}}}}\n",
            Self::SCHEMA,
            objects.join(",\n")
        )
    }
}

/// Rows of numbers in which grasps are stored: position (m), rotation vector (rad), width (m), score, successes,
/// trials.
mod rows {
    use genmanip_core::glam::{DQuat, DVec3};
    use serde::de::Error;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    use super::{Grasp, Pose, VerifiedGrasp};

    type Row = [f64; 10];

    pub fn serialize<S: Serializer>(grasps: &[VerifiedGrasp], serializer: S) -> Result<S::Ok, S::Error> {
        grasps.iter().map(to_row).collect::<Vec<Row>>().serialize(serializer)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<VerifiedGrasp>, D::Error> {
        let rows = Vec::<Row>::deserialize(deserializer)?;
        rows.iter().enumerate().map(|(index, row)| from_row(index, row).map_err(D::Error::custom)).collect()
    }

    fn to_row(tried: &VerifiedGrasp) -> Row {
        let Grasp { pose, width, score } = &tried.grasp;
        let ([x, y, z], [rx, ry, rz]) = (pose.position.to_array(), pose.rotation.to_scaled_axis().to_array());
        // Numbers are rounded to five decimals (0.01 mm), so that reading and writing again gives the same bytes.
        let rounded = [x, y, z, rx, ry, rz, *width, *score].map(|value| (value * 1e5).round() / 1e5 + 0.0);
        let [x, y, z, rx, ry, rz, width, score] = rounded;
        [x, y, z, rx, ry, rz, width, score, f64::from(tried.held), f64::from(tried.trials)]
    }

    fn from_row(index: usize, row: &Row) -> Result<VerifiedGrasp, String> {
        let &[x, y, z, rx, ry, rz, width, score, held, trials] = row;
        let counts = held >= 0.0 && held <= trials && held.fract() == 0.0 && trials.fract() == 0.0 && trials < 1e6;
        if !(0.0..=1.0).contains(&width) || !(0.0..=1.0).contains(&score) || !counts {
            return Err(format!(
                "grasp {index}: expected [x, y, z, rx, ry, rz, width, score, held, trials] with width and score in 0-1 \
                 and whole numbers held ≤ trials"
            ));
        }
        let pose = Pose::new(DVec3::new(x, y, z), DQuat::from_scaled_axis(DVec3::new(rx, ry, rz)));
        Ok(VerifiedGrasp { grasp: Grasp { pose, width, score }, trials: trials as u32, held: held as u32 })
    }
}
