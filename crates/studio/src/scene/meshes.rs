//! Meshes of links as GLB files, named by the hash of their content.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use genmanip_core::{ObjectModel, RobotModel, VisualPart, hexadecimal};
use genmanip_render::encode::EncodeError;
use sha2::{Digest, Sha256};

use super::glb::link_glb;

/// Most bytes of files that are kept; others are written again when they are asked for.
const MAX_BYTES: usize = 256 << 20;
/// Most bodies whose files are known; a forgotten one is known again with the next scene that shows it.
const MAX_BODIES: usize = 4096;

/// Files of the bodies that were shown, by hash.
#[derive(Debug, Default)]
pub struct MeshStore {
    known: Mutex<Known>,
}

/// An object or a robot; held, so that its address stays its own.
#[derive(Clone, Debug)]
pub enum Body {
    /// An object.
    Object(Arc<ObjectModel>),
    /// A robot.
    Robot(Arc<RobotModel>),
}

#[derive(Debug, Default)]
struct Known {
    /// Hashes of the links of a body, by its address; `None` for a link without surface.
    bodies: BTreeMap<usize, (Body, Vec<Option<String>>)>,
    /// Addresses of the bodies, oldest first.
    order: Vec<usize>,
    files: BTreeMap<String, File>,
    bytes: usize,
    /// Number of accesses.
    clock: u64,
}

#[derive(Debug)]
struct File {
    bytes: Arc<[u8]>,
    used: u64,
}

impl MeshStore {
    /// Hash of the file of each link of a body; `None` for a link without surface.
    ///
    /// # Errors
    /// When a texture of the body is broken.
    pub fn hashes(&self, body: &Body) -> Result<Vec<Option<String>>, EncodeError> {
        if let Some((_, hashes)) = self.lock().bodies.get(&body.address()) {
            return Ok(hashes.clone());
        }
        // Written without the lock: several scenes are opened at once.
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

    /// File of a hash; `None` if no body that was shown has it.
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

    // A poisoned lock still guards whole maps.
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

    /// Adds a file and drops those that were not used for longest.
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

    /// Name and surfaces of each link.
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
