//! Reading the data files that the crate is made of.

use crate::AssetError;

/// What a JSON text holds.
///
/// # Errors
/// [`AssetError::Data`] naming the file and the place of the mistake.
pub fn read<T: serde::de::DeserializeOwned>(file: &str, text: &str) -> Result<T, AssetError> {
    let mut reader = serde_json::Deserializer::from_str(text);
    serde_path_to_error::deserialize(&mut reader)
        .map_err(|error| AssetError::Data { file: file.to_owned(), message: error.to_string() })
}
