//! Search of the catalogue, with a thumbnail of each object.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use genmanip_assets::Catalogue;
use genmanip_assets::search::{Filter, Index};
use genmanip_core::AssetUid;
use genmanip_render::encode::jpeg_rgb;
use genmanip_viz::object_images::portrait;
use genmanip_workspace::WorkspaceError;
use serde::Serialize;

/// Side length of a thumbnail, pixels.
const THUMBNAIL_PX: u32 = 112;
/// Quality of the JPEG thumbnails, 1-100. Chosen by hand.
const QUALITY: u8 = 85;
/// Maximum number of results, and maximum length of a query in bytes.
const MAX_FOUND: usize = 200;
const MAX_QUERY: usize = 400;
/// Maximum number of cached thumbnails, about 4 kB each.
const MAX_THUMBNAILS: usize = 4096;

/// A search result.
#[derive(Clone, Debug, Serialize)]
pub struct Found {
    /// Uid in the catalogue.
    pub uid: AssetUid,
    /// Short name of the object, e.g. `Red Mug`.
    pub name: String,
    /// Description in one sentence.
    pub description: String,
    /// Category of the object, e.g. `mug`.
    pub category: String,
    /// Size along the axes of the object's frame in its canonical pose, m.
    pub size_m: [f64; 3],
    /// True if an 8 cm gripper can grasp the whole object.
    pub graspable: bool,
    /// True if the object has joints.
    pub articulated: bool,
    /// URL of the thumbnail.
    pub thumbnail: String,
}

/// Search index and thumbnails of the catalogue, each made on first use.
#[derive(Debug, Default)]
pub struct CatalogueSearch {
    index: OnceLock<Index>,
    thumbnails: Mutex<BTreeMap<AssetUid, Arc<[u8]>>>,
}

impl CatalogueSearch {
    /// Objects that match a query, best first; an empty query matches all. At most `limit` and [`MAX_FOUND`] are
    /// returned, and a query is cut to [`MAX_QUERY`] bytes. `graspable` keeps objects with this value only.
    pub fn find(&self, query: &str, graspable: Option<bool>, limit: usize) -> Vec<Found> {
        let index = self.index.get_or_init(|| Catalogue::all().index());
        let filter = Filter { graspable, ..Filter::default() };
        let end = query.char_indices().map(|(start, _)| start).take_while(|&start| start <= MAX_QUERY).last();
        let query = if query.len() > MAX_QUERY { &query[..end.unwrap_or(0)] } else { query };
        let found = index.search(query, &filter, limit.min(MAX_FOUND));
        let shown = |found: genmanip_assets::search::SearchResult<'_>| Found {
            uid: found.card.uid.clone(),
            name: found.card.name.clone(),
            description: found.card.description.clone(),
            category: found.card.category.clone(),
            size_m: found.card.size_m.to_array(),
            graspable: found.card.can_grasp,
            articulated: found.card.is_articulated,
            thumbnail: format!("/api/catalogue/{}/thumbnail", found.card.uid),
        };
        found.into_iter().map(shown).collect()
    }

    /// Thumbnail of an object as JPEG; `None` if the object does not exist.
    ///
    /// # Errors
    /// When the thumbnail cannot be rendered.
    pub fn thumbnail(&self, uid: &AssetUid) -> Result<Option<Arc<[u8]>>, WorkspaceError> {
        let known = || self.thumbnails.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(thumbnail) = known().get(uid) {
            return Ok(Some(Arc::clone(thumbnail)));
        }
        let Ok(model) = Catalogue::all().build(uid) else { return Ok(None) };
        let rgb = portrait(&model, &vec![0.0; model.joint_count()], THUMBNAIL_PX)?;
        let jpeg = jpeg_rgb(THUMBNAIL_PX, THUMBNAIL_PX, &rgb, QUALITY)
            .map_err(|error| WorkspaceError::broken(format!("cannot encode the thumbnail of {uid}"), error))?;
        let thumbnail: Arc<[u8]> = jpeg.into();
        let mut thumbnails = known();
        if thumbnails.len() >= MAX_THUMBNAILS {
            thumbnails.clear();
        }
        thumbnails.insert(uid.clone(), Arc::clone(&thumbnail));
        Ok(Some(thumbnail))
    }
}
