//! Compares the profiles with recorded verdicts of the released evaluators.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::npz::{NpzError, read_npz};
use crate::{CloudScene, Label, RelationSettings};

use super::{Cloud, CloudError, CloudGoal, CloudLabel, Profile, articulation, goal_score, labels, subgoal};

/// Cases with a quantity closer to a threshold than this relative distance are not compared, since rounding decides
/// them.
const THRESHOLD_TOLERANCE: f64 = 1e-6;

/// Tolerance for equal goal scores.
const SCORE_TOLERANCE: f64 = 1e-12;

/// Agreement of a profile with the recorded verdicts.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Comparison {
    /// Number of cases compared: two label lists and one verdict per word.
    pub compared: usize,
    /// Number of cases in which everything agrees.
    pub agreed: usize,
    /// Number of cases excluded because a quantity is too close to a threshold.
    pub excluded: usize,
    /// Number of goals compared; recorded for GenManip V0.9 only.
    pub dnf_compared: usize,
    /// Number of goals with the recorded score, of those compared.
    pub dnf_agreed: usize,
    /// Number of articulated states compared; recorded for GenManip V0.9 only.
    pub articulation_compared: usize,
    /// Number of articulated states with the recorded verdict, of those compared.
    pub articulation_agreed: usize,
    /// Label lists and verdicts per second of the given clock, including the construction of search structures.
    pub calls_per_cpu_s: f64,
    /// Description of each disagreement.
    pub disagreements: Vec<String>,
}

