use std::time::Instant;

use genmanip_core::{Atom, Relation};
use proptest::prelude::*;

use super::cases::{compare, compare_seed};
use super::npz::read_npz;
use super::*;
use crate::{CloudScene, RelationSettings};

const PROFILES: [Profile; 2] = [Profile::GenManip09, Profile::Suite023];

/// Reproduces a sample of the recorded verdicts: four small cases of each family, twelve goals, twenty joint states.
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
fn what_is_no_cloud_is_refused() {
    let check = |points: Vec<[f64; 3]>, expected: CloudError| assert_eq!(Cloud::new(points).unwrap_err(), expected);
    check(Vec::new(), CloudError::Empty);
    for odd in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        check(vec![[0.0; 3], [odd, 0.0, 0.0]], CloudError::NotFinite { index: 1 });
    }
    check(vec![[0.0; 3], [0.0; 3], [0.0, -1e300, 0.0]], CloudError::TooFar { index: 2 });
}

/// Judges two clouds in every profile, in both directions: verdicts come in reasonable time and are plausible.
fn judge_in_all_profiles(a: &[[f64; 3]], b: &[[f64; 3]]) {
    let cloud = |points: &[[f64; 3]]| Cloud::new(points.to_vec()).unwrap();
    let (one, other) = (cloud(a), cloud(b));
    for profile in PROFILES {
        labels(profile, &one, &other, Some(&one));
        labels(profile, &one, &other, None);
        subgoal(profile, "on", &one, &other, None);
        assert!(!subgoal(profile, "no such word", &one, &other, None));
    }
    let scene = CloudScene::new([("a".into(), one), ("b".into(), other)]);
    let settings = RelationSettings::default();
    let pair = scene.label_pair(0, 1, &settings).unwrap();
    assert_eq!(scene.label_pair(1, 0, &settings).unwrap().a_to_b, pair.b_to_a, "{pair:?}");
    for (relation, second) in [(Relation::Near, None), (Relation::Top, None), (Relation::Between, Some("a".into()))] {
        let atom =
            Atom::Relation { subject: "a".parse().unwrap(), relation, reference: "b".into(), second_reference: second };
        let verdict = scene.judge_atom(&atom, &settings);
        assert!(verdict.margin.is_finite() && !verdict.measurements.is_empty(), "{verdict:?}");
    }
}

#[test]
fn odd_clouds_get_verdicts() {
    let line: Vec<[f64; 3]> = (0..40).map(|index| [f64::from(index) * 0.001, 0.0, 0.0]).collect();
    let sheet = (0..40).flat_map(|i| (0..40).map(move |j| [f64::from(i) * 0.002, f64::from(j) * 0.002, 0.01]));
    let odd = [
        vec![[0.0; 3]],
        vec![[0.0; 3]; 50],
        vec![[0.0; 3], [0.01, 0.0, 0.0]],
        line.clone(),
        line.iter().map(|p| [p[0], p[0], p[0]]).collect(),
        line.iter().map(|p| [0.0, 0.0, p[0]]).collect(),
        sheet.clone().collect(),
        sheet.clone().map(|[x, y, z]| [z, x, y]).collect(),
        vec![[-1e6, -1e6, -1e6], [1e6, 1e6, 1e6], [1e6, -1e6, 0.0], [0.0, 0.0, 1e6], [0.0; 3]],
        vec![[1e-300, 0.0, 0.0], [0.0, 1e-300, 0.0], [0.0, 0.0, 1e-300], [0.0; 3], [1e-300; 3]],
    ];
    for a in &odd {
        for b in &odd {
            judge_in_all_profiles(a, b);
        }
    }
}

/// Large clouds take less than minutes. `lab relations` measures the speed.
#[test]
fn large_clouds_get_verdicts() {
    let spread = |scale: f64, count: u32| -> Vec<[f64; 3]> {
        (0..count)
            .map(|index| [0.754_877, 0.569_840, 0.438_579].map(|step| f64::from(index) * step % 1.0 * scale))
            .collect()
    };
    judge_in_all_profiles(&spread(0.1, 120_000), &spread(0.3, 2000));
    judge_in_all_profiles(&vec![[0.5, 0.0, 0.1]; 120_000], &spread(0.3, 2000));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(150))]

    /// Points on a coarse grid contain many collinear, coplanar and repeated ones.
    #[test]
    fn clouds_on_a_grid_get_verdicts(
        a in prop::collection::vec(prop::array::uniform3(-3..3i8), 1..60),
        b in prop::collection::vec(prop::array::uniform3(-3..3i8), 1..60),
        exponent in -9..6i32,
    ) {
        let points = |grid: &[[i8; 3]]| -> Vec<[f64; 3]> {
            grid.iter().map(|point| point.map(|value| f64::from(value) * 10f64.powi(exponent))).collect()
        };
        judge_in_all_profiles(&points(&a), &points(&b));
    }
}

