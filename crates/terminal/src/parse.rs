//! Parsers of command-line values.

use std::path::PathBuf;

use clap::builder::{PossibleValuesParser, TypedValueParser};
use genmanip_core::Seed;

/// Parses a package and its folder, NAME=DIR.
///
/// # Errors
/// A message with the expected form.
pub fn package(text: &str) -> Result<(String, PathBuf), String> {
    match text.split_once('=') {
        Some((name, folder)) if !name.is_empty() && !folder.is_empty() => Ok((name.to_owned(), folder.into())),
        _ => Err("expected NAME=DIR, e.g. ur_description=/opt/ros/ur_description".into()),
    }
}

/// Parses a whole number from 1 to a million.
///
/// # Errors
/// A message with the expected range.
pub fn count(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(count @ 1..=1_000_000) => Ok(count),
        _ => Err("expected a whole number from 1 to 1000000".into()),
    }
}

/// Parses a seed below 2⁵³, since many JSON readers keep only 53 bits of an integer.
///
/// # Errors
/// A message with the expected range.
pub fn seed(text: &str) -> Result<u64, String> {
    match text.parse() {
        Ok(seed) if seed <= Seed::MAX => Ok(seed),
        _ => Err(format!("expected a whole number from 0 to {}", Seed::MAX)),
    }
}

/// Parses a duration such as `90s`, `30m` or `2h`, from 1 s to 720 h, into seconds.
///
/// # Errors
/// A message with the expected form.
pub fn time(text: &str) -> Result<u64, String> {
    let factor = match text.chars().last() {
        Some('s') => 1,
        Some('m') => 60,
        Some('h') => 3600,
        _ => 0,
    };
    let number = text.get(..text.len().saturating_sub(1)).and_then(|number| number.parse::<u64>().ok());
    match number.and_then(|number| number.checked_mul(factor)) {
        Some(seconds @ 1..=2_592_000) => Ok(seconds),
        _ => Err("expected a time such as 90s, 30m or 2h, at most 720h".into()),
    }
}

/// Parses a positive number from 1e-6 to 1e6.
///
/// # Errors
/// A message with the expected range.
pub fn edge(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(value) if (1e-6..=1e6).contains(&value) => Ok(value),
        _ => Err("expected a number from 1e-6 to 1e6".into()),
    }
}

/// Parses a position, angle or width from -1000 to 1000.
///
/// # Errors
/// A message with the expected range.
pub fn number(text: &str) -> Result<f64, String> {
    match text.trim().parse() {
        Ok(value) if (-1e3..=1e3).contains(&value) => Ok(value),
        _ => Err("expected a number from -1000 to 1000".into()),
    }
}

/// Parser of an enum variant by its name; the help lists the names.
pub fn variant<T: Copy + Send + Sync + 'static, const N: usize>(
    all: [T; N],
    name: fn(T) -> &'static str,
) -> impl TypedValueParser<Value = T> {
    PossibleValuesParser::new(all.map(name))
        .try_map(move |text| all.into_iter().find(|one| name(*one) == text).ok_or("expected one of the names"))
}
