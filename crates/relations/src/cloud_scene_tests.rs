//! Verdicts on point clouds agree with those on the geometry they were sampled from, and labels of pairs are
//! equivariant under symmetries: rotating, mirroring or swapping the objects permutes the labels accordingly.

use std::f64::consts::TAU;

use genmanip_assets::Catalogue;
use genmanip_core::{Atom, Pose, ReferenceId, Relation, Seed};
use glam::{DQuat, DVec3};
use rand::seq::SliceRandom;
use rand::{Rng, RngExt};

use super::*;
use crate::clouds::Cloud;

const NAMES: [&str; 3] = ["a", "b", "c"];

fn atom(word: Relation, one: usize, other: usize, second: Option<usize>) -> Atom {
    Atom::Relation {
        subject: NAMES[one].parse().unwrap(),
        relation: word,
        reference: NAMES[other].into(),
        second_reference: second.map(|index| NAMES[index].into()),
    }
}

fn clouds(points: Vec<Vec<DVec3>>) -> CloudScene {
    let cloud = |points: Vec<DVec3>| Cloud::new(points.iter().map(DVec3::to_array).collect()).unwrap();
    CloudScene::new(NAMES.map(ReferenceId::from).into_iter().zip(points.into_iter().map(cloud)))
}

/// A random object of the catalogue at z = 0, at most `spread` (m) in x and y from (0.5, 0), with a random yaw.
fn object(name: &str, spread: f64, rng: &mut impl Rng) -> PosedObject {
    let catalogue = Catalogue::builtin();
    let cards = catalogue.cards();
    let model = catalogue.build(&cards[rng.random_range(0..cards.len())].uid).unwrap();
    let place = DVec3::new(0.5 + rng.random_range(-spread..spread), rng.random_range(-spread..spread), 0.0);
    let turn = DQuat::from_rotation_z(rng.random_range(0.0..TAU));
    let joint_positions = vec![0.0; model.joint_count()];
    PosedObject { id: name.parse().unwrap(), model, pose: Pose::new(place, turn), joint_positions }
}

/// Three objects of the catalogue; the first is dropped onto, into or beside the second.
fn arrangement(seed: Seed, shapes: &mut ShapeCache) -> PosedScene {
    let rng = &mut seed.rng();
    let reach = [0.02, 0.1, 0.25][rng.random_range(0..3)];
    let objects = vec![object("a", reach, rng), object("b", 0.01, rng), object("c", 0.3, rng)];
    let mut scene = PosedScene::new(objects, &[], shapes);
    let settings = RelationSettings::default();
    if measure_pair(&scene, 0, 1, &settings).unwrap().gap_m > 0.0 {
        return scene;
    }
    // Lower the first object onto the second.
    let mut lowered = scene.objects().next().unwrap().clone();
    lowered.pose.position.z = 0.6;
    for _ in 0..4 {
        scene.set_pose(0, lowered.pose, &lowered.joint_positions);
        let fall = measure_pair(&scene, 0, 1, &settings).unwrap().a_over_b;
        lowered.pose.position.z -= fall.map_or(0.0, |contact| contact.gap_m);
    }
    scene
}

/// True if the third object does not touch the others.
fn is_possible(scene: &PosedScene) -> bool {
    [0, 1].iter().all(|&one| measure_pair(scene, one, 2, &RelationSettings::default()).unwrap().gap_m > 0.0)
}

/// Verdicts of posed geometry for conditions on three objects.
fn judged(scene: &PosedScene) -> Vec<genmanip_core::AtomVerdict> {
    let pairs = [(0, 1), (1, 0), (0, 2), (2, 1)];
    let atoms = pairs.iter().flat_map(|&(one, other)| Relation::OF_PAIRS.map(|word| atom(word, one, other, None)));
    let atoms = atoms.chain([atom(Relation::Between, 0, 1, Some(2)), atom(Relation::Between, 1, 0, Some(2))]);
    atoms.map(|atom| judge_atom(scene, &atom, &RelationSettings::default())).collect()
}

