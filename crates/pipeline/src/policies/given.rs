//! Arguments of a policy as they are given on the command line.

use std::ops::RangeInclusive;
use std::path::PathBuf;

use genmanip_workspace::WorkspaceError;

use super::arguments::PolicyArgument;
use super::label::{InLabel, label};

/// Arguments of a policy: the given ones, and defaults for the others.
pub(super) struct Given {
    policy: &'static str,
    arguments: &'static [PolicyArgument],
    /// Name, value, and true if it differs from the default; in the order of the entry's arguments.
    values: Vec<(&'static str, String, bool)>,
}

impl Given {
    pub(super) fn parse(
        policy: &'static str,
        arguments: &'static [PolicyArgument],
        text: &str,
    ) -> Result<Self, WorkspaceError> {
        let defaults = arguments.iter().map(|argument| (argument.name, argument.default.to_owned(), false));
        let mut given = Self { policy, arguments, values: defaults.collect() };
        for (place, part) in text.split(',').enumerate().filter(|(_, part)| !part.is_empty()) {
            // Shorthand: `python:MODULE:CLASS`, `learned:FOLDER` and `skill:FILE` need no argument name.
            if let (0, "python" | "learned" | "skill", false) = (place, policy, part.contains('=')) {
                given.values[0] = (given.values[0].0, part.to_owned(), true);
                continue;
            }
            let Some((key, value)) = part.split_once('=') else {
                return Err(WorkspaceError::input(format!("`{part}` is no argument of policy {policy}"))
                    .with_hint(format!("expected {policy}:key=value,key=value")));
            };
            let known: Vec<&str> = arguments.iter().map(|argument| argument.name).collect();
            if known.is_empty() {
                return Err(WorkspaceError::input(format!("policy {policy} takes no arguments, not even `{key}`"))
                    .with_hint(format!("expected {policy} alone")));
            }
            let Some(slot) = given.values.iter_mut().find(|(name, ..)| *name == key) else {
                return Err(WorkspaceError::unknown("policy argument", "arguments", key, &known));
            };
            *slot = (slot.0, value.to_owned(), value != slot.1);
        }
        Ok(given)
    }

    pub(super) fn number(&self, name: &str, range: RangeInclusive<f64>) -> Result<f64, WorkspaceError> {
        let text = self.text(name);
        text.parse().ok().filter(|value| range.contains(value) && !value.is_sign_negative()).ok_or_else(|| {
            WorkspaceError::input(format!("policy {}: {name}={text} is not possible", self.policy)).with_hint(format!(
                "expected a number from {} to {}",
                range.start(),
                range.end()
            ))
        })
    }

    /// Number of an argument without a default; `None` if it was not given.
    pub(super) fn optional(&self, name: &str, range: RangeInclusive<f64>) -> Result<Option<f64>, WorkspaceError> {
        (!self.text(name).is_empty()).then(|| self.number(name, range)).transpose()
    }

    /// Whole number of an argument without a default; `None` if it was not given.
    pub(super) fn count(&self, name: &str) -> Result<Option<usize>, WorkspaceError> {
        let parse = |text: &str| {
            text.parse().map_err(|_| {
                WorkspaceError::input(format!("policy {}: {name}={text} is not possible", self.policy))
                    .with_hint("expected a whole number")
            })
        };
        Some(self.text(name)).filter(|text| !text.is_empty()).map(parse).transpose()
    }

    pub(super) fn text(&self, name: &str) -> &str {
        self.values.iter().find(|(known, ..)| *known == name).map_or("", |(_, value, _)| value)
    }

    pub(super) fn is_yes(&self, name: &str) -> Result<bool, WorkspaceError> {
        match self.text(name) {
            "yes" => Ok(true),
            "no" => Ok(false),
            other => Err(WorkspaceError::input(format!("policy {}: {name}={other} is not possible", self.policy))
                .with_hint("expected yes or no")),
        }
    }

    pub(super) fn folder(&self, name: &str) -> Option<PathBuf> {
        Some(self.text(name)).filter(|path| !path.is_empty()).map(PathBuf::from)
    }

    /// Label of the policy, with those arguments that differ from their defaults.
    pub(super) fn label(&self) -> String {
        let differing = self.arguments.iter().zip(&self.values).filter(|(_, (.., differs))| *differs);
        let arguments = differing
            .filter_map(|(argument, (name, value, _))| Some(format!("_{name}={}", argument.in_label.of(value)?)));
        label(&format!("{}{}", self.policy, arguments.collect::<String>()))
    }

    /// Arguments whose label does not identify their content, as `NAME=VALUE`.
    pub(super) fn named_folders(&self) -> Vec<String> {
        let named = self.arguments.iter().zip(&self.values);
        let named = named.filter(|(argument, (.., differs))| *differs && argument.in_label == InLabel::Name);
        named.map(|(argument, (_, value, _))| format!("{}={value}", argument.name)).collect()
    }
}
