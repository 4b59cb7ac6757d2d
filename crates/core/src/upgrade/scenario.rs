//! Scenarios of version 1: objects identified by uid and generator, hashes that include the uid, one fixed world.

use serde_json::{Map, Value, json};

use super::{lacks, object, objects, task, text, world};
use crate::{DocumentError, Seed, Upgrade};

/// Upgrade of a scenario of version 1 to version 2.
pub const FROM_1: Upgrade = Upgrade { schema: "genmanip.scenario/1", upgrade: from_1 };

fn from_1(scenario: &mut Map<String, Value>) -> Result<(), DocumentError> {
    task::from_1(object(scenario, "task", "$")?)?;
    instances(scenario)?;
    world::insert(scenario)
}

/// Converts objects to instances of assets.
fn instances(scenario: &mut Map<String, Value>) -> Result<(), DocumentError> {
    for (index, placed) in objects(scenario, "objects", "$")?.into_iter().enumerate() {
        let path = format!("$.objects[{index}]");
        let (uid, hash) = (text(placed, "uid", &path)?, text(placed, "physics_hash", &path)?);
        let asset = asset(placed, &uid, &path)?;
        for obsolete in ["uid", "family", "seed", "generator_version"] {
            placed.shift_remove(obsolete);
        }
        placed.insert("id".into(), uid.into());
        placed.insert("asset".into(), asset);
        placed.insert("physics_hash".into(), format!("v1:{hash}").into());
    }
    Ok(())
}

/// The built-in asset, or a generated variant of it if the seed differs from the catalogue's.
fn asset(placed: &Map<String, Value>, uid: &str, path: &str) -> Result<Value, DocumentError> {
    let number = |key: &str| {
        placed.get(key).and_then(Value::as_u64).ok_or_else(|| lacks(&format!("{path}.{key}"), "a whole number"))
    };
    let (seed, version) = (number("seed")?, number("generator_version")?);
    if Seed::new(seed) == catalogue_seed(uid) {
        return Ok(json!({"source": "builtin", "uid": uid, "version": version}));
    }
    let family = text(placed, "family", path)?;
    Ok(json!({"source": "generated", "family": family, "params": {"of": uid}, "seed": seed, "version": version}))
}

/// Seed with which the catalogue of version 1 built an object.
fn catalogue_seed(uid: &str) -> Seed {
    uid.parse().map_or_else(|_| Seed::new(0).fork(uid), Seed::new)
}