/// A zip archive with one stored or deflated member and the given declared size.
fn archive(member: &[u8], deflated: bool, size: Option<u32>) -> Vec<u8> {
    let data = if deflated { miniz_oxide::deflate::compress_to_vec(member, 6) } else { member.to_vec() };
    let size = size.unwrap_or(member.len() as u32).to_le_bytes();
    let packed = (data.len() as u32).to_le_bytes();
    let method = if deflated { [8, 0] } else { [0, 0] };
    let mut bytes =
        [b"PK\x03\x04".as_slice(), &[20, 0, 0, 0], &method, &[0; 8], &packed, &size, &[5, 0, 0, 0], b"a.npy"].concat();
    bytes.extend(&data);
    let directory = bytes.len() as u32;
    let entry = [
        b"PK\x01\x02".as_slice(),
        &[20, 0, 20, 0, 0, 0],
        &method,
        &[0; 8],
        &packed,
        &size,
        &[5, 0],
        &[0; 16],
        b"a.npy",
    ];
    bytes.extend(entry.concat());
    let length = (bytes.len() as u32 - directory).to_le_bytes();
    let end = [b"PK\x05\x06".as_slice(), &[0; 4], &[1, 0, 1, 0], &length, &directory.to_le_bytes(), &[0, 0]];
    bytes.extend(end.concat());
    bytes
}

fn array(header: &str, data: &[u8]) -> Vec<u8> {
    let length = (header.len() as u16).to_le_bytes();
    [b"\x93NUMPY\x01\x00".as_slice(), &length, header.as_bytes(), data].concat()
}

#[test]
fn arrays_that_are_no_clouds_are_refused() {
    let good = "{'descr': '<i2', 'fortran_order': False, 'shape': (2, 3), }";
    let check = |bytes: &[u8], expected: &str| match (read_npz(bytes, 1e4), expected) {
        (Ok(arrays), "") => assert_eq!(arrays["a"].len(), 2),
        (Err(error), _) if !expected.is_empty() => assert!(error.to_string().contains(expected), "{error}"),
        (other, _) => panic!("{expected}: {other:?}"),
    };
    check(&archive(&array(good, &[0; 12]), false, None), "");
    check(&archive(&array(good, &[0; 12]), true, None), "");
    check(&archive(&array(good, &[0; 11]), false, None), "2 points in 11 bytes");
    check(&archive(&array(&good.replace("<i2", "<f8"), &[0; 48]), false, None), "<f8");
    check(&archive(&array(&good.replace("2, 3", "3, 2"), &[0; 12]), false, None), "3, 2");
    check(&archive(&array(&good.replace("2, 3", "6,"), &[0; 12]), false, None), "(6,)");
    check(&archive(&array(&good.replace("(2", "(99999999999999999999"), &[0; 12]), false, None), "999");
    check(&archive(&array(&good.replace("(2", "(3074457345618258603"), &[0; 12]), false, None), "points in 12 bytes");
    check(&archive(&array(&good.replace("False", "True"), &[0; 12]), false, None), "True");
    check(&archive(b"", false, None), "no NumPy array");
    check(&archive(&array(good, &[0; 12])[..20], false, None), "cut short");
    // Decompression bombs: the declared size is too large, or the actual size exceeds it.
    check(&archive(&vec![0; 1 << 20], true, Some(u32::MAX)), "at most 64 MiB");
    check(&archive(&vec![0; 1 << 20], true, Some(12)), "inflated");
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

/// The profiles treat heights and proximity differently, so they agree on most recorded cases but not on all.
#[test]
fn profile_seed_names_recorded_cases_much_as_the_others_do() {
    let json = include_str!("../../testdata/recorded_clouds.json");
    let report = compare_seed(json, include_bytes!("../../testdata/recorded_clouds.npz"), &mut || 0.0).unwrap();
    assert!(report.compared > 50 && report.agreed * 3 > report.compared * 2, "{report:#?}");
    for broken in ["", "{}", "[1]", &json[..json.len() / 2], &json.replacen("\"scale\": ", "\"scale\": -", 1)] {
        let bytes = include_bytes!("../../testdata/recorded_clouds.npz");
        assert!(compare_seed(broken, bytes, &mut || 0.0).is_err());
        assert!(compare(broken, bytes, Profile::Suite023, &mut || 0.0).is_err());
    }
}

/// All recorded files, from the folder in the environment variable `GENMANIP_RELATIONS`.
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
