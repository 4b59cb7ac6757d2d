//! Edits of the cameras of a file: everything else in it stays as it is.

use genmanip_core::camera::CameraPreset;
use genmanip_core::world::read_camera;
use genmanip_core::{Camera, CameraMount, Document, Scenario, World};
use serde_json::{Map, Value, json};

use super::{CameraFile, Format, toml_text};
use crate::error::RunError;
use crate::inputs;

/// What a camera shall become; what is not said stays.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CameraEdit {
    /// Name of a [`CameraPreset`].
    pub preset: Option<String>,
    /// Vertical field of view, degrees.
    pub vertical_fov_deg: Option<f64>,
    /// Width and height.
    pub size_px: Option<[u32; 2]>,
    /// Where the camera is, in the frame of its mount, metres.
    pub eye_m: Option<Vec<f64>>,
    /// A point it looks at, in the frame of its mount, metres.
    pub target_m: Option<Vec<f64>>,
    /// What it is fixed to.
    pub mount: Option<CameraMount>,
}

impl CameraFile {
    /// Adds a camera and writes the file.
    ///
    /// # Errors
    /// When the name is taken, something is missing, the camera cannot be, or the file cannot be written.
    pub fn add(&self, name: &str, edit: &CameraEdit) -> Result<(), RunError> {
        if self.cameras().iter().any(|camera| camera.name == name) {
            return Err(self
                .refused(format!("has a camera `{name}` already"))
                .with_hint("choose another name, or change it with `genmanip camera set`"));
        }
        let on_hand = edit.mount == Some(CameraMount::Hand);
        if !on_hand && (edit.eye_m.is_none() || edit.target_m.is_none()) {
            return Err(RunError::input(format!("nobody says where camera `{name}` is"))
                .with_hint("give --eye x,y,z and --target x,y,z in metres, or --mount hand"));
        }
        if edit.preset.is_none() && (edit.vertical_fov_deg.is_none() || edit.size_px.is_none()) {
            return Err(RunError::input(format!("nobody says what camera `{name}` sees")).with_hint(format!(
                "give --preset with one of {}, or --fov-deg and --size",
                CameraPreset::names().join(", ")
            )));
        }
        let mut entry = Map::from_iter([("name".to_owned(), Value::from(name))]);
        edit.apply(name, &mut entry, None)?;
        let index = self.cameras().len();
        self.save(index, Some(entry), |entries, entry| entries.push(entry))
    }

    /// Changes a camera and writes the file.
    ///
    /// # Errors
    /// When there is no such camera, the changed one cannot be, or the file cannot be written.
    pub fn set(&self, name: &str, edit: &CameraEdit) -> Result<(), RunError> {
        let index = self.index_of(name)?;
        if *edit == CameraEdit::default() {
            return Err(RunError::input(format!("nothing to change in camera `{name}`"))
                .with_hint("give --eye, --target, --fov-deg, --size, --preset or --mount"));
        }
        let Some(Value::Object(mut entry)) = self.entries().get(index).cloned() else {
            return Err(self.refused(format!("has no entry for camera `{name}`")));
        };
        edit.apply(name, &mut entry, self.cameras().get(index))?;
        self.save(index, Some(entry), |entries, entry| entries[index] = entry)
    }

    /// Removes a camera and writes the file.
    ///
    /// # Errors
    /// When there is no such camera, or the file cannot be written.
    pub fn remove(&self, name: &str) -> Result<(), RunError> {
        let index = self.index_of(name)?;
        self.save(index, None, |entries, _| drop(entries.remove(index)))
    }

    /// JSON pointer of the list of cameras; scenarios of version 1 have it at the top.
    fn pointer(&self) -> &'static str {
        let in_world = self.format == Format::Scenario && self.body.get("world").is_some();
        if in_world { "/world/cameras" } else { "/cameras" }
    }

    fn entries(&self) -> Vec<Value> {
        self.body.pointer(self.pointer()).and_then(Value::as_array).cloned().unwrap_or_default()
    }

    /// Checks the file with its new list of cameras and writes it; `index` is where the list changes.
    fn save(
        &self,
        index: usize,
        entry: Option<Map<String, Value>>,
        change: impl Fn(&mut Vec<Value>, Value),
    ) -> Result<(), RunError> {
        let (mut world, mut entries) = (self.world.clone(), self.entries());
        let robot = inputs::robot(&World { cameras: Vec::new(), ..self.world.clone() })?;
        let mut written = Value::Null;
        if let Some(entry) = &entry {
            let camera = read_camera(Value::Object(entry.clone()), &robot, &format!("cameras[{index}]"))
                .map_err(|fault| RunError::input(fault.to_string()))?;
            match world.cameras.get_mut(index) {
                Some(own) => own.clone_from(&camera),
                None => world.cameras.push(camera.clone()),
            }
            // Scenarios hold cameras in full.
            written = if self.format == Format::Scenario { json!(camera) } else { Value::Object(entry.clone()) };
        }
        let faults = world.faults(&robot);
        if let Some(fault) = faults.iter().find(|fault| fault.place.starts_with("cameras")) {
            return Err(RunError::input(fault.to_string()));
        }
        change(&mut entries, written);
        let mut body = self.body.clone();
        match body.pointer_mut(self.pointer()) {
            Some(list) => *list = entries.into(),
            None => body["cameras"] = entries.into(),
        }
        let text = match self.format {
            Format::WorldToml => toml_text::with_camera(&self.text, index, entry.as_ref())
                .filter(|text| toml_text::value(&self.path, text).is_ok_and(|value| value == body))
                .ok_or_else(|| {
                    self.refused("writes its cameras in a way that this verb cannot edit".into())
                        .with_hint("write each of them as a table [[cameras]] with one key per line")
                })?,
            Format::WorldJson | Format::Scenario => format!("{body:#}\n"),
        };
        match self.format {
            Format::Scenario => drop(inputs::parse_document::<Scenario>(&self.path, &text)?),
            Format::WorldToml | Format::WorldJson => drop(inputs::parse_world(&self.path, &text)?),
        }
        inputs::write_file(&self.path, text.as_bytes())
    }

    fn refused(&self, why: String) -> RunError {
        RunError::input(format!("{} {why}", self.path.display()))
    }
}

