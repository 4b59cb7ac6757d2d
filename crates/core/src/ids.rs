//! Ids of the things in a scene, as types: the id of one kind cannot stand where another kind is meant.
//!
//! In files, keys and messages an id is its text. [`InstanceId`] alone knows how copies are numbered.

use std::borrow::{Borrow, Cow};
use std::collections::BTreeMap;
use std::ops::Deref;
use std::sync::Arc;

use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::{Deserialize, Serialize};

/// Mark between an asset's uid and the number of a further copy.
const COPY_MARK: char = '#';

/// Error for a text that is no id.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected {expected}, got {got:?}")]
pub struct IdError {
    /// Form of a valid id.
    expected: &'static str,
    /// Rejected text.
    got: String,
}

/// Implements for an id everything that its text has: display, order, hash, comparison with texts.
macro_rules! id_of_text {
    ($Id:ident) => {
        impl std::fmt::Display for $Id {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.pad(self.as_str())
            }
        }

        // As its text, so that messages quote it.
        impl std::fmt::Debug for $Id {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                std::fmt::Debug::fmt(self.as_str(), f)
            }
        }

        impl AsRef<str> for $Id {
            fn as_ref(&self) -> &str {
                self.as_str()
            }
        }

        impl Borrow<str> for $Id {
            fn borrow(&self) -> &str {
                self.as_str()
            }
        }

        // Files hold texts.
        impl JsonSchema for $Id {
            fn inline_schema() -> bool {
                true
            }

            fn schema_name() -> Cow<'static, str> {
                String::schema_name()
            }

            fn json_schema(generator: &mut SchemaGenerator) -> Schema {
                String::json_schema(generator)
            }
        }

        impl PartialEq<str> for $Id {
            fn eq(&self, other: &str) -> bool {
                self.as_str() == other
            }
        }

        impl PartialEq<&str> for $Id {
            fn eq(&self, other: &&str) -> bool {
                self.as_str() == *other
            }
        }
    };
}

/// Implements that any text is an id.
macro_rules! id_of_any_text {
    ($Id:ident, $of_text:expr) => {
        impl From<&str> for $Id {
            fn from(text: &str) -> Self {
                Self($of_text(text))
            }
        }

        impl From<String> for $Id {
            fn from(text: String) -> Self {
                Self($of_text(text))
            }
        }
    };
}

/// Implements that an id serves wherever a reference is expected.
macro_rules! id_of_reference {
    ($Id:ident) => {
        impl Deref for $Id {
            type Target = ReferenceId;

            fn deref(&self) -> &ReferenceId {
                &self.0
            }
        }

        impl Borrow<ReferenceId> for $Id {
            fn borrow(&self) -> &ReferenceId {
                self
            }
        }

        impl From<$Id> for ReferenceId {
            fn from(id: $Id) -> Self {
                id.0
            }
        }

        impl PartialEq<ReferenceId> for $Id {
            fn eq(&self, other: &ReferenceId) -> bool {
                self.0 == *other
            }
        }

        impl PartialEq<$Id> for ReferenceId {
            fn eq(&self, other: &$Id) -> bool {
                *self == other.0
            }
        }
    };
}

/// Id of what a relation may refer to: an instance of the scene or a support surface of the world.
///
/// The text does not say which of the two; [`crate::Task::surface`] and [`crate::SceneGraph::index_of`] do.
/// Instances and surfaces of a scene share no id. An [`InstanceId`] and a [`SurfaceId`] serve wherever a
/// reference is expected.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub struct ReferenceId(Arc<str>);

/// Uid of an asset in a catalogue, e.g. `001`; see [`crate::AssetRef`].
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub struct AssetUid(Arc<str>);

/// Id of a support surface of a world, e.g. `side_table`.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub struct SurfaceId(ReferenceId);

/// Id of an instance in a scene: the uid of its asset, with a number for a further copy.
///
/// ```
/// use genmanip_core::InstanceId;
/// let [first, second] = [1, 2].map(|copy| InstanceId::new(&"001".into(), copy));
/// assert_eq!([first.as_str(), second.as_str()], ["001", "001#2"]);
/// assert_eq!(second.asset(), first.asset());
/// assert!("001#two".parse::<InstanceId>().is_err());
/// ```
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(try_from = "Arc<str>")]
pub struct InstanceId(ReferenceId);

id_of_text!(ReferenceId);
id_of_text!(InstanceId);
id_of_text!(AssetUid);
id_of_text!(SurfaceId);
id_of_any_text!(ReferenceId, Arc::from);
id_of_any_text!(AssetUid, Arc::from);
id_of_any_text!(SurfaceId, ReferenceId::from);
id_of_reference!(InstanceId);
id_of_reference!(SurfaceId);

