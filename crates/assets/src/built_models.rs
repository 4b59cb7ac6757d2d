//! Models that were built: the ones used last are kept, others live as long as a scene holds them.

use std::collections::HashMap;
use std::sync::{Arc, Weak};

use genmanip_core::{AssetRef, ObjectModel};

/// Number of models that stay in memory without a scene that holds them; each takes about 0.1 MB. Chosen by hand.
const KEPT: usize = 256;

/// Models by asset, the hash map of which is never iterated.
#[derive(Debug, Default)]
pub(crate) struct BuiltModels {
    known: HashMap<AssetRef, Weak<ObjectModel>>,
    /// The last used models, the newest last.
    recent: Vec<Arc<ObjectModel>>,
}

impl BuiltModels {
    /// Model of an asset, if it is still in memory.
    pub(crate) fn get(&mut self, asset: &AssetRef) -> Option<Arc<ObjectModel>> {
        let model = self.known.get(asset)?.upgrade()?;
        self.keep(&model);
        Some(model)
    }

    /// Adds a model and returns it, or the one of the same asset that another thread has added meanwhile.
    pub(crate) fn add(&mut self, asset: &AssetRef, model: ObjectModel) -> Arc<ObjectModel> {
        self.get(asset).unwrap_or_else(|| {
            let model = Arc::new(model);
            self.known.insert(asset.clone(), Arc::downgrade(&model));
            self.keep(&model);
            model
        })
    }

    fn keep(&mut self, model: &Arc<ObjectModel>) {
        if let Some(place) = self.recent.iter().rposition(|other| Arc::ptr_eq(other, model)) {
            self.recent.remove(place);
        } else if self.recent.len() == KEPT {
            self.recent.remove(0);
        }
        self.recent.push(Arc::clone(model));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Catalogue;

    #[test]
    fn models_beyond_the_last_used_ones_live_as_long_as_they_are_held() {
        let model = ObjectModel::clone(&Catalogue::builtin().build("001").unwrap());
        let asset = |seed: u64| AssetRef::Imported { hash: seed.to_string() };
        let mut models = BuiltModels::default();
        let held = models.add(&asset(0), model.clone());
        for seed in 1..=KEPT as u64 {
            models.add(&asset(seed), model.clone());
            assert!(models.get(&asset(1)).is_some(), "used again and again");
        }
        assert!(Arc::ptr_eq(&models.get(&asset(0)).unwrap(), &held), "held");
        assert!(models.get(&asset(2)).is_none(), "neither held nor used");
        assert!(Arc::ptr_eq(&models.add(&asset(0), model), &held), "the first one stays");
    }
}
