//! `genmanip-lab strangers`: a folder with a robot that is read, one that is refused, and one that is always in collision.

use crate::lab;

const ARM: &str = r#"<robot name="two"><link name="base"/><link name="a"/><link name="b">BODY</link><link name="c"/>
  <joint name="one" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/><limit lower="-1" upper="1"/></joint>
  <joint name="two" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/><limit lower="-1" upper="1"/></joint>
  <joint name="three" type="revolute"><parent link="b"/><child link="c"/><axis xyz="0 1 0"/><limit lower="-1" upper="1"/></joint>
  </robot>"#;

#[test]
fn strangers_are_counted_by_outcome() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, body: &str| {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, ARM.replace("BODY", body)).unwrap();
    };
    write("a/plain.urdf", "<collision><geometry><sphere radius='0.1'/></geometry></collision>");
    write("b/gone.urdf", "<collision><geometry><mesh filename='gone.stl'/></geometry></collision>");
    write("c/macro.urdf", "<xacro:body/>");
    std::fs::write(folder.path().join("cube.obj"), CUBE).unwrap();
    let measured = lab(folder.path(), &["strangers", ".", "--pairs", "2", "--json"]).json(0);
    let counts = |of: &serde_json::Value| {
        ["tried", "ok", "said", "silent", "wrong", "crashed", "slow"].map(|key| of[key].as_u64().unwrap())
    };
    assert_eq!(counts(&measured), [4, 2, 2, 0, 0, 0, 0], "{measured}");
    assert_eq!(counts(&measured["by_kind"]["robot"]), [3, 1, 2, 0, 0, 0, 0], "{measured}");
    assert_eq!((&measured["without_meshes"], &measured["robots"][0]["planned"]["solved"]), (&1.into(), &2.into()));
    assert!(measured["problems"][1]["message"].as_str().unwrap().contains("must be expanded first"), "{measured}");
    lab(folder.path(), &["strangers", ".", "--kinds", "dataset"]).assert_refused(&["nothing to try", "LeRobot"]);
}

const CUBE: &str = "v 0 0 0\nv 4 0 0\nv 0 4 0\nv 4 4 0\nv 0 0 4\nv 4 0 4\nv 0 4 4\nv 4 4 4\n\
                    f 1 3 4 2\nf 5 6 8 7\nf 1 2 6 5\nf 3 7 8 4\nf 1 5 7 3\nf 2 4 8 6\n";
