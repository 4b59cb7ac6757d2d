//! Frozen hashes of the layouts of a distribution.
//!
//! ```text
//! # genmanip 0.2.0, mujoco 3.17.0
//! [train]
//! 3f2a91c07b44
//! 90be11d2a6f0 2
//! ```
//!
//! Each line is the hash of a layout, followed by the number of the successful attempt if that was not the first.

use std::collections::BTreeMap;
use std::fmt::Write;

use genmanip_core::{Pose, Scenario, hexadecimal};
use sha2::{Digest, Sha256};

use super::format::Split;

/// A frozen layout.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FrozenLayout {
    /// [`layout_hash`] of the layout's scenario.
    pub hash: String,
    /// Number of the attempt that gave the layout, from 1.
    pub attempt: u64,
}

/// Frozen layouts of a distribution by split, in the order of their numbers.
pub(super) type FrozenLayouts = BTreeMap<Split, Vec<FrozenLayout>>;

/// Hexadecimal digits of a hash: 48 bits, so that a collision among the 20,000 layouts of a suite is improbable (1e-6).
const DIGITS: usize = 12;

/// Steps per metre, radian or quaternion unit to which poses are rounded before hashing, so that last-digit
/// differences between machines do not matter. Chosen by hand.
const STEPS: f64 = 1e4;

/// Hash of a layout: instruction, goal, and objects with their poses to 0.1 mm.
pub fn layout_hash(scenario: &Scenario) -> String {
    let round = |value: f64| (value * STEPS).round() as i64;
    let pose = |pose: &Pose| {
        let numbers = pose.position.to_array().into_iter().chain(pose.rotation.to_array());
        numbers.map(round).collect::<Vec<_>>()
    };
    let object = |object: &genmanip_core::PlacedObject| {
        let joints: Vec<i64> = object.joint_positions.iter().copied().map(round).collect();
        (object.id.clone(), object.asset.clone(), pose(&object.pose), joints)
    };
    let objects: Vec<_> = scenario.objects.iter().map(object).collect();
    let about = (&scenario.task.instruction, &scenario.task.goal, objects);
    let text = serde_json::to_string(&about).unwrap_or_default();
    hexadecimal(&Sha256::digest(text)[..DIGITS / 2])
}

/// Text of a distribution's file.
pub(super) fn to_text(layouts: &FrozenLayouts, engine: &str) -> String {
    let mut text = format!("# genmanip {}, {engine}\n", env!("CARGO_PKG_VERSION"));
    for (split, layouts) in layouts {
        let _ = writeln!(text, "[{}]", split.name());
        for FrozenLayout { hash, attempt } in layouts {
            let again = if *attempt > 1 { format!(" {attempt}") } else { String::new() };
            let _ = writeln!(text, "{hash}{again}");
        }
    }
    text
}

/// Frozen layouts from the text of a file.
///
/// # Errors
/// The number of the first invalid line, and the expected form.
pub(super) fn from_text(text: &str) -> Result<FrozenLayouts, String> {
    let (mut layouts, mut split) = (FrozenLayouts::new(), None);
    for (number, line) in text.lines().enumerate() {
        let wrong = |expected: &str| format!("line {}: expected {expected}", number + 1);
        if line.starts_with('#') || line.is_empty() {
            continue;
        }
        if let Some(name) = line.strip_prefix('[').and_then(|rest| rest.strip_suffix(']')) {
            let known = Split::named(name).ok_or_else(|| wrong("a split in brackets"))?;
            layouts.entry(known).or_default();
            split = Some(known);
            continue;
        }
        let (hash, attempt) = line.split_once(' ').unwrap_or((line, "1"));
        let is_hash = hash.len() == DIGITS && hash.chars().all(|c| c.is_ascii_hexdigit());
        let attempt = attempt.parse().ok().filter(|attempt| *attempt > 0 && is_hash);
        let form = || wrong("twelve hexadecimal digits and, apart from 1, the number of an attempt");
        let layout = FrozenLayout { hash: hash.to_owned(), attempt: attempt.ok_or_else(form)? };
        let of_split = split.and_then(|split| layouts.get_mut(&split)).ok_or_else(|| wrong("a split in brackets"))?;
        of_split.push(layout);
    }
    Ok(layouts)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_text_of_a_file_is_read_back_and_other_lines_are_named() {
        let layout = |hash: &str, attempt| FrozenLayout { hash: hash.into(), attempt };
        let train = vec![layout("3f2a91c07b44", 1), layout("90be11d2a6f0", 2)];
        let layouts = FrozenLayouts::from([(Split::Train, train), (Split::Familiar, vec![])]);
        let text = to_text(&layouts, "1.2.3");
        assert_eq!(from_text(&text), Ok(layouts));
        let check = |text: &str, line: &str| {
            let error = from_text(text).unwrap_err();
            assert!(error.starts_with(line), "{text}: {error}");
        };
        check("3f2a91c07b44\n", "line 1:");
        check("[train]\n3f2a\n", "line 2:");
        check("[train]\n3f2a91c07b44 0\n", "line 2:");
        check("# a\n[tests]\n", "line 2:");
    }
}
