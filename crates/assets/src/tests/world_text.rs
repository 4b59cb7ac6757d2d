//! Changes of world files as text, against the same changes of the parsed world.

use genmanip_core::World;
use genmanip_core::glam::DVec3;

use crate::world_text::WorldText;
use crate::worlds::{self, DEFAULT_TEXT};

/// Applies a change to a text and to its world: both agree, and every other comment of the text is kept.
fn check(name: &str, text: &str, lost: &[&str], change: impl Fn(&mut WorldText), expected: impl Fn(&mut World)) {
    let (mut world, _) = worlds::read(text).unwrap();
    expected(&mut world);
    let mut changed = WorldText::read(text).unwrap();
    change(&mut changed);
    let changed = changed.to_string();
    assert_eq!(worlds::read(&changed).unwrap().0, world, "{name}:\n{changed}");
    let comments = text.lines().filter_map(|line| Some(line.split_once('#')?.1.trim()));
    for comment in comments.filter(|comment| !lost.iter().any(|word| comment.contains(word))) {
        assert!(changed.contains(comment), "{name} loses `{comment}`");
    }
}

#[test]
fn values_and_cameras_change_in_place() {
    let wrist = worlds::default_world().cameras[4].clone();
    let mut moved = wrist.clone();
    moved.mount_from_camera.position = DVec3::new(0.1, 0.2, 0.1 + 0.2);
    let named = |name: &str| genmanip_core::Camera { name: name.into(), ..moved.clone() };
    check("nothing", DEFAULT_TEXT, &[], |_| (), |_| ());
    let friction = |text: &mut WorldText| text.set_entry("surfaces", 0, "friction", &0.45).unwrap();
    check("an entry of a list", DEFAULT_TEXT, &[], friction, |world| world.surfaces[0].friction = 0.45);
    let pads = |text: &mut WorldText| text.set(&["physics"], "pad_friction", &0.8).unwrap();
    check("a missing key", DEFAULT_TEXT, &[], pads, |world| world.physics.pad_friction = 0.8);
    let put = |text: &mut WorldText| text.put_camera(4, &moved).unwrap();
    check("a camera", DEFAULT_TEXT, &[], put, |world| world.cameras[4] = moved.clone());
    let add = |text: &mut WorldText| text.put_camera(5, &named("new")).unwrap();
    check("a new camera", DEFAULT_TEXT, &[], add, |world| world.cameras.push(named("new")));
    for (index, lost) in [(0, &[][..]), (2, &[]), (4, &["Mounted on the hand"])] {
        let remove = |text: &mut WorldText| text.remove_camera(index).unwrap();
        check("no camera", DEFAULT_TEXT, lost, remove, |world| drop(world.cameras.remove(index)));
    }
}

#[test]
fn a_list_on_one_line_becomes_tables() {
    let (before, cameras) = DEFAULT_TEXT.split_once("[[cameras]]").unwrap();
    assert!(cameras.contains("wrist"));
    let inline = "cameras = [{ name = \"a\", mount = \"hand\", size_px = [64, 36], vertical_fov_deg = 40.0 }]\n";
    let text = before.replacen("schema", &format!("{inline}schema"), 1);
    let camera = worlds::default_world().cameras[0].clone();
    let add = |text: &mut WorldText| text.put_camera(1, &camera).unwrap();
    check("an inline list", &text, &[], add, |world| world.cameras.push(camera.clone()));
}

#[test]
fn what_is_no_table_is_refused() {
    let mut text = WorldText::read("robot = 3\ncameras = \"none\"\n").unwrap();
    let camera = &worlds::default_world().cameras[0];
    assert!(text.set(&["robot"], "name", &"panda").unwrap_err().to_string().contains("`robot` is no table"));
    assert!(text.put_camera(0, camera).unwrap_err().to_string().contains("`cameras` is no list of tables"));
    assert!(text.set_entry("surfaces", 0, "friction", &0.3).unwrap_err().to_string().contains("surfaces[0]"));
    assert!(WorldText::read("a = [").unwrap_err().to_string().contains("line 1"));
}
