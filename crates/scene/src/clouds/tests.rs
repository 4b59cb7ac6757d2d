use std::time::Instant;

use super::cases::compare;
use super::npz::read_npz;
use super::*;

const PROFILES: [Profile; 2] = [Profile::GenManip09, Profile::Suite023];

/// Four small cases of each family, twelve goals and twenty joint states of the recorded verdicts.
#[test]
fn recorded_verdicts_are_reproduced() {
    let json = include_str!("../../testdata/recorded_clouds.json");
    for profile in PROFILES {
        let report = compare(json, include_bytes!("../../testdata/recorded_clouds.npz"), profile, &mut || 0.0).unwrap();
        assert!(report.disagreements.is_empty(), "{:#?}", report.disagreements);
        assert_eq!((report.compared, report.agreed, report.excluded), (72, 72, 0));
        let recorded = if profile == Profile::GenManip09 { (12, 20) } else { (0, 0) };
        assert_eq!((report.dnf_agreed, report.articulation_agreed), recorded);
    }
}

#[test]
fn odd_clouds_get_verdicts_or_errors() {
    assert_eq!(Cloud::new(Vec::new()).unwrap_err(), CloudError::Empty);
    assert_eq!(Cloud::new(vec![[0.0; 3], [f64::NAN, 0.0, 0.0]]).unwrap_err(), CloudError::NotFinite { index: 1 });
    let line: Vec<[f64; 3]> = (0..40).map(|index| [f64::from(index) * 0.001, 0.0, 0.0]).collect();
    let odd = [vec![[0.0; 3]], vec![[0.0; 3]; 50], line.clone(), line.iter().map(|p| [p[0], p[0], p[0]]).collect()];
    for a in &odd {
        for b in &odd {
            let (a, b) = (Cloud::new(a.clone()).unwrap(), Cloud::new(b.clone()).unwrap());
            for profile in PROFILES {
                assert!(!labels(profile, &a, &b, None).contains(&CloudLabel::In));
                labels(profile, &a, &b, Some(&a));
                subgoal(profile, "on", &a, &b, None);
                assert!(!subgoal(profile, "no such word", &a, &b, None));
            }
        }
    }
}

#[test]
fn damaged_archives_are_refused() {
    let whole = include_bytes!("../../testdata/recorded_clouds.npz");
    for end in [0, 10, 1000, whole.len() - 30, whole.len() - 1] {
        assert!(read_npz(&whole[..end], 1e4).is_err(), "{end}");
    }
    for flip in (0..whole.len()).step_by(997) {
        let mut bytes = whole.to_vec();
        bytes[flip] ^= 0x55;
        let _ = read_npz(&bytes, 1e4);
    }
}

/// The whole recorded files, from the folder that `GENMANIP_RELATIONS` names.
#[test]
#[ignore = "needs the recorded files"]
#[expect(clippy::print_stderr, reason = "a measurement for people")]
fn recorded_files() {
    let folder = std::path::PathBuf::from(std::env::var("GENMANIP_RELATIONS").unwrap());
    for name in ["cases_s1", "cases_s2", "cases_s3_big"] {
        let json = std::fs::read_to_string(folder.join(format!("{name}.json"))).unwrap();
        let npz = std::fs::read(folder.join(format!("{name}.npz"))).unwrap();
        for profile in PROFILES {
            let start = Instant::now();
            let report = compare(&json, &npz, profile, &mut || start.elapsed().as_secs_f64()).unwrap();
            eprintln!("{name} {profile:?} {}", serde_json::to_string(&report).unwrap());
            assert!(report.disagreements.is_empty());
        }
    }
}
