//! A short campaign of every target, inside the test itself.

use std::convert::Infallible;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::AtomicBool;

use genmanip_rollout::collect::in_parallel;

use super::*;

/// Mutated inputs per target.
const INPUTS: u64 = 200;

#[test]
fn valid_inputs_are_accepted_and_mutated_ones_break_nothing() {
    let done = in_parallel(TARGETS, 2, &AtomicBool::new(false), &|target| {
        check(target);
        Ok::<_, Infallible>(())
    });
    assert_eq!(done.map(|done| done.len()), Ok(TARGETS.len()));
}

fn check(target: &Target) {
    let mut opened = (target.open)(target.name, &repository()).unwrap();
    for input in &opened.corpus {
        let read = (opened.read)(input);
        let files = || input.files.iter().map(|file| &file.0).collect::<Vec<_>>();
        assert_eq!(read, Ok(()), "{}: {:?}", target.name, files());
    }
    let (mut accepted, mut refused) = (0, 0);
    for index in 0..INPUTS {
        let input = Input::mutated(target, &opened.corpus, 0, index);
        match catch_unwind(AssertUnwindSafe(|| (opened.read)(&input))) {
            Ok(Ok(())) => accepted += 1,
            Ok(Err(_)) => refused += 1,
            Err(_) => {
                let folder = input.save(target, 0, index).unwrap();
                panic!("repeat with: cargo xtask fuzz {} --input {}", target.name, folder.display());
            }
        }
    }
    assert!(accepted > 0 && refused > 0, "{}: {accepted} accepted, {refused} refused", target.name);
}

#[test]
fn an_input_is_a_function_of_seed_and_number() {
    let target = targets::named("worlds").unwrap();
    let corpus = (target.open)(target.name, &repository()).unwrap().corpus;
    let input = |seed, index| Input::mutated(target, &corpus, seed, index);
    assert_eq!(input(1, 7), input(1, 7));
    assert_ne!(input(1, 7), input(1, 8));
    assert_ne!(input(1, 7), input(2, 7));
}
