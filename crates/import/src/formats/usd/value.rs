//! Values of a prim at the start of its stage: numbers, vectors, tokens, targets, and its own transform.

use glam::{DMat4, DQuat, DVec3, Vec2};
use openusd::schemas::geom::{Imageable, Xformable};
use openusd::sdf::{AssetPath, Path, Value};
use openusd::usd::{Attribute, Prim, SchemaBase, SchemaKind, TimeCode};

/// Value of an attribute at a time; `None` if it has none or it is blocked.
fn value(attribute: &Attribute, time: TimeCode) -> Option<Value> {
    attribute.get_at::<Value>(time).ok().flatten().filter(|value| !matches!(value, Value::ValueBlock | Value::None))
}

/// A prim whose attributes are read at one time.
#[derive(Clone)]
pub struct At {
    /// The prim.
    pub prim: Prim,
    /// The time.
    pub time: TimeCode,
}

impl At {
    /// Another prim at the same time.
    pub fn other(&self, path: &Path) -> Self {
        Self { prim: self.prim.stage().prim(path.clone()), time: self.time }
    }

    /// Last part of the prim's path.
    pub fn name(&self) -> String {
        self.prim.path().name().unwrap_or_default().to_owned()
    }

    /// Type name; empty if there is none.
    pub fn kind(&self) -> String {
        self.prim.type_name().ok().flatten().map(|name| name.as_str().to_owned()).unwrap_or_default()
    }

    /// Names of the applied schemas.
    pub fn schemas(&self) -> Vec<String> {
        let names = self.prim.api_schemas().unwrap_or_default();
        names.iter().map(|name| name.as_str().to_owned()).collect()
    }

    /// Value of an attribute.
    pub fn value(&self, name: &str) -> Option<Value> {
        value(&self.prim.attribute(name), self.time)
    }

    /// Number.
    pub fn number(&self, name: &str) -> Option<f64> {
        self.value(name)?.cast::<f64>().ok()
    }

    /// Finite number that is larger than 0.
    pub fn positive(&self, name: &str) -> Option<f64> {
        self.number(name).filter(|value| value.is_finite() && *value > 0.0)
    }

    /// Truth value.
    pub fn flag(&self, name: &str) -> Option<bool> {
        self.value(name)?.cast::<bool>().ok()
    }

    /// Text or token.
    pub fn text(&self, name: &str) -> Option<String> {
        let value = self.value(name)?;
        if let Value::TokenVec(all) = &value {
            return all.first().map(|token| token.as_str().to_owned());
        }
        value.cast::<String>().ok()
    }

    /// Vector of finite numbers.
    pub fn vector(&self, name: &str) -> Option<DVec3> {
        let vector = DVec3::from_array(self.value(name)?.cast::<[f64; 3]>().ok()?);
        vector.is_finite().then_some(vector)
    }

    /// Rotation; a quaternion of length 0 is none.
    pub fn rotation(&self, name: &str) -> Option<DQuat> {
        let [w, x, y, z] = self.value(name)?.cast::<[f64; 4]>().ok()?;
        let rotation = DQuat::from_xyzw(x, y, z, w);
        (rotation.is_finite() && rotation.length() > 1e-9).then(|| rotation.normalize())
    }

    /// List of vectors; empty if there is none.
    pub fn vectors(&self, name: &str) -> Vec<DVec3> {
        match self.value(name) {
            Some(Value::Vec3fVec(all)) => all.iter().map(|v| DVec3::new(v.x.into(), v.y.into(), v.z.into())).collect(),
            Some(Value::Vec3dVec(all)) => all.iter().map(|v| DVec3::new(v.x, v.y, v.z)).collect(),
            Some(Value::Vec3hVec(all)) => all.iter().map(|v| DVec3::new(v.x.into(), v.y.into(), v.z.into())).collect(),
            _ => Vec::new(),
        }
    }

    /// List of pairs; empty if there is none.
    pub fn pairs(&self, name: &str) -> Vec<Vec2> {
        match self.value(name) {
            Some(Value::Vec2fVec(all)) => all.iter().map(|v| Vec2::new(v.x, v.y)).collect(),
            Some(Value::Vec2dVec(all)) => all.iter().map(|v| Vec2::new(v.x as f32, v.y as f32)).collect(),
            Some(Value::Vec2hVec(all)) => all.iter().map(|v| Vec2::new(v.x.into(), v.y.into())).collect(),
            _ => Vec::new(),
        }
    }

    /// List of indices; empty if there is none, negative ones become the largest.
    pub fn indices(&self, name: &str) -> Vec<u32> {
        match self.value(name) {
            Some(Value::IntVec(all)) => all.iter().map(|&index| u32::try_from(index).unwrap_or(u32::MAX)).collect(),
            _ => Vec::new(),
        }
    }

    /// Path of a file: what is written, and the place in the import's files if it is inside them.
    pub fn file(&self, name: &str) -> Option<(String, Option<String>)> {
        let asset = self.prim.attribute(name).get::<AssetPath>().ok().flatten()?;
        (!asset.is_empty()).then(|| (asset.asset_path().to_owned(), asset.resolved_path().map(str::to_owned)))
    }

    /// Parts of a mesh to which the values of a list belong: `constant`, `uniform`, `vertex`, `varying` or `faceVarying`.
    pub fn interpolation(&self, name: &str) -> String {
        let value = self.prim.attribute(name).get_metadata::<Value>("interpolation").ok().flatten();
        value.and_then(|value| value.as_str().map(str::to_owned)).unwrap_or_else(|| "constant".into())
    }

    /// Targets of a relationship, or of its forwards.
    pub fn targets(&self, name: &str) -> Vec<Path> {
        self.prim.relationship(name).forwarded_targets().unwrap_or_default()
    }

    /// Property that an attribute is connected to.
    pub fn source(&self, name: &str) -> Option<Path> {
        self.prim.attribute(name).connections().ok()?.into_iter().next()
    }

    /// Names of the properties that start like this.
    pub fn properties(&self, start: &str) -> Vec<String> {
        let names = self.prim.property_names().unwrap_or_default();
        names.iter().map(|name| name.as_str()).filter(|name| name.starts_with(start)).map(str::to_owned).collect()
    }

    /// `parent_from_prim`, and true if it is `world_from_prim` instead.
    ///
    /// # Errors
    /// If an operation is inverted that has no inverse.
    pub fn transform(&self) -> Result<(DMat4, bool), String> {
        let placed = Placed(self.prim.clone());
        let wrong = |error| format!("{}: {}", self.prim.path(), super::stage::plain(&error));
        let matrix = placed.local_to_parent_transform(self.time).map_err(wrong)?;
        // The library multiplies rows from the left.
        let matrix = DMat4::from_cols_array(&matrix.0);
        if !matrix.is_finite() {
            return Err(format!("{}: its transform is not finite", self.prim.path()));
        }
        Ok((matrix, placed.resets_xform_stack().map_err(wrong)?))
    }
}

/// Any prim as one with a transform.
struct Placed(Prim);

impl SchemaBase for Placed {
    const KIND: SchemaKind = SchemaKind::AbstractTyped;

    fn prim(&self) -> &Prim {
        &self.0
    }
}

impl Imageable for Placed {}
impl Xformable for Placed {}
