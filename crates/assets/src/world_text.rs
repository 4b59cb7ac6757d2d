//! World files as TOML text: values are changed in place, comments and order are kept.

use std::fmt;

use genmanip_core::Camera;
use serde::Serialize;
use toml_edit::ser::ValueSerializer;
use toml_edit::{ArrayOfTables, Decor, DocumentMut, Item, Table, TableLike, Value};

use crate::AssetError;

const CAMERAS: &str = "cameras";

/// Text of a world file that is being changed.
///
/// ```
/// use genmanip_assets::world_text::WorldText;
/// let mut text = WorldText::read("[robot]\nname = \"panda\" # seven joints\n")?;
/// text.set(&["robot"], "name", &"xarm7")?;
/// assert_eq!(text.to_string(), "[robot]\nname = \"xarm7\" # seven joints\n");
/// # Ok::<(), genmanip_assets::AssetError>(())
/// ```
#[derive(Clone, Debug)]
pub struct WorldText(DocumentMut);

impl fmt::Display for WorldText {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(formatter)
    }
}

impl WorldText {
    /// Parses the TOML text of a world.
    ///
    /// # Errors
    /// [`AssetError::Data`] with the place of a syntax error.
    pub fn read(text: &str) -> Result<Self, AssetError> {
        text.parse().map(Self).map_err(fault)
    }

    /// Sets a key of the table at a path, such as `["physics", "arm"]`; missing tables are added at the end.
    ///
    /// # Errors
    /// [`AssetError::Data`] if the value has no TOML form, or the path leads through something that is no table.
    pub fn set(&mut self, tables: &[&str], key: &str, value: &impl Serialize) -> Result<(), AssetError> {
        set_in(self.table(tables)?, key, value)
    }

    /// Replaces or adds a table, such as `arm` in the table `["physics"]`, below a comment.
    ///
    /// # Errors
    /// [`AssetError::Data`] if the value is no table, or the path leads through something that is no table.
    pub fn put_table(
        &mut self,
        tables: &[&str],
        key: &str,
        value: &impl Serialize,
        comment: &str,
    ) -> Result<(), AssetError> {
        let mut new = table_of(value)?;
        *new.decor_mut() = Decor::new(format!("\n# {comment}\n"), "");
        let around = self.table(tables)?;
        if let Some(old) = around.get(key).and_then(Item::as_table) {
            *new.decor_mut() = old.decor().clone();
            new.set_position(old.position());
        }
        around.insert(key, Item::Table(new));
        Ok(())
    }

    /// Removes a key or table, if there is one.
    ///
    /// # Errors
    /// [`AssetError::Data`] if the path leads through something that is no table.
    pub fn remove(&mut self, tables: &[&str], key: &str) -> Result<(), AssetError> {
        self.table(tables)?.remove(key);
        Ok(())
    }

    /// Sets a key in the entry `index` of a list of tables, such as the table top in `surfaces`.
    ///
    /// # Errors
    /// [`AssetError::Data`] if there is no such entry, or the value has no TOML form.
    pub fn set_entry(&mut self, list: &str, index: usize, key: &str, value: &impl Serialize) -> Result<(), AssetError> {
        let entry = self.list(list)?.get_mut(index).ok_or_else(|| fault(format!("{list}[{index}] does not exist")))?;
        set_in(entry, key, value)
    }

    /// Replaces the camera `index`, or appends one behind the last. Comments within its old entry are lost.
    ///
    /// # Errors
    /// [`AssetError::Data`] if `cameras` is no list of tables, or the camera has no TOML form.
    pub fn put_camera(&mut self, index: usize, camera: &Camera) -> Result<(), AssetError> {
        let mut entry = table_of(camera)?;
        let list = self.list(CAMERAS)?;
        match list.get_mut(index) {
            Some(old) => {
                *entry.decor_mut() = old.decor().clone();
                entry.set_position(old.position());
                *old = entry;
            }
            None => {
                *entry.decor_mut() = Decor::new("\n", "");
                list.push(entry);
            }
        }
        Ok(())
    }

    /// Removes the camera `index` with the comment above it; that above the first camera, which introduces the list,
    /// moves to the next.
    ///
    /// # Errors
    /// [`AssetError::Data`] if `cameras` is no list of tables.
    pub fn remove_camera(&mut self, index: usize) -> Result<(), AssetError> {
        let list = self.list(CAMERAS)?;
        let above = |entry: &Table| entry.decor().prefix().and_then(|prefix| prefix.as_str()).unwrap_or("").to_owned();
        let introduction = list.get(index).filter(|_| index == 0).map(above);
        if let (Some(introduction), Some(next)) = (introduction, list.get_mut(index + 1)) {
            let own = above(next);
            next.decor_mut().set_prefix(format!("{}\n{}", introduction.trim_end(), own.trim_start()));
        }
        list.remove(index);
        Ok(())
    }

    /// The table at a path; missing ones are added.
    fn table(&mut self, path: &[&str]) -> Result<&mut dyn TableLike, AssetError> {
        let mut table: &mut dyn TableLike = self.0.as_table_mut();
        for name in path {
            let item = table.entry(name).or_insert_with(|| Item::Table(Table::new()));
            table = item.as_table_like_mut().ok_or_else(|| fault(format!("`{name}` is no table")))?;
        }
        Ok(table)
    }

    /// A list of tables; one written as an inline array becomes tables.
    fn list(&mut self, name: &str) -> Result<&mut ArrayOfTables, AssetError> {
        let item = self.0.entry(name).or_insert_with(|| Item::ArrayOfTables(ArrayOfTables::new()));
        *item = std::mem::take(item).into_array_of_tables().map_or_else(|other| other, Item::ArrayOfTables);
        item.as_array_of_tables_mut().ok_or_else(|| fault(format!("`{name}` is no list of tables")))
    }
}

fn set_in(table: &mut dyn TableLike, key: &str, value: &impl Serialize) -> Result<(), AssetError> {
    let mut value = value_of(value)?;
    if let Some(old) = table.get(key).and_then(Item::as_value) {
        *value.decor_mut() = old.decor().clone();
    }
    table.insert(key, Item::Value(value));
    Ok(())
}

/// A value as a table, each key on its own line.
fn table_of(value: &impl Serialize) -> Result<Table, AssetError> {
    match value_of(value)? {
        Value::InlineTable(fields) => Ok(fields.into_table()),
        other => Err(fault(format!("{} is no table", other.type_name()))),
    }
}

/// A value on one line.
fn value_of(value: &impl Serialize) -> Result<Value, AssetError> {
    value.serialize(ValueSerializer::new()).map_err(fault)
}

fn fault(error: impl fmt::Display) -> AssetError {
    AssetError::Data { file: "the world's text".into(), message: error.to_string() }
}
