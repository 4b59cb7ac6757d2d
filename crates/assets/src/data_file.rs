//! Parsing of the data files that are compiled into the crate.

use crate::AssetError;

/// Parses a JSON text; `file` is its name in errors.
///
/// # Errors
/// [`AssetError::Data`] with the file and the position of the error.
pub fn read<T: serde::de::DeserializeOwned>(file: &str, text: &str) -> Result<T, AssetError> {
    let mut reader = serde_json::Deserializer::from_str(text);
    serde_path_to_error::deserialize(&mut reader)
        .map_err(|error| AssetError::Data { file: file.to_owned(), message: error.to_string() })
}
