//! Other worlds: a table of another size, and a side table for objects, from layout to verdict.

use genmanip_assets::worlds::{self, default_world};
use genmanip_core::{Scenario, Seed, World};
use genmanip_layout::{LayoutError, LayoutSettings};
use genmanip_rollout::collect::Attempt;
use genmanip_rollout::{RolloutSettings, run_episode};

use crate::{expert, resources, stage, task_in};

/// A world of the examples.
fn world(name: &str) -> World {
    let path = format!("{}/../../examples/worlds/{name}.toml", env!("CARGO_MANIFEST_DIR"));
    worlds::read(&std::fs::read_to_string(path).unwrap()).unwrap().0
}

/// Scenario of a task of the examples in a world.
fn laid_out(folder: &str, id: &str, world: &World) -> Result<Scenario, LayoutError> {
    let task = task_in(folder, id);
    let attempts = Attempt::all(std::slice::from_ref(&task), 1, Seed::new(23));
    attempts[0].scenario(resources(), world, &LayoutSettings::default())
}

/// Heights at which an object starts and ends when the expert solves a task in a world, mm.
fn solved(folder: &str, id: &str, world: &World, object: &str) -> [f64; 2] {
    let stage = stage(laid_out(folder, id, world).unwrap());
    let index = stage.scenario.index_of(&object.into()).unwrap();
    let episode = run_episode(&stage, &mut expert(&stage), id, Seed::new(5), &RolloutSettings::default()).unwrap();
    assert!(episode.result.success, "{id}: {:?}", episode.result.failures);
    let height = |frame: &genmanip_core::Frame| (frame.objects[index].pose.position.z * 1000.0).round();
    [height(&episode.frames[0]), height(episode.frames.last().unwrap())]
}

/// The top of the example's side table is 100 mm below the table's.
#[test]
fn objects_are_moved_to_near_and_from_a_side_table() {
    let world = world("side_table");
    let check = |id: &str, object: &str, heights: [f64; 2]| {
        let got = solved("worlds/tasks", id, &world, object);
        assert!((got[0] - heights[0]).abs() < 3.0 && (got[1] - heights[1]).abs() < 3.0, "{id}: {got:?} mm");
    };
    check("side_table_on", "027", [0.0, -100.0]);
    check("side_table_near", "001", [0.0, -100.0]);
    check("side_table_beside", "019", [0.0, 0.0]);
    // Onto the plate, whose cavity is some millimetres high.
    let [start, end] = solved("worlds/tasks", "side_table_from", &world, "033");
    assert!((start + 100.0).abs() < 3.0 && (0.0..15.0).contains(&end), "{start} {end} mm");
}

#[test]
fn a_smaller_table_works_too() {
    let world = world("small_table");
    assert!(world.workspace.x[1] < default_world().workspace.x[1], "the example is smaller");
    solved("tasks", "017_pick_and_place", &world, "027");
}

#[test]
fn a_world_without_the_surface_is_rejected() {
    let error = laid_out("worlds/tasks", "side_table_on", &default_world()).unwrap_err();
    assert_eq!(error.to_string(), "the task needs surface `side_table`, but the world has only a table");
}
