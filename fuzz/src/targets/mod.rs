//! Targets: each is a corpus of valid inputs and the reader of them.

mod datasets;
mod documents;
mod objects;
mod replies;

use std::path::Path;

use crate::Failure;
use crate::input::Input;

/// A reader of untrusted bytes.
#[derive(Debug)]
pub struct Target {
    /// Name on the command line.
    pub name: &'static str,
    /// Description of the input.
    pub about: &'static str,
    /// Makes corpus and reader from the target's name and the folder of the repository.
    pub open: fn(&str, &Path) -> Result<Opened, Failure>,
}

/// Reader of an input; the error is the message of a refusal.
pub type Reader = Box<dyn FnMut(&Input) -> Result<(), String>>;

/// A target in use.
pub struct Opened {
    /// Valid inputs.
    pub corpus: Vec<Input>,
    /// Reads an input; `Err` is the message of a refusal.
    pub read: Reader,
}

/// All targets.
pub const TARGETS: &[Target] = &[
    Target { name: "answers", about: "tasks as language models write them", open: documents::answers },
    Target {
        name: "documents",
        about: "versioned JSON: tasks, scenarios, worlds, runs, skills, …",
        open: documents::documents,
    },
    Target { name: "sentences", about: "sentences of people that become tasks", open: documents::sentences },
    Target { name: "worlds", about: "worlds in TOML, compiled for the simulator", open: documents::worlds },
    Target { name: "import-glb", about: "objects from binary glTF", open: objects::import },
    Target { name: "import-gltf", about: "objects from glTF with buffers and textures", open: objects::import },
    Target { name: "import-obj", about: "objects from OBJ with materials and textures", open: objects::import },
    Target { name: "import-stl", about: "objects from STL", open: objects::import },
    Target { name: "import-msh", about: "objects from MuJoCo's MSH", open: objects::import },
    Target { name: "import-urdf", about: "objects from URDF", open: objects::import },
    Target { name: "import-mjcf", about: "objects from MJCF", open: objects::import },
    Target { name: "import-usda", about: "objects from USD text with textures and payloads", open: objects::import },
    Target { name: "import-usdc", about: "objects from USD binary", open: objects::import },
    Target { name: "import-usdz", about: "objects from USD archives", open: objects::import },
    Target { name: "robot-files", about: "robot, arm and gripper files", open: objects::robot_files },
    Target { name: "robots", about: "arms from URDF, SRDF and meshes", open: objects::robots },
    Target { name: "images", about: "PNG, JPEG and WebP files", open: objects::images },
    Target { name: "episodes", about: "the native episode store, with images", open: datasets::episodes },
    Target { name: "dataset-lerobot", about: "LeRobot v3.0: checked and played back", open: datasets::lerobot },
    Target { name: "dataset-v21", about: "LeRobot v2.1: checked and imported", open: datasets::v21 },
    Target { name: "dataset-zarr", about: "Zarr: checked", open: datasets::zarr },
    Target { name: "dataset-original", about: "pickles and LMDB of the original GenManip", open: datasets::original },
    Target { name: "dataset-hdf5", about: "HDF5 of robomimic and LIBERO: imported", open: datasets::hdf5 },
    Target { name: "chat", about: "replies of language-model servers", open: replies::chat },
    Target { name: "masks", about: "run-length masks of segmentation services", open: replies::masks },
    Target { name: "policies", about: "MessagePack replies of policy servers", open: replies::policies },
    Target { name: "services", about: "bodies of requests to our HTTP services", open: replies::services },
];

/// The target of a name.
///
/// # Errors
/// Lists the names there are.
pub fn named(name: &str) -> Result<&'static Target, String> {
    TARGETS.iter().find(|target| target.name == name).ok_or_else(|| {
        let names: Vec<&str> = TARGETS.iter().map(|target| target.name).collect();
        format!("expected one of {}", names.join(", "))
    })
}

/// Message of an error for [`Opened::read`].
fn message(error: impl std::fmt::Display) -> String {
    error.to_string()
}
