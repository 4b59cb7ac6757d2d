//! Compares the profiles with recorded verdicts of the evaluators they reproduce.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::npz::{NpzError, read_npz};
use crate::{CloudScene, Label, RelationSettings};

use super::{Cloud, CloudError, CloudGoal, CloudLabel, Profile, articulation, goal_score, labels, subgoal};

/// Relative distance to a threshold within which rounding decides and a case is not compared.
const FENCE: f64 = 1e-6;

/// Largest difference of equal goal scores.
const SCORE_TOLERANCE: f64 = 1e-12;

/// How a profile agrees with recorded verdicts.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Comparison {
    /// Cases compared: two label lists and a verdict for each word.
    pub compared: usize,
    /// Cases of which everything agrees.
    pub agreed: usize,
    /// Cases with a quantity so close to a threshold that rounding decides.
    pub excluded: usize,
    /// Goals compared; recorded for GenManip V0.9 only.
    pub dnf_compared: usize,
    /// Goals with the recorded score.
    pub dnf_agreed: usize,
    /// Articulated states compared; recorded for GenManip V0.9 only.
    pub articulation_compared: usize,
    /// Articulated states with the recorded verdicts.
    pub articulation_agreed: usize,
    /// Label lists and verdicts per second of the clock that was given, search structures included.
    pub calls_per_cpu_s: f64,
    /// What disagrees, in words.
    pub disagreements: Vec<String>,
}

/// Why recorded cases cannot be compared.
#[derive(Debug, thiserror::Error)]
pub enum CasesError {
    /// The JSON file is not as expected.
    #[error("expected recorded cases, got: {0}")]
    Json(#[from] serde_json::Error),
    /// The number of units per metre is none.
    #[error("expected a positive `scale`, got {0}")]
    Scale(f64),
    /// The archive cannot be read.
    #[error(transparent)]
    Npz(#[from] NpzError),
    /// A cloud is absent from the archive.
    #[error("expected the cloud `{0}` in the archive, got none")]
    Missing(String),
    /// A cloud cannot be judged.
    #[error("cloud `{name}`: {error}")]
    Cloud {
        /// Name in the archive.
        name: String,
        /// Why.
        error: CloudError,
    },
}

/// Compares every case of a recorded file (its JSON text and its archive of clouds) with a profile.
///
/// `cpu_s` is a clock of processor time in seconds; the library has none of its own.
///
/// # Errors
/// When one of the files cannot be read or they do not belong together.
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
        if case.on_the_fence() {
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
            // Where the original raised an error, any verdict will do.
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

/// Compares profile `seed` with the labels that GenManip V0.9 gave: nobody recorded verdicts of its own, so this tells
/// how the two differ, not whether one is right.
///
/// A case agrees when the label of profile `seed` is among the recorded ones, seen from the same side of the table, or
/// both have none. Cases with three clouds are left out.
///
/// # Errors
/// As [`compare`].
pub fn compare_seed(json: &str, npz: &[u8], cpu_s: &mut dyn FnMut() -> f64) -> Result<Comparison, CasesError> {
    let recorded = Recording::read(json, npz)?;
    let settings = RelationSettings::default();
    let mut report = Comparison::default();
    let (mut calls, mut seconds) = (0, 0.0);
    for case in &recorded.file.cases {
        if case.on_the_fence() || recorded.has(case, "c") {
            report.excluded += 1;
            continue;
        }
        let part = |letter: &str| -> Result<_, CasesError> { Ok((letter.to_owned(), recorded.part(case, letter)?)) };
        let clouds = [part("a")?, part("b")?];
        let start = cpu_s();
        let label = CloudScene::new(clouds).label_pair(0, 1, &settings).and_then(|pair| pair.a_to_b);
        seconds += cpu_s() - start;
        calls += 1;
        report.compared += 1;
        let known = &case.v09.ab;
        if label.map_or(known.is_empty(), |label| known.contains(&from_the_other_side(label))) {
            report.agreed += 1;
        } else {
            report.disagreements.push(format!("case {} ({}): {label:?}, recorded {known:?}", case.id, case.family));
        }
    }
    report.calls_per_cpu_s = if seconds > 0.0 { f64::from(calls) / seconds } else { 0.0 };
    Ok(report)
}

/// The label of the released evaluators that means the same.
fn from_the_other_side(label: Label) -> CloudLabel {
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

/// A recorded file with its clouds.
struct Recording {
    file: File,
    arrays: BTreeMap<String, Vec<[f64; 3]>>,
}

impl Recording {
    fn read(json: &str, npz: &[u8]) -> Result<Self, CasesError> {
        // Python writes numbers that are none as NaN.
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
    /// Measured quantities; some are texts where the original failed.
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
    /// Whether a measured quantity lies on a threshold of either evaluator.
    fn on_the_fence(&self) -> bool {
        let thresholds: [(&[&str], &[f64]); 6] = [
            (&["xy_dist"], &[0.1515]),
            (&["dist", "za", "zb"], &[0.101]),
            (&["i_a", "i_b"], &[0.7, 0.4]),
            (&["r_ab", "r_ba"], &[1.5, 1.8]),
            (&["a_in_b", "b_in_a"], &[0.5]),
            (&["angle"], &[45.0]),
        ];
        thresholds.iter().any(|(keys, values)| {
            keys.iter()
                .filter_map(|key| self.m.get(*key)?.as_f64())
                .any(|value| values.iter().any(|threshold| (value.abs() - threshold).abs() <= FENCE * threshold))
        })
    }
}