#[test]
fn clouds_of_posed_geometry_agree_beyond_five_millimetres() {
    let mut shapes = ShapeCache::with_samples(4096);
    let (mut compared, mut disagreements) = (0, Vec::new());
    let scenes = (0..140).map(|index| arrangement(Seed::new(7).fork("sampled").fork_index(index), &mut shapes));
    for (index, scene) in scenes.filter(is_possible).enumerate() {
        let clouds = clouds((0..3).map(|object| scene.surface_points(object)).collect());
        for verdict in judged(&scene).iter().filter(|verdict| is_clear(verdict, 0.005)) {
            let other = clouds.judge_atom(&verdict.atom, &RelationSettings::default());
            compared += 1;
            if other.holds != verdict.holds {
                let names: Vec<&str> = scene.objects().map(|object| object.model.card.name.as_str()).collect();
                disagreements.push(format!(
                    "{index} {names:?} {:?}\n  {}\n  {}",
                    verdict.atom, verdict.explanation, other.explanation
                ));
            }
        }
    }
    assert!(compared > 1500, "{compared}");
    let share = 1.0 - disagreements.len() as f64 / f64::from(compared);
    assert!(share >= 0.995, "{} of {compared}\n{}", disagreements.len(), disagreements.join("\n"));
}

/// Labels of a pair stay equal under translation, reordering and resampling of the points, and are permuted by
/// rotation, mirroring and swapping of the objects.
#[test]
fn moving_turning_mirroring_swapping_shuffling_and_sampling_anew() {
    let settings = RelationSettings::default();
    let (mut dense, mut denser) = (ShapeCache::with_samples(2048), ShapeCache::with_samples(4500));
    let mut labels = std::collections::BTreeSet::new();
    for index in 0..45 {
        let seed = Seed::new(11).fork("metamorphic").fork_index(index);
        let scene = arrangement(seed, &mut dense);
        let words = Relation::OF_PAIRS.map(|word| judge_atom(&scene, &atom(word, 0, 1, None), &settings));
        if !words.iter().all(|verdict| is_clear(verdict, 0.005)) {
            continue;
        }
        let points: Vec<Vec<DVec3>> = (0..2).map(|object| scene.surface_points(object)).collect();
        let label = |points: &[Vec<DVec3>]| clouds(points.to_vec()).label_pair(0, 1, &settings).unwrap();
        let moved = |change: &dyn Fn(DVec3) -> DVec3| -> Vec<Vec<DVec3>> {
            points.iter().map(|cloud| cloud.iter().copied().map(change).collect()).collect()
        };
        let original = label(&points);
        labels.extend(original.a_to_b.map(|label| format!("{label:?}")));

        let swapped = label(&[points[1].clone(), points[0].clone()]);
        assert_eq!((swapped.a_to_b, swapped.b_to_a), (original.b_to_a, original.a_to_b));

        let shifted = label(&moved(&|point| point + DVec3::new(0.313, -0.127, 0.0)));
        assert_eq!(shifted.a_to_b, original.a_to_b, "{original:#?}\n{shifted:#?}");

        let turned = label(&moved(&|point| DVec3::new(-point.y, point.x, point.z)));
        let permuted = original.a_to_b.map(|label| match label {
            Label::Front => Label::Left,
            Label::Left => Label::Back,
            Label::Back => Label::Right,
            Label::Right => Label::Front,
            other => other,
        });
        assert_eq!(turned.a_to_b, permuted, "{original:#?}\n{turned:#?}");

        let mirrored = label(&moved(&|point| DVec3::new(point.x, -point.y, point.z)));
        let exchanged = original.a_to_b.map(|label| match label {
            Label::Left => Label::Right,
            Label::Right => Label::Left,
            other => other,
        });
        assert_eq!(mirrored.a_to_b, exchanged, "{original:#?}\n{mirrored:#?}");

        // The order of the points changes only the last bits of the mean.
        let mut shuffled = points.clone();
        shuffled.iter_mut().for_each(|cloud| cloud.shuffle(&mut seed.rng()));
        let shuffled = label(&shuffled);
        assert_eq!(shuffled.a_to_b, original.a_to_b);
        assert_eq!(
            (shuffled.geometry.gap_m, shuffled.geometry.a_in_b),
            (original.geometry.gap_m, original.geometry.a_in_b)
        );

        let anew = arrangement(seed, &mut denser);
        let anew = label(&(0..2).map(|object| anew.surface_points(object)).collect::<Vec<_>>());
        assert_eq!(anew.a_to_b, original.a_to_b, "{original:#?}\n{anew:#?}");
    }
    assert!(labels.len() >= 6, "{labels:?}");
}
