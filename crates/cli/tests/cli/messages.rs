//! Messages and exit codes, a line each: what was typed or found, how the program ends, and what it must say.

use std::fs;

use genmanip_assets::GraspFile;
use genmanip_core::Document;
use serde_json::{Value, json};

use crate::{copy_of_finished_run, either_program, example, genmanip, quick_examples, small_images};

/// A call, the exit code it ends with, and what its message must contain.
type Case = (&'static str, i32, &'static [&'static str]);

const CASES: [Case; 68] = [
    // Seeds are kept in JSON, exact to 53 bits.
    ("layout task.json --out out --seed 9007199254740992", 2, &["from 0 to 9007199254740991"]),
    ("lab design --seed 18446744073709551615", 2, &["from 0 to 9007199254740991"]),
    ("export --mjcf large_seed.json", 1, &["large_seed.json", "at $.seed: expected a seed of at most"]),
    ("export --glb large_seed.json --out scene.glb", 1, &["large_seed.json", "at $.seed: expected a seed of at most"]),
    ("export --glb scenario.json", 2, &["--out"]),
    // A negative number is a value, no option.
    ("layout task.json --out out --seed -1", 2, &["'-1' for '--seed", "from 0 to 9007199254740991"]),
    ("collect task.json --out out --episodes -1", 2, &["'-1' for '--episodes", "from 1 to 1000000"]),
    ("lab expert --count -5", 2, &["'-5' for '--count", "from 1 to 1000000"]),
    // Bounds that are meant are said.
    ("plan scenario.json --pick orange --rrt-range 1e-9", 2, &["from 1e-6 to 1e6"]),
    ("lab motion --problems problems.json --rrt-range -2", 2, &["from 1e-6 to 1e6"]),
    ("plan scenario.json --to 0.5,nan,0.3", 2, &["'nan' for '--to", "from -1000 to 1000"]),
    ("plan scenario.json --joints 1e300", 2, &["'1e300' for '--joints", "from -1000 to 1000"]),
    ("plan scenario.json --to 0.5,0,0.3 --gripper inf", 2, &["'inf' for '--gripper", "from -1000 to 1000"]),
    // What is typed and cannot be is exit 2, whoever notices it.
    ("evaluate run --policy expret", 2, &["unknown policy `expret`", "did you mean `expert`?"]),
    ("task new --kind cooking --out out", 2, &["unknown kind `cooking`", "kinds are"]),
    ("task check bare.txt --objects 001 --kind cooking", 2, &["unknown kind `cooking`", "kinds are"]),
    ("task new --designer magic --out out", 2, &["unknown designer `magic`", "rules or llm"]),
    ("task new --robot pandas --out out", 1, &["robot `pandas` cannot be used", "panda"]),
    ("task new --designer llm --robot panda --out out", 2, &["--robot is for rules", "--objects"]),
    ("task new --designer rules --copies 2 --out out", 2, &["--copies 2", "0 to 1"]),
    ("evaluate run --policy do_nothing:seconds=-0.0", 1, &["seconds=-0.0 is not possible", "from 0 to 600"]),
    ("lab segment --masks banana", 1, &["unknown source of masks `banana`", "oracle, rgbd"]),
    ("lab grasp --grasps banana", 1, &["unknown source of grasps `banana`", "rgbd"]),
    // A server that is not there is not asked for each of 200 scenarios.
    (
        "evaluate --suite genmanip-200-rc --policy openpi:url=ws://127.0.0.1:1 --workers 1",
        1,
        &["3 episodes in a row were not run", "refused", "--keep-going"],
    ),
    // Texts that are no JSON, each with what is wrong with it.
    ("task show bom.json", 1, &["bom.json", "byte order mark"]),
    ("task show utf16.json", 1, &["utf16.json", "UTF-16"]),
    ("task show empty.json", 1, &["empty.json", "the file is empty"]),
    ("task show cut.json", 1, &["cut.json", "ends too early"]),
    ("task show nan.json", 1, &["nan.json", "no NaN"]),
    ("task show twice.json", 1, &["twice.json", "key `id` occurs twice", "keep one"]),
    ("task check bom.json", 1, &["bom.json", "byte order mark"]),
    ("task check cut.json", 1, &["cut.json", "ends too early"]),
    ("task check twice_answer.json", 1, &["twice_answer.json", "key `objects` occurs twice"]),
    ("camera list twice_world.json", 1, &["twice_world.json", "key `light` occurs twice"]),
    ("export --mjcf utf16.json", 1, &["utf16.json", "UTF-16"]),
    ("export --mjcf empty.json", 1, &["empty.json", "the file is empty"]),
    ("lab motion --problems cut.json", 1, &["cut.json", "ends too early"]),
    ("lab motion --problems twice_problem.json", 1, &["twice_problem.json", "key `start` occurs twice"]),
    ("evaluate scenario.json --policy do_nothing --cameras cut.json", 1, &["cut.json", "ends too early"]),
    (
        "evaluate scenario.json --policy do_nothing --cameras flat.json",
        1,
        &["flat.json", "cameras[0].intrinsics", "0x"],
    ),
    // More small values than fit into the memory that a reader may need.
    ("lab motion --problems many.json", 1, &["many.json", "256 MiB of memory", "fewer values"]),
    // Each message says where, what was expected, what was found and what helps.
    (
        "task check unknown_object.json",
        1,
        &["unknown_object.json: at $.objects", "no object has uid \"099\"", "001 to 064"],
    ),
    ("camera preview no_camera.toml --out x.png", 1, &["no_camera.toml has no camera", "camera add"]),
    ("camera list odd_engine.toml", 1, &["physics.engine.solver_iterations", "a whole number from 1", "got 0.5"]),
    (
        "lab motion --generate easy --count 2 --robot short.urdf",
        1,
        &["got only 0 of 2 problems", "robot `short`", "reaches a table 0.3-0.75 m"],
    ),
    // A file that is too large is named as what it should be.
    ("task show large.json", 1, &["large.json is larger than a task or recorded answer may be: 4 MiB"]),
    ("world check large.toml", 1, &["large.toml is larger than a world may be: 2 MiB"]),
    ("task new --designer llm --settings large.toml --out out", 1, &["large.toml", "a settings file", "1 MiB"]),
    ("lab motion --generate easy --robot large.urdf", 1, &["large.urdf", "a robot description", "8 MiB"]),
    // A robot in millimetres.
    (
        "lab motion --generate easy --robot millimetres.urdf",
        1,
        &["millimetres.urdf", "origin should be", "is this in millimetres?"],
    ),
    // Problems of another robot.
    ("lab motion --problems problems.json", 1, &["problems.json", "problems[0].start", "expected 7", "got 6"]),
    ("lab motion --problems far.json", 1, &["far.json", "problems[0].obstacles[0]", "expected", "got"]),
    // A run that was started otherwise.
    (
        "collect --out run 021 024 --world small.toml --episodes 1 --fps 15",
        1,
        &["holds another run (settings.images.fps is 10, not 15)"],
    ),
    (
        "collect --out run 021 --world small.toml --episodes 1 --fps 10",
        1,
        &["its tasks are 021_spatial, 024_appearance, not 021_spatial"],
    ),
    (
        "collect --out run 021 024 --world small.toml --episodes 1 --fps 10 --no-dataset",
        1,
        &["settings.images is set, not none"],
    ),
    (
        "collect --out new 021 --no-dataset --variation per-episode --vary light,physics",
        2,
        &["--no-dataset draws no pictures", "only `--vary physics`"],
    ),
    ("collect --out new 021 --variation per-episode --vary lamp", 2, &["light, background", "physics"]),
    // Files that hold something else than they should name themselves.
    ("grasps show 001 --file stale.json", 1, &["stale.json: cannot be used", "expected physics hash v2:0", "bake"]),
    ("grasps show 001 --file other.json", 1, &["other.json: holds no tried grasps of object 001", "bake"]),
    (
        "evaluate odd_knob.json --policy do_nothing",
        1,
        &["odd_knob.json cannot be set up", "contact_solref", "expected two numbers", "lay its task out again"],
    ),
    (
        "evaluate odd_robot.json --policy do_nothing",
        1,
        &["odd_robot.json cannot be set up", "physics_hash", "expected v2:0", "lay its task out again"],
    ),
    (
        "evaluate odd_object.json --policy do_nothing",
        1,
        &["evaluating do_nothing stopped", "episode 021_spatial-000", "expected physics hash v2:0"],
    ),
    ("lab fit alike.jsonl", 1, &["alike.jsonl: found 0 trials", "expected held and lost grasps"]),
    ("task show crowd.json", 1, &["crowd.json: at $.scene_graph.nodes", "expected at most 64 entries, got 65"]),
    // A picture in a format that nobody writes.
    ("replay run --strip film.bmp", 1, &["cannot write a film strip as film.bmp", ".jpg"]),
    ("replay run --strip film", 1, &["cannot write a film strip as film", ".jpg"]),
    ("plan scenario.json --pick 046 --picture x.gif", 1, &["x.gif", ".png or .jpg"]),
    ("lab relations --cases cases.json --profile magic", 1, &["there is no profile `magic`", "genmanip-0.9"]),
];

fn workplace() -> tempfile::TempDir {
    let folder = copy_of_finished_run();
    let write = |name: &str, bytes: &[u8]| fs::write(folder.path().join(name), bytes).unwrap();
    let read = |name: &str| fs::read(folder.path().join(name)).unwrap();
    let scenario = read("run/scenarios/021_spatial-000.json");
    write("scenario.json", &scenario);
    let mut changed: Value = serde_json::from_slice(&scenario).unwrap();
    changed["seed"] = u64::MAX.into();
    write("large_seed.json", changed.to_string().as_bytes());
    fs::copy(example("021_spatial"), folder.path().join("task.json")).unwrap();
    fs::copy(small_images(), folder.path().join("small.toml")).unwrap();
    write("bom.json", b"\xef\xbb\xbf{}");
    write("utf16.json", b"\xff\xfe{\0}\0");
    write("empty.json", b"");
    write("cut.json", b"{\"schema\": [1,");
    write("nan.json", b"{\"a\": NaN}");
    write("twice.json", b"{\"schema\": \"genmanip.task/2\", \"id\": \"a\", \"id\": \"b\"}");
    write("twice_answer.json", b"{\"objects\": [], \"objects\": []}");
    write("twice_world.json", b"{\"schema\": \"genmanip.world/1\", \"light\": 1, \"light\": 2}");
    write("bare.txt", b"{}");
    write("many.json", format!("[{}0]", "[0],".repeat(1 << 20)).as_bytes());
    let answer = json!({"task_type": "spatial", "objects": ["099"], "num_objects": 1, "response": "{}"});
    write("unknown_object.json", answer.to_string().as_bytes());
    let world = genmanip(folder.path(), &["world", "init"]).stdout;
    write("odd_engine.toml", world.replace("solver_iterations = ", "solver_iterations = 0.5 # ").as_bytes());
    write("no_camera.toml", world.split("[[cameras]]").next().unwrap().as_bytes());
    let link = "<link name=\"a\"/><link name=\"b\"/><joint name=\"j\" type=\"revolute\"><parent link=\"a\"/>\
                <child link=\"b\"/><axis xyz=\"0 0 1\"/><limit lower=\"-1\" upper=\"1\" velocity=\"1\"/></joint>";
    write("short.urdf", format!("<robot name=\"short\">{link}</robot>").as_bytes());
    write("large.json", &vec![b' '; (4 << 20) + 1]);
    write("large.toml", &vec![b' '; (8 << 20) + 1]);
    write("large.urdf", &vec![b' '; (8 << 20) + 1]);
    let joint = "<joint name=\"j\" type=\"revolute\"><parent link=\"a\"/><child link=\"b\"/><origin xyz=\"0 0 333\"/>\
                 <limit lower=\"-1\" upper=\"1\" velocity=\"1\"/></joint>";
    write(
        "millimetres.urdf",
        format!("<robot name=\"r\"><link name=\"a\"/><link name=\"b\"/>{joint}</robot>").as_bytes(),
    );
    let problem = |dof: usize, size: f64| {
        let obstacle = json!({"type": "box", "size": [size, 1, 1], "pos": [2, 0, 0]});
        json!({"problems": [{"start": vec![0.0; dof], "goal": vec![0.1; dof], "obstacles": [obstacle]}]}).to_string()
    };
    write("problems.json", problem(6, 0.1).as_bytes());
    write("far.json", problem(7, 1e9).as_bytes());
    write(
        "twice_problem.json",
        b"{\"problems\": [{\"start\": [0], \"start\": [0], \"goal\": [0], \"obstacles\": []}]}",
    );
    let with = |place: &str, value: Value| {
        let mut scenario: Value = serde_json::from_slice(&scenario).unwrap();
        *scenario.pointer_mut(place).unwrap() = value;
        scenario.to_string()
    };
    write("odd_knob.json", with("/world/physics/engine/contact_solref", json!([0.02])).as_bytes());
    write("odd_robot.json", with("/world/robot/physics_hash", "v2:0".into()).as_bytes());
    write("odd_object.json", with("/objects/0/physics_hash", "v2:0".into()).as_bytes());
    write("alike.jsonl", b"");
    let mut crowd: Value = serde_json::from_slice(&read("run/run.json")).unwrap();
    let mut crowd = crowd["tasks"][0].take();
    crowd["schema"] = "genmanip.task/2".into();
    crowd["scene_graph"]["nodes"] = vec![crowd["scene_graph"]["nodes"][0].clone(); 65].into();
    write("crowd.json", crowd.to_string().as_bytes());
    let grasps = |uid: &str| {
        let mut file = GraspFile::builtin().to_value();
        file["objects"] = json!({uid: {"physics_hash": "v2:0", "grasps": []}});
        file.to_string()
    };
    write("stale.json", grasps("001").as_bytes());
    write("other.json", grasps("002").as_bytes());
    let mut cameras = changed["world"]["cameras"].clone();
    cameras[0]["intrinsics"]["width"] = 0.into();
    write("flat.json", cameras.to_string().as_bytes());
    folder
}

#[test]
fn every_mistake_has_its_message_and_exit_code() {
    let folder = workplace();
    let [task_021, task_024]: [String; 2] = quick_examples().try_into().unwrap();
    for (case, code, wanted) in CASES {
        let named = case.replace(" 021", &format!(" {task_021}")).replace(" 024", &format!(" {task_024}"));
        let arguments: Vec<&str> = named.split(' ').collect();
        let outcome = either_program(folder.path(), &arguments);
        assert_eq!(outcome.code, Some(code), "{case}: {outcome:?}");
        assert_eq!(outcome.stderr.matches("error:").count(), 1, "{case}: {outcome:?}");
        assert_eq!(outcome.stdout, "", "{case}: {outcome:?}");
        assert!(!outcome.stderr.contains("-- -1"), "{case}: {outcome:?}");
        for part in wanted {
            assert!(outcome.stderr.contains(part), "{case}: `{part}` is missing in\n{}", outcome.stderr);
        }
    }
}

#[test]
fn results_say_what_they_are_of() {
    let folder = copy_of_finished_run();
    let run = folder.path().join("run");
    // The folder is called by its name also where the path does not say it.
    for path in [".", "../run", "../run/"] {
        let printed = genmanip(&run, &["evaluate", path, "--policy", "do_nothing:seconds=0.1", "--json"]).json(0);
        assert_eq!(printed[0]["suite"], "run", "{path}");
    }
    // A film strip is listed.
    let rows = genmanip(folder.path(), &["replay", "run", "--strip", "film.jpg", "--json"]).json(0);
    assert_eq!((&rows[0]["strip"], &rows[0]["identical"]), (&"film-021_spatial-000.jpg".into(), &Value::Null));
    // A table of no attempts has no negative time.
    let help = genmanip(folder.path(), &["--help"]).stdout;
    assert!(help.contains("130"), "exit codes are documented: {help}");
}
