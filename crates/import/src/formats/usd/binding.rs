//! Materials bound to a prim: by the prim itself or above it, directly or through a collection, for one purpose or for
//! all.

use std::rc::Rc;

use openusd::sdf::Path;
use openusd::usd::{Collection, MembershipQuery, is_collection_api_path};

use super::value::At;

/// Prefix of the relationships that bind materials; the rest of their names is the purpose, or names a collection.
const BINDING: &str = "material:binding";

/// Bindings of a prim and of its ancestors.
#[derive(Clone, Default)]
pub struct Bindings {
    /// Bindings by prim, the outermost first; those to collections precede the direct ones.
    by_prim: Vec<Rc<[Binding]>>,
}

struct Binding {
    /// Purpose, e.g. `physics`; empty for all.
    purpose: String,
    /// Prims that it applies to; `None` for the prim and its descendants.
    members: Option<MembershipQuery>,
    material: Path,
    /// True if bindings of descendants do not override it.
    is_stronger: bool,
}

impl Bindings {
    /// Bindings of a child prim whose parent has these.
    pub fn child(&self, at: &At) -> Self {
        let mut bindings: Vec<Binding> =
            at.properties(BINDING).iter().filter_map(|name| Binding::read(at, name)).collect();
        if bindings.is_empty() {
            return self.clone();
        }
        bindings.sort_by_key(|binding| binding.members.is_none());
        let mut all = self.clone();
        all.by_prim.push(bindings.into());
        all
    }

    /// Material of the prim at `path` for the first of the purposes that one is bound for, then for all purposes.
    ///
    /// As in UsdShade, a binding for a purpose precedes one for all wherever they are; of the same purpose, the nearest
    /// one applies unless one above it is stronger than its descendants.
    pub fn material(&self, path: &Path, purpose: &str) -> Option<Path> {
        [purpose, ""].iter().find_map(|purpose| {
            let mut found: Option<&Binding> = None;
            for bindings in self.by_prim.iter().rev() {
                let own = bindings.iter().find(|binding| binding.purpose == *purpose && binding.applies_to(path));
                found = own.filter(|own| found.is_none() || own.is_stronger).or(found);
            }
            found.map(|binding| binding.material.clone())
        })
    }
}

impl Binding {
    /// Reads a relationship; `None` if it has no target, or belongs to another schema.
    fn read(at: &At, name: &str) -> Option<Self> {
        let words: Vec<&str> = name.strip_prefix(BINDING)?.split(':').collect();
        let (purpose, is_direct) = match words.as_slice() {
            [""] => ("", true),
            ["", "collection", purpose, _] => (*purpose, false),
            ["", "collection", ..] => ("", false),
            ["", purpose] => (*purpose, true),
            _ => return None,
        };
        let relationship = at.prim.relationship(name);
        let is_stronger = at.metadata(name, "bindMaterialAs").as_deref() == Some("strongerThanDescendants");
        let (members, material) = if is_direct {
            (None, at.targets(name).into_iter().next()?)
        } else {
            let targets = relationship.targets().ok()?;
            let [collection, material] = <[Path; 2]>::try_from(targets).ok()?;
            let (holder, named) = is_collection_api_path(&collection)?;
            let members = Collection::new(holder, named).compute_membership_query(at.prim.stage()).ok()?;
            (Some(members), material)
        };
        Some(Self { purpose: purpose.to_owned(), members, material, is_stronger })
    }

    fn applies_to(&self, path: &Path) -> bool {
        self.members.as_ref().is_none_or(|members| members.is_path_included(path))
    }
}
