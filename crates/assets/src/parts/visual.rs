//! Visual meshes of parts, and the clearance of collision pieces.

use std::sync::Arc;

use genmanip_core::{Pose, Seed, TriMesh, VisualPart};

use crate::finish::Finish;
use crate::surface::Detail;

/// Height above the table of collision pieces that need not touch it, m.
///
/// Two dozen wedges that touch the table around the base disc slow physics down fivefold without adding support.
pub(super) const CLEARANCE: f64 = 0.0005;

/// Visual part in the object's frame, with a full-resolution mesh and a simplified one for rendering.
pub(super) fn surface(name: &str, mesh: impl Fn(Detail) -> TriMesh, finish: &Finish, seed: Seed) -> VisualPart {
    let measured = VisualPart::new(name, mesh(Detail::Full), finish.material(seed), Pose::IDENTITY);
    VisualPart { render_mesh: Arc::new(mesh(Detail::Simplified)), ..measured }
}