impl CameraEdit {
    /// Writes what is said into the entry of a camera; `now` is what the entry stands for, if it is there already.
    fn apply(&self, name: &str, entry: &mut Map<String, Value>, now: Option<&Camera>) -> Result<(), RunError> {
        self.check()?;
        if let Some(mount) = self.mount {
            entry.insert("mount".into(), json!(mount));
            let keeps_place = now.is_none_or(|now| now.mount == mount) || self.eye_m.is_some();
            if !keeps_place {
                return Err(RunError::input(format!("camera `{name}` cannot keep its place on another mount"))
                    .with_hint("give --eye and --target too, in the frame of the new mount"));
            }
        }
        if self.eye_m.is_some() || self.target_m.is_some() {
            let eye = self.eye_m.as_ref().map(|eye| json!(eye)).or_else(|| entry.get("eye_m").cloned());
            let eye = eye.or_else(|| now.map(|now| json!(now.mount_from_camera.position)));
            let target = self.target_m.as_ref().map(|target| json!(target)).or_else(|| entry.get("target_m").cloned());
            let (Some(eye), Some(target)) = (eye, target) else {
                return Err(RunError::input(format!("nobody says what camera `{name}` looks at"))
                    .with_hint("give --eye and --target together: the file holds a pose, not a target"));
            };
            entry.shift_remove("mount_from_camera");
            entry.insert("eye_m".into(), eye);
            entry.insert("target_m".into(), target);
        }
        let sees = |now: &Camera| [now.intrinsics.width, now.intrinsics.height];
        let size = self.size_px.or_else(|| now.map(sees));
        if self.preset.is_some() || self.vertical_fov_deg.is_some() {
            for key in ["preset", "vertical_fov_deg", "horizontal_fov_deg", "size_px", "intrinsics"] {
                entry.shift_remove(key);
            }
            if let Some(preset) = &self.preset {
                let known = CameraPreset::names();
                CameraPreset::named(preset).ok_or_else(|| RunError::unknown("preset", "presets", preset, &known))?;
                entry.insert("preset".into(), json!(preset));
            }
            if let Some(degrees) = self.vertical_fov_deg {
                entry.insert("vertical_fov_deg".into(), json!(degrees));
            }
            if let Some(size) = size {
                entry.insert("size_px".into(), json!(size));
            }
        } else if let Some([width, height]) = self.size_px {
            match (entry.contains_key("intrinsics"), now) {
                (true, Some(now)) if width > 0 && height > 0 => {
                    entry.insert("intrinsics".into(), json!(now.intrinsics.filling(width, height)));
                }
                _ => {
                    entry.shift_remove("intrinsics");
                    entry.insert("size_px".into(), json!([width, height]));
                }
            }
        }
        Ok(())
    }

    /// What no file can hold.
    fn check(&self) -> Result<(), RunError> {
        if self.preset.is_some() && self.vertical_fov_deg.is_some() {
            return Err(RunError::input("--preset and --fov-deg both say what is seen").with_hint("give one of them"));
        }
        for (option, point) in [("--eye", &self.eye_m), ("--target", &self.target_m)] {
            let fits = |point: &Vec<f64>| point.len() == 3 && point.iter().all(|value| value.is_finite());
            if let Some(point) = point.as_ref().filter(|point| !fits(point)) {
                let got: Vec<String> = point.iter().map(ToString::to_string).collect();
                return Err(RunError::input(format!("{option} {} is no point", got.join(",")))
                    .with_hint("expected three finite numbers x,y,z in metres"));
            }
        }
        if let Some([width, height]) = self.size_px.filter(|size| size.contains(&0)) {
            return Err(RunError::input(format!("--size {width}x{height} is no picture"))
                .with_hint("expected at least one pixel along each side, e.g. 512x288"));
        }
        if let Some(degrees) = self.vertical_fov_deg.filter(|degrees| !(*degrees > 0.0 && *degrees < 180.0)) {
            return Err(RunError::input(format!("--fov-deg {degrees} is no field of view"))
                .with_hint("expected an angle between 0 and 180 degrees"));
        }
        Ok(())
    }
}
