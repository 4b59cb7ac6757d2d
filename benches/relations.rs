//! Verdicts on posed geometry.

use divan::{Bencher, black_box};
use genmanip::relations::{RelationSettings, Rest, judge_goal, label_pair};
use genmanip::rollout::Stage;
use genmanip::workspace::scenarios::read_stage;

fn stage() -> Stage {
    read_stage(&crate::repository(crate::render::SCENARIO)).expect("the suite's scenarios are those of this program")
}

/// The goal of a task.
#[divan::bench]
fn goal(bencher: Bencher) {
    let (stage, rest) = (stage(), Rest::default());
    bencher.bench_local(|| judge_goal(black_box(stage.start()), &stage.goal, &rest, &RelationSettings::default()));
}

/// The relations of all pairs of objects.
#[divan::bench]
fn all_pairs(bencher: Bencher) {
    let stage = stage();
    let scene = stage.start();
    let count = scene.objects().len();
    bencher.bench_local(|| {
        let pairs = (0..count).flat_map(|a| (0..count).filter(move |b| *b != a).map(move |b| (a, b)));
        pairs.filter(|&(a, b)| label_pair(black_box(scene), a, b, &RelationSettings::default()).is_some()).count()
    });
}
