//! Each axis changes its own subject, and nothing else.

use genmanip_assets::{Catalogue, GraspLibrary};
use genmanip_core::{Document, Scenario, Seed, TaskKind};
use genmanip_layout::{LayoutSettings, lay_out};
use genmanip_tasks::designer::{DesignSettings, Series};
use serde_json::Value;

use super::Axis;
use super::change::Perturber;
use genmanip_workspace::worlds;

fn scenario() -> Scenario {
    let cards = Catalogue::builtin().cards();
    let (kinds, settings) = ([TaskKind::Appearance], DesignSettings::default());
    let task = Series::new(&kinds, cards, Seed::new(7), &settings, false).unwrap().compose().unwrap();
    let world = worlds::read_world(None).unwrap();
    let planner = Perturber::new(&world, Axis::Layout, 1.0).unwrap().planner;
    let (catalogue, grasps) = (Catalogue::builtin(), GraspLibrary::builtin());
    lay_out(&task, catalogue, &world, &planner, grasps, Seed::new(7), &LayoutSettings::default()).unwrap()
}

/// JSON paths at which two documents differ, down to list entries.
fn differences(ours: &Value, theirs: &Value, place: &str, found: &mut Vec<String>) {
    match (ours, theirs) {
        (Value::Object(a), Value::Object(b)) => {
            let keys: std::collections::BTreeSet<&String> = a.keys().chain(b.keys()).collect();
            for key in keys {
                let null = Value::Null;
                let at = if place.is_empty() { key.clone() } else { format!("{place}.{key}") };
                differences(a.get(key).unwrap_or(&null), b.get(key).unwrap_or(&null), &at, found);
            }
        }
        (Value::Array(a), Value::Array(b)) if a.len() == b.len() => {
            a.iter().zip(b).for_each(|(a, b)| differences(a, b, place, found));
        }
        _ if ours != theirs => found.push(place.to_owned()),
        _ => {}
    }
}

#[test]
fn each_axis_changes_only_what_it_is_about() {
    let scenario = scenario();
    let check = |axis: Axis, places: &[&str]| {
        let change = |dial: f64| {
            let workshop = Perturber::new(&scenario.world, axis, dial).unwrap();
            workshop.change(&scenario, Seed::new(11)).unwrap_or_else(|reason| panic!("{axis}: {reason}"))
        };
        let changed = change(1.0);
        assert_eq!(changed, change(1.0), "{axis}: the same seed, the same scenario");
        assert_eq!((&changed.id, changed.seed), (&scenario.id, scenario.seed), "{axis}: it can be paired");
        let mut found = Vec::new();
        differences(&scenario.to_value(), &changed.to_value(), "", &mut found);
        assert!(!found.is_empty(), "{axis} changes something");
        for place in &found {
            assert!(places.iter().any(|known| place.starts_with(known)), "{axis} changed {place}");
        }
        assert_eq!(Scenario::from_json(&changed.to_json()).unwrap(), changed, "{axis}: it can be read again");
    };
    for axis in Axis::ALL {
        let places: &[&str] = match axis {
            Axis::Layout => &["objects.pose", "objects.joint_positions"],
            Axis::Camera => &["world.cameras.mount_from_camera"],
            Axis::RobotStart => &["world.robot.start"],
            Axis::Light | Axis::Background | Axis::Texture | Axis::Paint => &["world.look"],
            Axis::Sensor => &["world.cameras.sensor"],
            Axis::Physics => &["objects.physics", "world.physics.pad_friction"],
            Axis::Distractors => &["objects"],
            Axis::Wording => &["task.instruction"],
            Axis::Instruction => {
                &["task.instruction", "task.goal", "task.kind", "task.interchangeable", "other_request"]
            }
        };
        check(axis, places);
    }
}

#[test]
fn the_guide_describes_every_axis() {
    let guide = include_str!("../../../../../docs/guides/suites-and-comparisons.md");
    for axis in Axis::ALL {
        let is_row = |line: &str| line.starts_with("| `") && line.contains(&format!("`{axis}`"));
        assert!(guide.lines().any(is_row), "docs/guides/suites-and-comparisons.md has no row of the axis `{axis}`");
    }
}

#[test]
fn things_stay_where_they_are_when_more_are_added() {
    let scenario = scenario();
    let workshop = Perturber::new(&scenario.world, Axis::Distractors, 1.0).unwrap();
    let crowded = workshop.change(&scenario, Seed::new(3)).unwrap();
    assert_eq!(crowded.objects.len(), scenario.objects.len() + 5);
    assert_eq!(crowded.objects[..scenario.objects.len()], scenario.objects);
}
