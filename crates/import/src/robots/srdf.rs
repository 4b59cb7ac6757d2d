//! SRDF: link pairs excluded from self-collision checks, and the end effector.

use genmanip_core::limits;

use crate::ImportError;
use crate::files::Files;
use crate::formats::xml;

/// Contents of an SRDF that planning uses.
#[derive(Debug, Default)]
pub struct Semantics {
    /// Pairs of link names from `disable_collisions`.
    pub disabled: Vec<[String; 2]>,
    /// Parent link of the first end effector; `None` if there is none.
    pub end_effector: Option<String>,
}

/// Reads an SRDF.
///
/// # Errors
/// If it is not XML.
pub fn read(path: &str, files: &mut Files<'_>) -> Result<Semantics, ImportError> {
    if files.bytes(path, limits::ROBOT)?.is_empty() {
        return Ok(Semantics::default());
    }
    let root = xml::parse(path, files)?;
    let text = |node: &xml::Element, key: &str| node.attribute(key).unwrap_or_default().to_owned();
    let disabled = root.all("disable_collisions").map(|node| [text(node, "link1"), text(node, "link2")]).collect();
    let end_effector = root.first("end_effector").map(|node| text(node, "parent_link"));
    Ok(Semantics { disabled, end_effector })
}
