//! Robots of the user: found in a folder, chosen by name, refused with the place of the mistake.

use std::fs;

use serde_json::json;

use crate::{REPOSITORY, genmanip};

#[test]
fn a_robot_of_a_folder_is_chosen_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let call = |line: &str| genmanip(folder.path(), &line.split(' ').collect::<Vec<_>>());
    call("world init --robot ur5e_panda_hand --json").assert_refused(&["ur5e_panda_hand", "ur5e_2f85"]);

    let examples = format!("{REPOSITORY}/examples/robots");
    let world = call(&format!("world init --robots {examples} --robot ur5e_panda_hand --json")).json(0);
    assert_eq!(world["robot"]["name"], json!("ur5e_panda_hand"));
    assert_eq!(world["robot"]["home"].as_array().unwrap().len(), 6);

    // Without the option, `robots` in the current folder.
    fs::create_dir(folder.path().join("robots")).unwrap();
    let text = fs::read_to_string(format!("{examples}/ur5e_panda_hand.json")).unwrap();
    let write = |text: &str| fs::write(folder.path().join("robots/mine.json"), text).unwrap();
    write(&text);
    assert_eq!(call("world init --robot ur5e_panda_hand --out world.toml").code, Some(0));
    assert_eq!(call("world check world.toml --json").json(0)["valid"], json!(true));

    write(&text.replace("\"on\": \"ur5e\"", "\"on\": \"ur7\""));
    call("world check world.toml").assert_refused(&["robots/mine.json", "no arm is called \"ur7\"", "panda, ur5e"]);
    write(&text.replace("-90]", "\"down\"]"));
    call("world check world.toml").assert_refused(&["robots/mine.json", "mount.rpy_deg[2]"]);
}
