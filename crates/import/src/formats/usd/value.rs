//! Values of a prim at one time code: numbers, vectors, tokens, relationship targets, and its local transform.

use glam::{DMat4, DQuat, DVec3, Vec2};
use openusd::schemas::geom::{Imageable, Xformable};
use openusd::sdf::{AssetPath, Path, Value};
use openusd::usd::{Attribute, Prim, SchemaBase, SchemaKind, TimeCode};

/// Value of an attribute at a time code; `None` if it has none or is blocked.
fn value(attribute: &Attribute, time: TimeCode) -> Option<Value> {
    attribute.get_at::<Value>(time).ok().flatten().filter(|value| !matches!(value, Value::ValueBlock | Value::None))
}

/// A prim whose attributes are read at one time code.
#[derive(Clone)]
pub struct At {
    /// The prim.
    pub prim: Prim,
    /// Time code at which its attributes are read.
    pub time: TimeCode,
}

impl At {
    /// Another prim of the stage at the same time code.
    pub fn other(&self, path: &Path) -> Self {
        Self { prim: self.prim.stage().prim(path.clone()), time: self.time }
    }

    /// Last part of the prim's path.
    pub fn name(&self) -> String {
        self.prim.path().name().unwrap_or_default().to_owned()
    }

    /// Type name, e.g. `Mesh`; empty if there is none.
    pub fn kind(&self) -> String {
        self.prim.type_name().ok().flatten().map(|name| name.as_str().to_owned()).unwrap_or_default()
    }

    /// Names of the applied API schemas, e.g. `PhysicsMassAPI`.
    pub fn schemas(&self) -> Vec<String> {
        let names = self.prim.api_schemas().unwrap_or_default();
        names.iter().map(|name| name.as_str().to_owned()).collect()
    }

    /// Value of an attribute; `None` if it has none or is blocked.
    pub fn value(&self, name: &str) -> Option<Value> {
        value(&self.prim.attribute(name), self.time)
    }

    /// Value of a numeric attribute; it may be infinite or NaN.
    pub fn number(&self, name: &str) -> Option<f64> {
        self.value(name)?.cast::<f64>().ok()
    }

    /// Value of a numeric attribute if it is finite and larger than 0.
    pub fn positive(&self, name: &str) -> Option<f64> {
        self.number(name).filter(|value| value.is_finite() && *value > 0.0)
    }

    /// Value of a Boolean attribute.
    pub fn flag(&self, name: &str) -> Option<bool> {
        self.value(name)?.cast::<bool>().ok()
    }

    /// Value of a string or token attribute; of a list of tokens, the first.
    pub fn text(&self, name: &str) -> Option<String> {
        let value = self.value(name)?;
        if let Value::TokenVec(all) = &value {
            return all.first().map(|token| token.as_str().to_owned());
        }
        value.cast::<String>().ok()
    }

    /// Value of an attribute with three components, if all are finite.
    pub fn vector(&self, name: &str) -> Option<DVec3> {
        let vector = DVec3::from_array(self.value(name)?.cast::<[f64; 3]>().ok()?);
        vector.is_finite().then_some(vector)
    }

    /// Value of a quaternion attribute (real part first), normalised; `None` for a length of about 0.
    pub fn rotation(&self, name: &str) -> Option<DQuat> {
        let [w, x, y, z] = self.value(name)?.cast::<[f64; 4]>().ok()?;
        let rotation = DQuat::from_xyzw(x, y, z, w);
        (rotation.is_finite() && rotation.length() > 1e-9).then(|| rotation.normalize())
    }

    /// Array of vectors with three components; empty if there is none.
    pub fn vectors(&self, name: &str) -> Vec<DVec3> {
        match self.value(name) {
            Some(Value::Vec3fVec(all)) => all.iter().map(|v| DVec3::new(v.x.into(), v.y.into(), v.z.into())).collect(),
            Some(Value::Vec3dVec(all)) => all.iter().map(|v| DVec3::new(v.x, v.y, v.z)).collect(),
            Some(Value::Vec3hVec(all)) => all.iter().map(|v| DVec3::new(v.x.into(), v.y.into(), v.z.into())).collect(),
            _ => Vec::new(),
        }
    }

