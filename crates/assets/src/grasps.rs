//! Grasps that were tried in physics beforehand, kept as data of their objects.
//!
//! A file says how it was made and holds, per object, the hash of the physics that its grasps were tried with:
//! grasps of an object that has changed since are not given out.

use std::collections::BTreeMap;
use std::sync::{Mutex, OnceLock, PoisonError};

use genmanip_core::{
    AssetRef, Document, DocumentError, Grasp, ObjectModel, Pose, RobotModel, Seed, TriedGrasp, Upgrade,
};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::AssetError;

const BUILTIN: &str = include_str!("../data/grasps.json");
/// Four grasps of each object of the whole list: `genmanip grasps bake --catalog full --brief`.
const INSTANCES: &str = include_str!("../data/instance_grasps.json");

/// Tried grasps of several objects; a file of `genmanip grasps bake`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GraspFile {
    /// How they were made.
    pub made_by: GraspProvenance,
    /// By uid.
    pub objects: BTreeMap<String, ObjectGrasps>,
}

/// Everything that the grasps of a file depend on besides their objects.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GraspProvenance {
    /// Seed of candidates and trials.
    pub seed: Seed,
    /// Version of this program.
    pub genmanip_version: String,
    /// Physics engine and version.
    pub engine: String,
    /// Name of the robot whose hand tried them.
    pub robot: String,
    /// [`RobotModel::physics_hash`] of that robot; files made before it was kept have none, and go by the name.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub robot_hash: Option<String>,
    /// Settings of generator, trials and physics.
    pub settings: Value,
}

/// Tried grasps of one object.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObjectGrasps {
    /// [`ObjectModel::physics_hash`] of the object when it was tried; `v1:` marks one of version 1.
    pub physics_hash: String,
    /// Object frame, those that held most often first.
    #[serde(with = "rows")]
    pub grasps: Vec<TriedGrasp>,
}

/// Tried grasps of whatever robots and objects there are, by the name of the robot and the physics of the object.
///
/// What a layout or the expert is given: it has no grasps of a robot or an object that were not tried with them.
#[derive(Clone, Debug, Default)]
pub struct GraspLibrary {
    /// By robot and uid.
    tried: BTreeMap<(String, String), ObjectGrasps>,
    /// By robot and hash of the physics: the uid of the first object that has them.
    alike: BTreeMap<(String, String), String>,
    /// Hash of each robot's physics when it tried them, where it is known.
    robots: BTreeMap<String, String>,
}

impl GraspLibrary {
    /// The grasps of files; of several for the same robot and object the last one counts.
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

    /// The grasps that come with the program.
    pub fn builtin() -> &'static Self {
        static LIBRARY: OnceLock<GraspLibrary> = OnceLock::new();
        LIBRARY.get_or_init(|| Self::new([GraspFile::instances().clone(), GraspFile::builtin().clone()]))
    }

    /// The grasps that a robot's hand tried on an object, or on another one with the same physics, those that held most
    /// often first; none of what it never tried. Objects of no file have what was [`remember`]ed of them.
    ///
    /// # Errors
    /// [`AssetError::StaleGrasps`] when the robot tried an object of this uid with other physics, or has changed itself.
    pub fn of(&self, robot: &RobotModel, model: &ObjectModel) -> Result<&[TriedGrasp], AssetError> {
        if let Some(expected) = self.robots.get(&robot.name) {
            let got = robot.physics_hash();
            if *expected != got {
                let uid = format!("{} with {}", model.card.uid, robot.name);
                return Err(AssetError::StaleGrasps { uid, expected: expected.clone(), got });
            }
        }
        let of_uid = |uid: &str| self.tried.get(&(robot.name.clone(), uid.to_owned()));
        // A variant of an object is not that object, although it may have its card.
        let own = match &model.asset {
            AssetRef::Builtin { uid, .. } => of_uid(uid),
            AssetRef::Generated { .. } | AssetRef::Imported { .. } => None,
        };
        let known = match own {
            Some(own) if !model.has_physics(&own.physics_hash) => return Err(stale(model, &own.physics_hash)),
            Some(own) => Some(own),
            None => {
                let physics_hash = model.physics_hash();
                let alike = self.alike.get(&(robot.name.clone(), physics_hash.clone())).and_then(|uid| of_uid(uid));
                if alike.is_none() {
                    return Ok(remembered(&robot.physics_hash(), &physics_hash).unwrap_or_default());
                }
                alike
            }
        };
        Ok(known.map_or(&[], |known| &known.grasps))
    }
}

/// Grasps that were tried while the program runs, by the physics hashes of robot and object.
static REMEMBERED: Mutex<BTreeMap<(String, String), &'static [TriedGrasp]>> = Mutex::new(BTreeMap::new());

