//! Cache of link meshes as GLB files, addressed by the hash of their content.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use genmanip_core::{ObjectModel, RobotModel, VisualPart, hexadecimal};
use genmanip_render::encode::EncodeError;
use sha2::{Digest, Sha256};

use super::glb::link_glb;

/// Maximum total size of cached files, bytes; files dropped from the cache are encoded again when requested.
const MAX_BYTES: usize = 256 << 20;
/// Maximum number of bodies whose hashes are known; a forgotten body is hashed again with the next scene that shows it.
const MAX_BODIES: usize = 4096;

/// GLB files of the links of all bodies shown so far, by hash.
#[derive(Debug, Default)]
pub struct MeshStore {
    known: Mutex<Known>,
}

/// An object or a robot. Owning it keeps its address unique, which is the key of the cache.
#[derive(Clone, Debug)]
pub enum Body {
    /// Model of an object.
    Object(Arc<ObjectModel>),
    /// Model of a robot.
    Robot(Arc<RobotModel>),
}

#[derive(Debug, Default)]
struct Known {
    /// Bodies and the hashes of their links, by address of the body; `None` for a link without visual geometry.
    bodies: BTreeMap<usize, (Body, Vec<Option<String>>)>,
    /// Addresses of the bodies, least recently added first.
    order: Vec<usize>,
    files: BTreeMap<String, File>,
    bytes: usize,
    /// Number of accesses so far, as a logical time for evicting the least recently used file.
    clock: u64,
}

#[derive(Debug)]
struct File {
    bytes: Arc<[u8]>,
    used: u64,
}

impl MeshStore {
    /// Hash of the GLB file of each link of a body; `None` for a link without visual geometry.
    ///
    /// # Errors
    /// When a texture of the body is broken.
    pub fn hashes(&self, body: &Body) -> Result<Vec<Option<String>>, EncodeError> {
        if let Some((_, hashes)) = self.lock().bodies.get(&body.address()) {
            return Ok(hashes.clone());
        }
        // Encoded without holding the lock, since several scenes may be opened at the same time.
        let files = body.links().map(|(name, visual)| match visual {
            [] => Ok(None),
            visual => link_glb(name, visual).map(Some),
        });
        let files = files.collect::<Result<Vec<_>, EncodeError>>()?;
        let mut known = self.lock();
        let mut hashes = Vec::new();
        for bytes in files {
            hashes.push(bytes.map(|bytes| {
                let hash = hash_of(&bytes);
                known.keep(&hash, bytes.into());
                hash
            }));
        }
        known.remember(body, &hashes);
        Ok(hashes)
    }

    /// GLB file with a hash; `None` if no body shown so far has it.
    pub fn file(&self, hash: &str) -> Option<Arc<[u8]>> {
        let mut known = self.lock();
        known.clock += 1;
        let now = known.clock;
        if let Some(file) = known.files.get_mut(hash) {
            file.used = now;
            return Some(Arc::clone(&file.bytes));
        }
        let place = |(body, hashes): &(Body, Vec<Option<String>>)| {
            Some((body.clone(), hashes.iter().position(|own| own.as_deref() == Some(hash))?))
        };
        let (body, link) = known.bodies.values().find_map(place)?;
        drop(known);
        let (name, visual) = body.links().nth(link)?;
        let bytes: Arc<[u8]> = link_glb(name, visual).ok()?.into();
        self.lock().keep(hash, Arc::clone(&bytes));
        Some(bytes)
    }

    // A panic of another thread leaves the maps consistent, so a poisoned lock is used.
    fn lock(&self) -> std::sync::MutexGuard<'_, Known> {
        self.known.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Known {
    fn remember(&mut self, body: &Body, hashes: &[Option<String>]) {
        let address = body.address();
        if self.bodies.insert(address, (body.clone(), hashes.to_vec())).is_none() {
            self.order.push(address);
        }
        if self.order.len() > MAX_BODIES {
            let oldest = self.order.remove(0);
            self.bodies.remove(&oldest);
        }
    }

    /// Adds a file and evicts the least recently used ones beyond [`MAX_BYTES`].
    fn keep(&mut self, hash: &str, bytes: Arc<[u8]>) {
        self.clock += 1;
        self.bytes += bytes.len();
        if let Some(old) = self.files.insert(hash.to_owned(), File { bytes, used: self.clock }) {
            self.bytes -= old.bytes.len();
        }
        while self.bytes > MAX_BYTES && self.files.len() > 1 {
            let oldest = self.files.iter().min_by_key(|(_, file)| file.used).map(|(hash, _)| hash.clone());
            let dropped = oldest.and_then(|hash| self.files.remove(&hash));
            self.bytes -= dropped.map_or(0, |file| file.bytes.len());
        }
    }
}

impl Body {
    fn address(&self) -> usize {
        match self {
            Self::Object(model) => Arc::as_ptr(model) as usize,
            Self::Robot(robot) => Arc::as_ptr(robot) as usize,
        }
    }

    /// Name and visual geometry of each link.
    fn links(&self) -> impl Iterator<Item = (&str, &[VisualPart])> {
        let (objects, robots) = match self {
            Self::Object(model) => (model.links.as_slice(), &[][..]),
            Self::Robot(robot) => (&[][..], robot.links.as_slice()),
        };
        let objects = objects.iter().map(|link| (link.name.as_str(), link.visual.as_slice()));
        objects.chain(robots.iter().map(|link| (link.name.as_str(), link.visual.as_slice())))
    }
}

fn hash_of(bytes: &[u8]) -> String {
    hexadecimal(&Sha256::digest(bytes)[..16])
}
