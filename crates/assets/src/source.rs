//! Interface to model sources: catalogue, parametric families, imported packs.

use std::sync::Arc;

use genmanip_core::{AssetHashes, AssetRef, InstanceId, ObjectCard, ObjectModel, PlacedObject};

use crate::AssetError;

/// Source of object models, e.g. a catalogue.
pub trait AssetSource: Send + Sync {
    /// Cards of the objects that may be placed as distractors, in a fixed order.
    fn cards(&self) -> &[ObjectCard];

    /// Model of an asset; the same `Arc` on every call as long as one is held. The model's `asset` field states the
    /// actual version, which may be newer than the requested one.
    ///
    /// # Errors
    /// If the source has no such asset.
    fn model(&self, asset: &AssetRef) -> Result<Arc<ObjectModel>, AssetError>;

    /// Hashes of the model that [`AssetSource::model`] returns.
    ///
    /// # Errors
    /// As [`AssetSource::model`].
    fn hashes(&self, asset: &AssetRef) -> Result<AssetHashes, AssetError> {
        Ok(self.model(asset)?.hashes())
    }

    /// Model of a scenario's instance, after checking that its physics and judging inputs match the scenario's hashes.
    ///
    /// # Errors
    /// As [`AssetSource::model`], and [`AssetError::Mismatch`] with the instance and the field that differs.
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
            _ => Ok(self.with_full_meshes(placed, &hashes)?.unwrap_or(model)),
        }
    }

    /// Model that is rendered with full-resolution meshes, if the scenario's appearance hash is that of such a model,
    /// as in older scenarios; `None` otherwise. `hashes` are the current ones of the asset.
    ///
    /// # Errors
    /// As [`AssetSource::model`].
    fn with_full_meshes(
        &self,
        placed: &PlacedObject,
        hashes: &AssetHashes,
    ) -> Result<Option<Arc<ObjectModel>>, AssetError> {
        let Some(known) = placed.looks_hash.as_ref().filter(|known| **known != hashes.looks) else { return Ok(None) };
        let (model, looks) = self.full_mesh_model(&placed.asset)?;
        Ok((looks == *known).then_some(model))
    }

    /// Model of an asset, rendered with full-resolution meshes, and its appearance hash.
    ///
    /// # Errors
    /// As [`AssetSource::model`].
    fn full_mesh_model(&self, asset: &AssetRef) -> Result<(Arc<ObjectModel>, String), AssetError> {
        let model = self.model(asset)?.with_full_meshes();
        let looks = model.looks_hash();
        Ok((Arc::new(model), looks))
    }

    /// Ids of the instances whose appearance has changed since the scenario was made, which is not an error.
    ///
    /// # Errors
    /// As [`AssetSource::model`].
    fn changed_appearance(&self, objects: &[PlacedObject]) -> Result<Vec<InstanceId>, AssetError> {
        let mut changed = Vec::new();
        for placed in objects {
            let hashes = self.hashes(&placed.asset)?;
            let is_known = placed.looks_hash.as_ref().is_none_or(|known| *known == hashes.looks);
            if !is_known && self.with_full_meshes(placed, &hashes)?.is_none() {
                changed.push(placed.id.clone());
            }
        }
        Ok(changed)
    }
}
