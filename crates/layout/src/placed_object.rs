//! Objects as a scenario stores them.

use genmanip_assets::{AssetError, AssetSource};
use genmanip_core::{AssetHashes, PhysicsFactors, PlacedObject};
use genmanip_relations::PosedObject;

pub(crate) fn placed_object(object: &PosedObject, assets: &dyn AssetSource) -> Result<PlacedObject, AssetError> {
    let asset = object.model.asset.clone();
    let AssetHashes { physics, judging, looks } = assets.hashes(&asset)?;
    Ok(PlacedObject {
        id: object.id.clone(),
        asset,
        physics_hash: physics,
        judging_hash: Some(judging),
        looks_hash: Some(looks),
        pose: object.pose,
        joint_positions: object.joint_positions.clone(),
        physics: PhysicsFactors::default(),
    })
}
