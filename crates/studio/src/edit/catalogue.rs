//! New instances of catalogue assets.

use std::sync::Arc;

use genmanip_assets::AssetSource;
use genmanip_core::names::near_misses;
use genmanip_core::{
    AssetHashes, AssetUid, InstanceId, ObjectCard, ObjectModel, PhysicsFactors, PlacedObject, Pose, Scenario,
};

use super::error::EditError;
use super::operation::ChosenAsset;

/// An asset of the catalogue with its card, model and hashes.
pub(super) struct Found {
    pub card: Arc<ObjectCard>,
    pub model: Arc<ObjectModel>,
    hashes: AssetHashes,
}

/// Looks an asset up; `place` is the name of the argument in error messages.
pub(super) fn find(asset: &ChosenAsset, assets: &dyn AssetSource, place: &str) -> Result<Found, EditError> {
    let cards = assets.cards();
    let listed = match asset {
        ChosenAsset::Uid(uid) => cards.iter().find(|card| card.uid == *uid),
        ChosenAsset::Reference(asset) => cards.iter().find(|card| card.asset == *asset),
    };
    let reference = match (asset, listed) {
        (_, Some(card)) => card.asset.clone(),
        (ChosenAsset::Reference(asset), None) => asset.clone(),
        (ChosenAsset::Uid(uid), None) => {
            let known: Vec<&str> = cards.iter().map(|card| card.uid.as_str()).collect();
            let near = near_misses(uid.as_str(), &known);
            let hint = if near.is_empty() {
                "`genmanip assets list` shows the catalogue".into()
            } else {
                format!("did you mean {}?", near.join(" or "))
            };
            return Err(EditError::invalid(place, format!("expected the uid of an object, got {uid:?}"), hint));
        }
    };
    let refused = |error: genmanip_assets::AssetError| {
        EditError::invalid(place, error.to_string(), "open the pack that holds it with --packs")
    };
    let model = assets.model(&reference).map_err(refused)?;
    let hashes = assets.hashes(&reference).map_err(refused)?;
    let card = listed.map_or_else(|| model.card.clone(), ObjectCard::clone);
    Ok(Found { card: Arc::new(card), model, hashes })
}

impl Found {
    /// An instance at a pose (`world_from_object`), with the nominal joint positions of `state`, or 0 without such a
    /// state.
    pub fn placed(&self, id: &InstanceId, pose: Pose, state: Option<&str>, physics: PhysicsFactors) -> PlacedObject {
        let AssetHashes { physics: physics_hash, judging, looks } = self.hashes.clone();
        PlacedObject {
            id: id.clone(),
            asset: self.model.asset.clone(),
            physics_hash,
            judging_hash: Some(judging),
            looks_hash: Some(looks),
            pose,
            joint_positions: nominal_joints(&self.model, state).unwrap_or_else(|| vec![0.0; self.model.joint_count()]),
            physics,
        }
    }
}

/// Joint positions that represent a state; `None` if the object has no such state.
pub(super) fn nominal_joints(model: &ObjectModel, state: Option<&str>) -> Option<Vec<f64>> {
    let state = state?;
    model.joint_states.iter().find(|known| known.name == state).map(|known| known.nominal.clone())
}

/// Id of a new instance: the wanted one if it belongs to the asset and is free, else the first free one.
pub(super) fn new_id(
    scenario: &Scenario,
    uid: &AssetUid,
    wanted: Option<&InstanceId>,
) -> Result<InstanceId, EditError> {
    let is_taken = |id: &InstanceId| scenario.index_of(id).is_some() || scenario.world.surface(id).is_some();
    match wanted {
        Some(id) if id.asset() != *uid => {
            let hint = format!("ids of copies are {uid}, {uid}#2, …; leave the id out");
            Err(EditError::invalid("args.id", format!("expected an id of asset {uid:?}, got {id:?}"), hint))
        }
        Some(id) if is_taken(id) => {
            let hint = "leave the id out to get the next free one";
            Err(EditError::invalid("args.id", format!("expected an unused id, got {id:?}"), hint))
        }
        Some(id) => Ok(id.clone()),
        None => {
            let mut copy = 1;
            while is_taken(&InstanceId::new(uid, copy)) {
                copy += 1;
            }
            Ok(InstanceId::new(uid, copy))
        }
    }
}