/// Makes grasps that were tried on demand known to every [`GraspLibrary`], for objects that its files do not know;
/// what is known already stays. They are kept as long as the program runs: at most a list per object that it meets.
pub fn remember(robot_hash: &str, physics_hash: &str, grasps: Vec<TriedGrasp>) {
    let mut known = REMEMBERED.lock().unwrap_or_else(PoisonError::into_inner);
    known.entry((robot_hash.to_owned(), physics_hash.to_owned())).or_insert_with(|| grasps.leak());
}

/// What [`remember`] was told; `None` of what was never tried.
pub fn remembered(robot_hash: &str, physics_hash: &str) -> Option<&'static [TriedGrasp]> {
    let known = REMEMBERED.lock().unwrap_or_else(PoisonError::into_inner);
    known.get(&(robot_hash.to_owned(), physics_hash.to_owned())).copied()
}

fn stale(model: &ObjectModel, expected: &str) -> AssetError {
    AssetError::StaleGrasps { uid: model.card.uid.clone(), expected: expected.into(), got: model.physics_hash() }
}

impl Document for GraspFile {
    const SCHEMA: &'static str = "genmanip.grasps/2";
    const PREVIOUS: Option<Upgrade> = Some(Upgrade { schema: "genmanip.grasps/1", upgrade: mark_hashes });
}

/// Files of version 1 held physics hashes of version 1 without saying so.
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
    /// The grasps that come with the program.
    ///
    /// # Panics
    /// Never in a tested build: the data file is compiled in.
    pub fn builtin() -> &'static Self {
        static FILE: OnceLock<GraspFile> = OnceLock::new();
        FILE.get_or_init(|| Self::from_json(BUILTIN).expect("built-in data files are tested"))
    }

    /// A few grasps of every object of the whole list that can be grasped, those of families included.
    ///
    /// # Panics
    /// Never in a tested build: the data file is compiled in.
    pub fn instances() -> &'static Self {
        static FILE: OnceLock<GraspFile> = OnceLock::new();
        FILE.get_or_init(|| Self::from_json(INSTANCES).expect("built-in data files are tested"))
    }

    /// The grasps of an object; `None` when the file does not know it.
    ///
    /// # Errors
    /// [`AssetError::StaleGrasps`] when the object has changed since they were tried.
    pub fn of(&self, model: &ObjectModel) -> Result<Option<&[TriedGrasp]>, AssetError> {
        let Some(object) = self.objects.get(&model.card.uid) else { return Ok(None) };
        if !model.has_physics(&object.physics_hash) {
            return Err(stale(model, &object.physics_hash));
        }
        Ok(Some(&object.grasps))
    }

    /// The text of the file: a line per object.
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

/// A grasp as a row: position (m), rotation as axis times angle (rad), width (m), score, times held, trials.
mod rows {
    use genmanip_core::glam::{DQuat, DVec3};
    use serde::de::Error;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    use super::{Grasp, Pose, TriedGrasp};

    type Row = [f64; 10];

    pub fn serialize<S: Serializer>(grasps: &[TriedGrasp], serializer: S) -> Result<S::Ok, S::Error> {
        grasps.iter().map(to_row).collect::<Vec<Row>>().serialize(serializer)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<TriedGrasp>, D::Error> {
        let rows = Vec::<Row>::deserialize(deserializer)?;
        rows.iter().enumerate().map(|(index, row)| from_row(index, row).map_err(D::Error::custom)).collect()
    }

    fn to_row(tried: &TriedGrasp) -> Row {
        let Grasp { pose, width, score } = &tried.grasp;
        let ([x, y, z], [rx, ry, rz]) = (pose.position.to_array(), pose.rotation.to_scaled_axis().to_array());
        // A hundredth of a millimetre is finer than any hand; what was read is written alike.
        let rounded = [x, y, z, rx, ry, rz, *width, *score].map(|value| (value * 1e5).round() / 1e5 + 0.0);
        let [x, y, z, rx, ry, rz, width, score] = rounded;
        [x, y, z, rx, ry, rz, width, score, f64::from(tried.held), f64::from(tried.trials)]
    }

    fn from_row(index: usize, row: &Row) -> Result<TriedGrasp, String> {
        let &[x, y, z, rx, ry, rz, width, score, held, trials] = row;
        let counts = held >= 0.0 && held <= trials && held.fract() == 0.0 && trials.fract() == 0.0 && trials < 1e6;
        if !(0.0..=1.0).contains(&width) || !(0.0..=1.0).contains(&score) || !counts {
            return Err(format!(
                "grasp {index}: expected [x, y, z, rx, ry, rz, width, score, held, trials] with width and score in 0-1 \
                 and whole numbers held ≤ trials"
            ));
        }
        let pose = Pose::new(DVec3::new(x, y, z), DQuat::from_scaled_axis(DVec3::new(rx, ry, rz)));
        Ok(TriedGrasp { grasp: Grasp { pose, width, score }, trials: trials as u32, held: held as u32 })
    }
}
