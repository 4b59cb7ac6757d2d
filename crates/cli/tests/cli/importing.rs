//! Objects from files: into a pack, into tasks, layouts, demonstrations, evaluations and reports, and what is said when
//! the pack is not there.

use std::fs;

use crate::{QUICK, genmanip, program, small_images};

/// A box standing on z = 0, metres.
fn cuboid([x, y, z]: [f64; 3]) -> String {
    let at = |bit: usize, size: f64| if bit == 1 { size } else { 0.0 };
    let corners = (0..8).map(|i| format!("v {} {} {}\n", at(i & 1, x), at(i >> 1 & 1, y), at(i >> 2 & 1, z)));
    corners.collect::<String>() + "f 1 3 4 2\nf 5 6 8 7\nf 1 2 6 5\nf 3 7 8 4\nf 1 5 7 3\nf 2 4 8 6\n"
}

#[test]
fn imported_objects_take_part_from_tasks_to_reports() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    for (name, size) in
        [("sponge.obj", [0.06, 0.09, 0.04]), ("domino.obj", [0.03, 0.05, 0.02]), ("eraser.obj", [0.02, 0.05, 0.03])]
    {
        fs::create_dir_all(here.join("files")).unwrap();
        fs::write(here.join("files").join(name), cuboid(size)).unwrap();
    }
    fs::write(here.join("files/broken.glb"), "glTF").unwrap();
    let import =
        ["--json", "assets", "import", "files", "--pack", "own", "--scale", "1", "--up", "z", "--workers", "2"];
    // One of four is refused, which the exit code says.
    let rows = genmanip(here, &import).json(1);
    let row =
        |name: &str| rows.as_array().unwrap().iter().find(|row| row["file"].as_str().unwrap().contains(name)).unwrap();
    assert!(row("broken")["error"].as_str().unwrap().contains("bytes"), "{rows}");
    for name in ["sponge", "domino", "eraser"] {
        let row = row(name);
        assert!(row["rests"] == true && row["grasps"].as_u64().unwrap() > 0 && row["pieces"] == 1, "{row}");
        assert!(row["guesses"].as_array().unwrap().iter().any(|guess| guess["what"] == "mass"), "{row}");
    }
    for file in ["pack.json", "grasps-panda.json"] {
        assert!(here.join("packs/own").join(file).is_file(), "{file}");
    }
    let listed = genmanip(here, &["--json", "assets", "list", "--catalog", "imported"]).json(0);
    assert_eq!(listed.as_array().unwrap().len(), 3, "packs in the current folder are opened: {listed}");
    let uid = row("sponge")["uid"].as_str().unwrap();
    let shown = genmanip(here, &["--json", "assets", "show", uid]).json(0);
    assert!(shown["grasps"]["tried"].as_u64().unwrap() > 0 && shown["notes"]["licence"] == "unknown", "{shown}");
    assert!(shown["notes"]["source"].as_str().unwrap().contains("sponge.obj"), "{shown}");

    let new = [
        "--json",
        "task",
        "new",
        "--kind",
        "pick_and_place",
        "--count",
        "1",
        "--catalog",
        "imported",
        "--out",
        "tasks",
    ];
    assert_eq!(genmanip(here, &new).code, Some(0));
    let laid_out = genmanip(here, &["layout", "tasks", "--count", "1", "--out", "scenarios"]);
    assert_eq!(laid_out.code, Some(0), "{laid_out:?}");
    let collected =
        genmanip(here, &[&["collect", "tasks", "--world", small_images(), "--out", "run"], &QUICK[..]].concat());
    assert_eq!(collected.code, Some(0), "one attempt suffices for things that were tried: {collected:?}");
    let evaluated = genmanip(here, &["evaluate", "run", "--policy", "expert", "--json"]).json(0);
    assert_eq!(evaluated[0]["summary"]["success"]["value"], 1.0, "{evaluated}");
    assert_eq!(genmanip(here, &["report", "run"]).code, Some(0));
    let html = fs::read_to_string(here.join("run/report.html")).unwrap();
    let named = ["Sponge", "Domino", "Eraser"].iter().filter(|name| html.contains(*name)).count();
    assert!(named > 0 && html.contains("data:image/"), "the report shows none of the imported objects");

    fs::rename(here.join("packs"), here.join("elsewhere")).unwrap();
    genmanip(here, &["layout", "tasks", "--count", "1", "--out", "again"]).assert_refused(&["imported", "pack"]);
    let again = program(here, &["layout", "tasks", "--count", "1", "--out", "again"])
        .env("GENMANIP_PACKS", "elsewhere")
        .output();
    assert!(again.unwrap().status.success());
    let of = |folder: &str| {
        fs::read(
            fs::read_dir(here.join(folder))
                .unwrap()
                .flatten()
                .find(|entry| entry.path().extension().is_some_and(|e| e == "json"))
                .unwrap()
                .path(),
        )
        .unwrap()
    };
    assert!(of("scenarios") == of("again"), "the same pack makes the same layout");
}

/// A foot with a beam that hangs out over one side, so that it tips over; metres, +z up as the format says.
const GALLOWS: &str = r#"<robot name="gallows"><link name="base">
  <visual><origin xyz="0 0 0.03"/><geometry><box size="0.03 0.03 0.06"/></geometry></visual>
  <visual><origin xyz="0.05 0 0.075"/><geometry><box size="0.13 0.03 0.03"/></geometry></visual>
</link></robot>"#;

#[test]
fn what_tips_over_comes_in_as_it_lies() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    fs::write(here.join("gallows.urdf"), GALLOWS).unwrap();
    let import = ["--json", "assets", "import", "gallows.urdf", "--pack", "own", "--scale", "1", "--no-grasps"];
    // The user's word counts: then it only says that it does not stay.
    let rows = genmanip(here, &[&import[..], &["--up", "z"]].concat()).json(0);
    assert!(rows[0]["rests"] == false && rows[0]["repairs"][0].as_str().unwrap().contains("does not stay"), "{rows}");
    let rows = genmanip(here, &import).json(0);
    assert_eq!(rows[0]["rests"], true, "{rows}");
    let guesses = rows[0]["guesses"].as_array().unwrap();
    assert!(guesses.iter().any(|guess| guess["what"] == "upright"), "{rows}");
}