    /// Array of vectors with two components, such as texture coordinates; empty if there is none.
    pub fn pairs(&self, name: &str) -> Vec<Vec2> {
        match self.value(name) {
            Some(Value::Vec2fVec(all)) => all.iter().map(|v| Vec2::new(v.x, v.y)).collect(),
            Some(Value::Vec2dVec(all)) => all.iter().map(|v| Vec2::new(v.x as f32, v.y as f32)).collect(),
            Some(Value::Vec2hVec(all)) => all.iter().map(|v| Vec2::new(v.x.into(), v.y.into())).collect(),
            _ => Vec::new(),
        }
    }

    /// Array of indices; empty if there is none. Negative ones become `u32::MAX`, so that they are out of range.
    pub fn indices(&self, name: &str) -> Vec<u32> {
        match self.value(name) {
            Some(Value::IntVec(all)) => all.iter().map(|&index| u32::try_from(index).unwrap_or(u32::MAX)).collect(),
            _ => Vec::new(),
        }
    }

    /// Value of an asset attribute: the path as authored, and the resolved path within the import's files, if it lies
    /// inside them.
    pub fn file(&self, name: &str) -> Option<(String, Option<String>)> {
        let asset = self.prim.attribute(name).get::<AssetPath>().ok().flatten()?;
        (!asset.is_empty()).then(|| (asset.asset_path().to_owned(), asset.resolved_path().map(str::to_owned)))
    }

    /// Interpolation of a primvar: `constant` (default), `uniform`, `vertex`, `varying` or `faceVarying`.
    pub fn interpolation(&self, name: &str) -> String {
        self.metadata(name, "interpolation").unwrap_or_else(|| "constant".into())
    }

    /// Value of a property's metadata, if it is a token or a string; the property may be a relationship.
    pub fn metadata(&self, name: &str, key: &str) -> Option<String> {
        let value = self.prim.attribute(name).get_metadata::<Value>(key).ok().flatten();
        value.and_then(|value| value.as_str().map(str::to_owned))
    }

    /// Targets of a relationship, with forwarding through other relationships resolved; empty if there are none.
    pub fn targets(&self, name: &str) -> Vec<Path> {
        self.prim.relationship(name).forwarded_targets().unwrap_or_default()
    }

    /// Path of the property that an attribute is connected to, the first of several.
    pub fn source(&self, name: &str) -> Option<Path> {
        self.prim.attribute(name).connections().ok()?.into_iter().next()
    }

    /// Names of the prim's properties that start with `start`.
    pub fn properties(&self, start: &str) -> Vec<String> {
        let names = self.prim.property_names().unwrap_or_default();
        names.iter().map(|name| name.as_str()).filter(|name| name.starts_with(start)).map(str::to_owned).collect()
    }

    /// `parent_from_prim` in the stage's unit of length, and true if the prim resets the transform stack, so that the
    /// matrix is `world_from_prim`.
    ///
    /// # Errors
    /// If the transform is not finite, or an operation is inverted that has no inverse.
    pub fn transform(&self) -> Result<(DMat4, bool), String> {
        let placed = Placed(self.prim.clone());
        let wrong = |error| format!("{}: {}", self.prim.path(), super::stage::plain(&error));
        let matrix = placed.local_to_parent_transform(self.time).map_err(wrong)?;
        // The library's matrices are row-major and multiply row vectors, which is the same memory layout as glam's.
        let matrix = DMat4::from_cols_array(&matrix.0);
        if !matrix.is_finite() {
            return Err(format!("{}: its transform is not finite", self.prim.path()));
        }
        Ok((matrix, placed.resets_xform_stack().map_err(wrong)?))
    }
}

/// Adapter that treats any prim as `Xformable`.
struct Placed(Prim);

impl SchemaBase for Placed {
    const KIND: SchemaKind = SchemaKind::AbstractTyped;

    fn prim(&self) -> &Prim {
        &self.0
    }
}

impl Imageable for Placed {}
impl Xformable for Placed {}
