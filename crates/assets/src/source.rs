//! Where models of assets come from, whatever the assets are.

use std::sync::Arc;

use genmanip_core::{AssetHashes, AssetRef, ObjectCard, ObjectModel, PlacedObject};

use crate::AssetError;

/// Makes models of assets: of the catalogue, of parametric families, of files that were read.
pub trait AssetSource: Send + Sync {
    /// Cards of what can be put into a scene without being asked for, in a fixed order.
    fn cards(&self) -> &[ObjectCard];

    /// The model of an asset as this program makes it, the same `Arc` every time; its own `asset` says the version,
    /// which may be newer than the one that was asked for.
    ///
    /// # Errors
    /// When the source has no such asset.
    fn model(&self, asset: &AssetRef) -> Result<Arc<ObjectModel>, AssetError>;

    /// The hashes of [`AssetSource::model`].
    ///
    /// # Errors
    /// As [`AssetSource::model`].
    fn hashes(&self, asset: &AssetRef) -> Result<AssetHashes, AssetError> {
        Ok(self.model(asset)?.hashes())
    }

    /// The model of an instance of a scenario, provided that physics and judge see what the scenario was made with.
    ///
    /// # Errors
    /// As [`AssetSource::model`], and [`AssetError::Mismatch`] naming the instance and what differs.
    fn instance(&self, placed: &PlacedObject) -> Result<Arc<ObjectModel>, AssetError> {
        let model = self.model(&placed.asset)?;
        let hashes = self.hashes(&placed.asset)?;
        let differs = |what, expected: &str, got: String| {
            Err(AssetError::Mismatch { id: placed.id.clone(), what, expected: expected.to_owned(), got })
        };
        if placed.asset != model.asset {
            return differs("asset", &placed.asset.to_string(), model.asset.to_string());
        }
        let same_physics = placed.physics_hash == hashes.physics || model.has_physics(&placed.physics_hash);
        if !same_physics {
            return differs("physics hash", &placed.physics_hash, hashes.physics);
        }
        match &placed.judging_hash {
            Some(expected) if *expected != hashes.judging => differs("judging hash", expected, hashes.judging),
            _ => Ok(self.drawn_as_measured(placed, &hashes)?.unwrap_or(model)),
        }
    }

    /// The model of an instance drawn by all triangles that judges measure, where its scenario was made so, as all once
    /// were; `hashes` are those of its asset.
    ///
    /// # Errors
    /// As [`AssetSource::model`].
    fn drawn_as_measured(
        &self,
        placed: &PlacedObject,
        hashes: &AssetHashes,
    ) -> Result<Option<Arc<ObjectModel>>, AssetError> {
        let Some(known) = placed.looks_hash.as_ref().filter(|known| **known != hashes.looks) else { return Ok(None) };
        let (model, looks) = self.measured_model(&placed.asset)?;
        Ok((looks == *known).then_some(model))
    }

    /// [`AssetSource::model`] drawn by all triangles that judges measure, and the hash of its looks.
    ///
    /// # Errors
    /// As [`AssetSource::model`].
    fn measured_model(&self, asset: &AssetRef) -> Result<(Arc<ObjectModel>, String), AssetError> {
        let model = self.model(asset)?.drawn_as_measured();
        let looks = model.looks_hash();
        Ok((Arc::new(model), looks))
    }

    /// Ids of the instances that look otherwise than when their scenario was made, which refuses nothing.
    ///
    /// # Errors
    /// As [`AssetSource::model`].
    fn changed_looks(&self, objects: &[PlacedObject]) -> Result<Vec<String>, AssetError> {
        let mut changed = Vec::new();
        for placed in objects {
            let hashes = self.hashes(&placed.asset)?;
            let is_known = placed.looks_hash.as_ref().is_none_or(|known| *known == hashes.looks);
            if !is_known && self.drawn_as_measured(placed, &hashes)?.is_none() {
                changed.push(placed.id.clone());
            }
        }
        Ok(changed)
    }
}