/// Reason why recorded cases cannot be compared.
#[derive(Debug, thiserror::Error)]
pub enum CasesError {
    /// The JSON file does not have the expected structure.
    #[error("expected recorded cases, got: {0}")]
    Json(#[from] serde_json::Error),
    /// The number of units per metre is not positive and finite.
    #[error("expected a positive `scale`, got {0}")]
    Scale(f64),
    /// The archive cannot be read.
    #[error(transparent)]
    Npz(#[from] NpzError),
    /// A cloud is missing from the archive.
    #[error("expected the cloud `{0}` in the archive, got none")]
    Missing(String),
    /// A cloud is invalid.
    #[error("cloud `{name}`: {error}")]
    Cloud {
        /// Name of the cloud in the archive.
        name: String,
        /// Reason why the cloud is invalid.
        error: CloudError,
    },
}

/// Compares every case of a recorded file (its JSON text and its archive of clouds) with a profile.
///
/// `cpu_s` returns processor time in seconds.
///
/// # Errors
/// If one of the files cannot be read or they do not belong together.
pub fn compare(
    json: &str,
    npz: &[u8],
    profile: Profile,
    cpu_s: &mut dyn FnMut() -> f64,
) -> Result<Comparison, CasesError> {
    let recorded = Recording::read(json, npz)?;
    let file = &recorded.file;
    let mut report = Comparison::default();
    let (mut calls, mut seconds) = (0, 0.0);
    for case in &file.cases {
        let has_c = recorded.has(case, "c");
        let part = |letter: &str| recorded.part(case, letter);
        let (a, b, c) = (part("a")?, part("b")?, if has_c { Some(part("c")?) } else { None });
        let start = cpu_s();
        let ab = labels(profile, &a, &b, c.as_ref());
        let ba = labels(profile, &b, &a, None);
        let words: Vec<bool> = file.positions.iter().map(|word| subgoal(profile, word, &a, &b, c.as_ref())).collect();
        seconds += cpu_s() - start;
        calls += 2 + words.len();
        if case.is_near_threshold() {
            report.excluded += 1;
            continue;
        }
        let known = match profile {
            Profile::GenManip09 => &case.v09,
            Profile::Suite023 => &case.suite,
        };
        let before = report.disagreements.len();
        let mut check = |what: &str, agrees: bool| {
            if !agrees {
                report.disagreements.push(format!("case {} ({}): {what}", case.id, case.family));
            }
        };
        check("labels of a to b", ab == known.ab);
        check("labels of b to a", has_c || ba == known.ba);
        for (word, holds) in file.positions.iter().zip(words) {
            // Where the original raised an error, any verdict is accepted.
            let expected = known.subgoal.get(word).and_then(serde_json::Value::as_bool);
            check(word, expected.is_none_or(|expected| expected == holds));
        }
        report.compared += 1;
        report.agreed += usize::from(report.disagreements.len() == before);
    }
    report.calls_per_cpu_s = if seconds > 0.0 { f64::from(calls as u32) / seconds } else { 0.0 };
    if profile == Profile::GenManip09 {
        for dnf in &file.dnf {
            let named = |uid: &String| Ok((uid.clone(), recorded.cloud(&format!("dnf{}_{uid}", dnf.id))?));
            let clouds = dnf.objects.iter().map(named).collect::<Result<BTreeMap<_, _>, CasesError>>()?;
            let score = goal_score(profile, &dnf.goal, &clouds);
            report.dnf_compared += 1;
            if (score - dnf.score).abs() <= SCORE_TOLERANCE {
                report.dnf_agreed += 1;
            } else {
                report.disagreements.push(format!("goal {}: score {score}, recorded {}", dnf.id, dnf.score));
            }
        }
        for (index, case) in file.articulation.iter().enumerate() {
            let got: Vec<bool> = case.status.iter().map(|status| articulation(&case.positions, status)).collect();
            report.articulation_compared += 1;
            if got == case.matches {
                report.articulation_agreed += 1;
            } else {
                report.disagreements.push(format!("articulation {index}: {got:?}, recorded {:?}", case.matches));
            }
        }
    }
    Ok(report)
}

/// Compares profile `seed` with the labels of GenManip V0.9. No verdicts of `seed` itself are recorded, so the result
/// measures how the two differ, not which one is right.
///
/// A case agrees if the label of `seed`, converted to the opposite view, is among the recorded ones, or if both have
/// none. Cases with three clouds are skipped.
///
/// # Errors
/// As [`compare`].
pub fn compare_seed(json: &str, npz: &[u8], cpu_s: &mut dyn FnMut() -> f64) -> Result<Comparison, CasesError> {
    let recorded = Recording::read(json, npz)?;
    let settings = RelationSettings::default();
    let mut report = Comparison::default();
    let (mut calls, mut seconds) = (0, 0.0);
    for case in &recorded.file.cases {
        if case.is_near_threshold() || recorded.has(case, "c") {
            report.excluded += 1;
            continue;
        }
        let part = |letter: &str| -> Result<_, CasesError> { Ok((letter.into(), recorded.part(case, letter)?)) };
        let clouds = [part("a")?, part("b")?];
        let start = cpu_s();
        let label = CloudScene::new(clouds).label_pair(0, 1, &settings).and_then(|pair| pair.a_to_b);
        seconds += cpu_s() - start;
        calls += 1;
        report.compared += 1;
        let known = &case.v09.ab;
        if label.map_or(known.is_empty(), |label| known.contains(&opposite_view(label))) {
            report.agreed += 1;
        } else {
            report.disagreements.push(format!("case {} ({}): {label:?}, recorded {known:?}", case.id, case.family));
        }
    }
    report.calls_per_cpu_s = if seconds > 0.0 { f64::from(calls) / seconds } else { 0.0 };
    Ok(report)
}

/// The corresponding label of the released evaluators, which look from the opposite side of the table.
fn opposite_view(label: Label) -> CloudLabel {
    match label {
        Label::In => CloudLabel::In,
        Label::OutOf => CloudLabel::OutOf,
        Label::On => CloudLabel::On,
        Label::Beneath => CloudLabel::Below,
        Label::Left => CloudLabel::Right,
        Label::Right => CloudLabel::Left,
        Label::Front => CloudLabel::Back,
        Label::Back => CloudLabel::Front,
        Label::Near => CloudLabel::Near,
    }
}

/// A recorded file of cases with its point clouds.
struct Recording {
    file: File,
    arrays: BTreeMap<String, Vec<[f64; 3]>>,
}

impl Recording {
    fn read(json: &str, npz: &[u8]) -> Result<Self, CasesError> {
        // Python writes NaN, which JSON does not allow.
        let file: File = serde_json::from_str(&json.replace(": NaN", ": null"))?;
        if !(file.scale.is_finite() && file.scale > 0.0) {
            return Err(CasesError::Scale(file.scale));
        }
        let arrays = read_npz(npz, file.scale)?;
        Ok(Self { file, arrays })
    }

    fn cloud(&self, name: &str) -> Result<Cloud, CasesError> {
        let points = self.arrays.get(name).cloned().ok_or_else(|| CasesError::Missing(name.into()))?;
        Cloud::new(points).map_err(|error| CasesError::Cloud { name: name.into(), error })
    }

    fn part(&self, case: &Case, letter: &str) -> Result<Cloud, CasesError> {
        self.cloud(&format!("{}_{letter}", case.id))
    }

    fn has(&self, case: &Case, letter: &str) -> bool {
        self.arrays.contains_key(&format!("{}_{letter}", case.id))
    }
}

#[derive(Deserialize)]
struct File {
    scale: f64,
    positions: Vec<String>,
    cases: Vec<Case>,
    #[serde(default)]
    dnf: Vec<Dnf>,
    #[serde(default)]
    articulation: Vec<Articulation>,
}

#[derive(Deserialize)]
struct Case {
    id: u32,
    family: String,
    /// Measured quantities by name; text instead of a number where the original failed.
    m: BTreeMap<String, serde_json::Value>,
    v09: Recorded,
    suite: Recorded,
}

#[derive(Deserialize)]
struct Recorded {
    ab: Vec<CloudLabel>,
    ba: Vec<CloudLabel>,
    subgoal: BTreeMap<String, serde_json::Value>,
}

#[derive(Deserialize)]
struct Dnf {
    id: u32,
    objects: Vec<String>,
    goal: CloudGoal,
    score: f64,
}

#[derive(Deserialize)]
struct Articulation {
    positions: Vec<Vec<f64>>,
    status: Vec<Vec<Vec<[f64; 2]>>>,
    #[serde(rename = "match")]
    matches: Vec<bool>,
}

impl Case {
    /// True if a measured quantity lies on a threshold of one of the evaluators.
    fn is_near_threshold(&self) -> bool {
        let thresholds: [(&[&str], &[f64]); 6] = [
            (&["xy_dist"], &[0.1515]),
            (&["dist", "za", "zb"], &[0.101]),
            (&["i_a", "i_b"], &[0.7, 0.4]),
            (&["r_ab", "r_ba"], &[1.5, 1.8]),
            (&["a_in_b", "b_in_a"], &[0.5]),
            (&["angle"], &[45.0]),
        ];
        thresholds.iter().any(|(keys, values)| {
            keys.iter().filter_map(|key| self.m.get(*key)?.as_f64()).any(|value| {
                values.iter().any(|threshold| (value.abs() - threshold).abs() <= THRESHOLD_TOLERANCE * threshold)
            })
        })
    }
}