impl AssetUid {
    /// Text in files and messages.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl ReferenceId {
    /// Text in files and messages.
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// Uid of the asset and number of a further copy, if it is the id of an instance.
    pub(crate) fn parts(&self) -> (&str, Option<&str>) {
        parts(&self.0)
    }
}

impl InstanceId {
    /// Id of the `copy`-th instance of an asset, counted from 1.
    pub fn new(uid: &AssetUid, copy: usize) -> Self {
        let id = if copy <= 1 { Arc::clone(&uid.0) } else { format!("{uid}{COPY_MARK}{copy}").into() };
        Self(ReferenceId(id))
    }

    /// Ids for one instance of each of the assets, in order.
    ///
    /// ```
    /// use genmanip_core::{AssetUid, InstanceId};
    /// let uids = ["7", "001", "7", "7"].map(AssetUid::from);
    /// assert_eq!(InstanceId::numbered(&uids), ["7", "001", "7#2", "7#3"]);
    /// ```
    pub fn numbered<'a>(uids: impl IntoIterator<Item = &'a AssetUid>) -> Vec<Self> {
        let mut seen: BTreeMap<&AssetUid, usize> = BTreeMap::new();
        let mut number = |uid| {
            let copy = seen.entry(uid).or_default();
            *copy += 1;
            Self::new(uid, *copy)
        };
        uids.into_iter().map(&mut number).collect()
    }

    /// Uid of the asset.
    pub fn asset(&self) -> AssetUid {
        let ReferenceId(text) = &self.0;
        AssetUid(self.copy().map_or_else(|| Arc::clone(text), |_| parts(text).0.into()))
    }

    /// Number of the copy as text; `None` for the first instance.
    pub fn copy(&self) -> Option<&str> {
        self.parts().1
    }
}

/// Uid of the asset, and the number of a further copy.
fn parts(id: &str) -> (&str, Option<&str>) {
    id.split_once(COPY_MARK).map_or((id, None), |(uid, copy)| (uid, Some(copy)))
}

impl TryFrom<Arc<str>> for InstanceId {
    type Error = IdError;

    fn try_from(text: Arc<str>) -> Result<Self, IdError> {
        let (uid, copy) = parts(&text);
        let is_number = |copy: &str| copy.bytes().all(|digit| digit.is_ascii_digit()) && !copy.starts_with('0');
        if uid.is_empty() || uid.contains('/') || copy.is_some_and(|copy| matches!(copy, "" | "1") || !is_number(copy))
        {
            let expected = "an instance id (uid of an asset, `uid#2`, `uid#3`, …)";
            return Err(IdError { expected, got: text.chars().take(200).collect() });
        }
        Ok(Self(ReferenceId(text)))
    }
}

impl std::str::FromStr for InstanceId {
    type Err = IdError;

    fn from_str(text: &str) -> Result<Self, IdError> {
        Arc::<str>::from(text).try_into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn instance_ids_are_a_uid_and_a_number_from_2() {
        let cases = [
            ("001", Some(("001", None))),
            ("001#2", Some(("001", Some("2")))),
            ("mug-3#12", Some(("mug-3", Some("12")))),
            ("", None),
            ("#2", None),
            ("001#", None),
            ("001#1", None),
            ("001#02", None),
            ("001#-2", None),
            ("001#2#3", None),
            ("001#2/body", None),
            ("001/body", None),
        ];
        for (text, expected) in cases {
            let parsed = text.parse::<InstanceId>();
            assert_eq!(parsed.as_ref().ok().map(|id| id.parts()), expected, "{text}");
            let json = serde_json::to_string(text).unwrap();
            let read = serde_json::from_str::<InstanceId>(&json);
            assert_eq!(read.as_ref().ok(), parsed.as_ref().ok(), "{text}");
            if let Ok(id) = parsed {
                assert_eq!(
                    (serde_json::to_string(&id).unwrap(), format!("{id:?}"), id.to_string()),
                    (json.clone(), json, text.to_owned())
                );
            }
        }
    }

    #[test]
    fn the_schema_of_an_id_is_that_of_a_text() {
        let text = schemars::schema_for!(Vec<String>);
        assert_eq!(schemars::schema_for!(Vec<InstanceId>), text);
        assert_eq!(schemars::schema_for!(Vec<ReferenceId>), text);
        assert_eq!(schemars::schema_for!(Vec<AssetUid>), text);
        assert_eq!(schemars::schema_for!(Vec<SurfaceId>), text);
    }

    #[test]
    fn maps_are_looked_up_by_text_and_by_reference() {
        let id = InstanceId::new(&"001".into(), 2);
        let numbers = BTreeMap::from([(id.clone(), 7)]);
        assert_eq!((numbers.get("001#2"), numbers.get::<ReferenceId>(&id)), (Some(&7), Some(&7)));
    }
}
