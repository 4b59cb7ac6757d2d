use std::collections::BTreeMap;

use serde::Deserialize;
use serde_json::Value;

use super::judge::crop;
use super::npz::read_npz;
use super::*;

#[derive(Deserialize)]
struct File {
    scale: f64,
    positions: Vec<String>,
    cases: Vec<Case>,
    dnf: Vec<Dnf>,
    articulation: Vec<Articulation>,
}

#[derive(Deserialize)]
struct Case {
    id: u32,
    family: String,
    m: BTreeMap<String, Value>,
    v09: Recorded,
    suite: Recorded,
}

#[derive(Deserialize)]
struct Recorded {
    ab: Vec<CloudLabel>,
    ba: Vec<CloudLabel>,
    subgoal: BTreeMap<String, Value>,
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
    r#match: Vec<bool>,
}

/// Whether a measured quantity is within 1e-6 (relative) of a threshold, where rounding decides.
fn on_the_fence(case: &Case) -> bool {
    let near = |key: &str, thresholds: &[f64]| {
        let value = case.m.get(key).and_then(Value::as_f64).map_or(f64::NAN, f64::abs);
        thresholds.iter().any(|threshold| (value - threshold).abs() <= 1e-6 * threshold)
    };
    near("xy_dist", &[0.1515])
        || near("dist", &[0.101])
        || near("za", &[0.101])
        || near("zb", &[0.101])
        || near("i_a", &[0.7, 0.4])
        || near("i_b", &[0.7, 0.4])
        || near("r_ab", &[1.5, 1.8])
        || near("r_ba", &[1.5, 1.8])
        || near("a_in_b", &[0.5])
        || near("b_in_a", &[0.5])
        || near("angle", &[45.0])
}

/// Compares every verdict of a file; returns the number of disagreements of compared cases, told on the way.
fn compare(json: &str, npz: &[u8]) -> Vec<String> {
    // Python writes numbers that are none as NaN.
    let file: File = serde_json::from_str(&json.replace("NaN", "null")).unwrap();
    let arrays = read_npz(npz, file.scale).unwrap();
    let cloud = |name: &str| arrays.get(name).map(|points| Cloud::new(points.clone()).unwrap());
    let mut wrong = Vec::new();
    let mut crops = [0, 0];
    let mut excluded = 0;
    for case in &file.cases {
        if on_the_fence(case) {
            excluded += 1;
            continue;
        }
        let part = |letter: &str| cloud(&format!("{}_{letter}", case.id));
        let (a, b, c) = (part("a").unwrap(), part("b").unwrap(), part("c"));
        if let Some(expected) = case.m["n_crop"].as_u64() {
            crops[usize::from(crop(&a, &b).map_or(0, |part| part.points.len() as u64) == expected)] += 1;
        }
        for (profile, recorded) in [(Profile::GenManip09, &case.v09), (Profile::Suite023, &case.suite)] {
            let mut check = |what: &str, got: String, expected: String| {
                if got != expected {
                    wrong.push(format!("{} {} {profile:?} {what}: {got}, not {expected}", case.id, case.family));
                }
            };
            let ab = labels(profile, &a, &b, c.as_ref());
            check("ab", format!("{ab:?}"), format!("{:?}", recorded.ab));
            if c.is_none() {
                check("ba", format!("{:?}", labels(profile, &b, &a, None)), format!("{:?}", recorded.ba));
            }
            for word in &file.positions {
                if let Some(expected) = recorded.subgoal[word].as_bool() {
                    check(word, subgoal(profile, word, &a, &b, c.as_ref()).to_string(), expected.to_string());
                }
            }
        }
    }
    for dnf in &file.dnf {
        let clouds =
            dnf.objects.iter().map(|uid| (uid.clone(), cloud(&format!("dnf{}_{uid}", dnf.id)).unwrap())).collect();
        let score = goal_score(Profile::GenManip09, &dnf.goal, &clouds);
        if (score - dnf.score).abs() > 1e-12 {
            wrong.push(format!("goal {}: {score}, not {}", dnf.id, dnf.score));
        }
    }
    for (index, case) in file.articulation.iter().enumerate() {
        let got: Vec<bool> = case.status.iter().map(|status| articulation(&case.positions, status)).collect();
        if got != case.r#match {
            wrong.push(format!("articulation {index}: {got:?}"));
        }
    }
    eprintln!(
        "{} cases, {excluded} excluded, crops [other, equal] {crops:?}, {} goals",
        file.cases.len(),
        file.dnf.len()
    );
    wrong
}

/// The whole recorded files, where `GENMANIP_RELATIONS` names their folder.
#[test]
#[ignore = "needs the recorded files"]
fn recorded_files() {
    let folder = std::path::PathBuf::from(std::env::var("GENMANIP_RELATIONS").unwrap());
    for name in ["cases_s1", "cases_s2", "cases_s3_big"] {
        let json = std::fs::read_to_string(folder.join(format!("{name}.json"))).unwrap();
        let npz = std::fs::read(folder.join(format!("{name}.npz"))).unwrap();
        let start = std::time::Instant::now();
        let wrong = compare(&json, &npz);
        eprintln!("{name} {:?}: {} wrong\n{}", start.elapsed(), wrong.len(), wrong.join("\n"));
    }
}

/// Calls per second as the fixture counts them: two lists and eleven words per case, clouds built once and counted.
#[test]
#[ignore = "needs the recorded files"]
fn speed() {
    let folder = std::path::PathBuf::from(std::env::var("GENMANIP_RELATIONS").unwrap());
    let file: File = serde_json::from_str(&std::fs::read_to_string(folder.join("cases_s3_big.json")).unwrap()).unwrap();
    let arrays = read_npz(&std::fs::read(folder.join("cases_s3_big.npz")).unwrap(), file.scale).unwrap();
    for profile in [Profile::GenManip09, Profile::Suite023] {
        let mut families: BTreeMap<&str, f64> = BTreeMap::new();
        let mut calls = 0;
        let mut total = 0.0;
        for case in &file.cases {
            let points = |letter: &str| arrays.get(&format!("{}_{letter}", case.id)).cloned();
            let (a, b, c) = (points("a").unwrap(), points("b").unwrap(), points("c"));
            let start = std::time::Instant::now();
            let (a, b, c) = (Cloud::new(a).unwrap(), Cloud::new(b).unwrap(), c.map(|c| Cloud::new(c).unwrap()));
            labels(profile, &a, &b, c.as_ref());
            labels(profile, &b, &a, None);
            for word in &file.positions {
                subgoal(profile, word, &a, &b, c.as_ref());
            }
            let elapsed = start.elapsed().as_secs_f64();
            *families.entry(case.family.as_str()).or_default() += elapsed * 1e3;
            total += elapsed;
            calls += 2 + file.positions.len();
        }
        eprintln!("{profile:?}: {:.0} calls/s; ms per family: {families:.1?}", f64::from(calls as u32) / total);
    }
}
