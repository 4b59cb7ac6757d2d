//! Global settings of an MJCF file: angle unit, asset folders, default classes.

use std::collections::BTreeMap;

use genmanip_core::Pose;
use glam::{DMat3, DQuat, DVec3};

use crate::ImportError;
use crate::files::shortened;
use crate::formats::xml::Element;

/// Defaults by class, tag and attribute.
type Classes = BTreeMap<String, BTreeMap<String, BTreeMap<String, String>>>;

/// `<compiler>` and `<default>`.
#[derive(Debug)]
pub struct Settings {
    /// True if angles are in degrees.
    pub degrees: bool,
    /// Folder of meshes, relative to the main file.
    pub mesh_folder: String,
    /// Folder of textures, relative to the main file.
    pub texture_folder: String,
    /// Axis order of Euler angles; upper case for fixed axes.
    order: String,
    /// True if a `range` attribute implies `limited`.
    pub limits_by_range: bool,
    /// Geom groups that contribute mass.
    pub mass_groups: [f64; 2],
    classes: Classes,
}

impl Settings {
    /// Settings of a file with its includes.
    ///
    /// # Errors
    /// If a value is invalid.
    pub fn of(root: &Element) -> Result<Self, ImportError> {
        let mut settings = Self {
            degrees: true,
            mesh_folder: String::new(),
            texture_folder: String::new(),
            order: "xyz".into(),
            limits_by_range: true,
            mass_groups: [0.0, 5.0],
            classes: BTreeMap::from([("main".to_owned(), BTreeMap::new())]),
        };
        for compiler in root.all("compiler") {
            if let Some(folder) = compiler.attribute("assetdir") {
                (settings.mesh_folder, settings.texture_folder) = (folder.to_owned(), folder.to_owned());
            }
            settings.mesh_folder = compiler.attribute("meshdir").unwrap_or(&settings.mesh_folder).to_owned();
            settings.texture_folder = compiler.attribute("texturedir").unwrap_or(&settings.texture_folder).to_owned();
            settings.degrees = compiler.attribute("angle").map_or(settings.degrees, |angle| angle == "degree");
            settings.limits_by_range =
                compiler.attribute("autolimits").map_or(settings.limits_by_range, |value| value == "true");
            settings.mass_groups = compiler.exactly::<2>("inertiagrouprange")?.unwrap_or(settings.mass_groups);
            if let Some(order) = compiler.attribute("eulerseq") {
                if order.len() != 3 || !order.chars().all(|c| "xyzXYZ".contains(c)) {
                    return Err(
                        compiler.wrong(format!("eulerseq=\"{}\": expected three of x, y and z", shortened(order)))
                    );
                }
                order.clone_into(&mut settings.order);
            }
        }
        for default in root.all("default") {
            settings.add_class(default, "main");
        }
        Ok(settings)
    }

    fn add_class(&mut self, default: &Element, parent: &str) {
        let name = default.attribute("class").unwrap_or(parent).to_owned();
        let mut class = self.classes.get(&name).or(self.classes.get(parent)).cloned().unwrap_or_default();
        for child in default.children.iter().filter(|child| child.tag != "default") {
            class.entry(child.tag.clone()).or_default().extend(child.attributes.clone());
        }
        self.classes.insert(name.clone(), class);
        for child in default.all("default") {
            self.add_class(child, &name);
        }
    }

    /// An element completed with the defaults of its class, or of the enclosing body's class.
    ///
    /// # Errors
    /// If the class is unknown.
    pub fn complete(&self, element: &Element, class_around: &str) -> Result<Element, ImportError> {
        let name = element.attribute("class").unwrap_or(class_around);
        let class = self.classes.get(name);
        let class = class.ok_or_else(|| element.wrong(format!("unknown class `{}`", shortened(name))))?;
        let mut attributes = class.get(&element.tag).cloned().unwrap_or_default();
        // An alternative representation in the element overrides the class's.
        for rivals in
            [&["quat", "axisangle", "euler", "xyaxes", "zaxis"][..], &["fromto", "quat", "euler", "axisangle"]]
        {
            if rivals.iter().any(|rival| element.attributes.contains_key(*rival)) {
                rivals.iter().for_each(|rival| drop(attributes.remove(*rival)));
            }
        }
        attributes.extend(element.attributes.clone());
        Ok(Element { tag: element.tag.clone(), attributes, children: Vec::new(), place: element.place.clone() })
    }

    /// Converts an angle to rad.
    pub fn angle(&self, value: f64) -> f64 {
        if self.degrees { value.to_radians() } else { value }
    }

    /// Pose of an element in its parent.
    ///
    /// # Errors
    /// If its orientation is invalid.
    pub fn pose(&self, element: &Element) -> Result<Pose, ImportError> {
        let position = DVec3::from_array(element.exactly::<3>("pos")?.unwrap_or_default());
        Ok(Pose { position, rotation: self.rotation(element)? })
    }

    fn rotation(&self, element: &Element) -> Result<DQuat, ImportError> {
        let wrong = |name: &str| element.wrong(format!("{name}: not a valid orientation"));
        if let Some([w, x, y, z]) = element.exactly::<4>("quat")? {
            let quaternion = DQuat::from_xyzw(x, y, z, w);
            return if quaternion.length() > 1e-9 { Ok(quaternion.normalize()) } else { Err(wrong("quat")) };
        }
        if let Some([x, y, z, angle]) = element.exactly::<4>("axisangle")? {
            let axis = DVec3::new(x, y, z).try_normalize().ok_or_else(|| wrong("axisangle"))?;
            return Ok(DQuat::from_axis_angle(axis, self.angle(angle)));
        }
        if let Some(angles) = element.exactly::<3>("euler")? {
            let turns = self.order.chars().zip(angles).map(|(axis, angle)| {
                let unit = match axis.to_ascii_lowercase() {
                    'x' => DVec3::X,
                    'y' => DVec3::Y,
                    _ => DVec3::Z,
                };
                (axis.is_lowercase(), DQuat::from_axis_angle(unit, self.angle(angle)))
            });
            return Ok(turns.fold(DQuat::IDENTITY, |sum, (moving, turn)| if moving { sum * turn } else { turn * sum }));
        }
        if let Some([a, b, c, d, e, f]) = element.exactly::<6>("xyaxes")? {
            let x = DVec3::new(a, b, c).try_normalize().ok_or_else(|| wrong("xyaxes"))?;
            let y = DVec3::new(d, e, f).reject_from(x).try_normalize().ok_or_else(|| wrong("xyaxes"))?;
            return Ok(DQuat::from_mat3(&DMat3::from_cols(x, y, x.cross(y))));
        }
        if let Some(axis) = element.exactly::<3>("zaxis")? {
            let z = DVec3::from_array(axis).try_normalize().ok_or_else(|| wrong("zaxis"))?;
            return Ok(DQuat::from_rotation_arc(DVec3::Z, z));
        }
        Ok(DQuat::IDENTITY)
    }
}
