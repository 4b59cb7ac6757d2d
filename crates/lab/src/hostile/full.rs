//! Files that are as large as their readers take, filled with what costs most.

use genmanip_core::limits::{self, Limit};
use rand::{Rng, RngExt};

/// A reader, its bound, and what its file is filled with.
pub(super) struct Filling {
    /// The file that is filled.
    pub(super) file: &'static str,
    limit: Limit,
    before: &'static str,
    unit: &'static str,
    after: &'static str,
    /// The call that reads it.
    pub(super) call: &'static str,
}

const fn filling(
    file: &'static str,
    limit: Limit,
    [before, unit, after]: [&'static str; 3],
    call: &'static str,
) -> Filling {
    Filling { file, limit, before, unit, after, call }
}

const TASK: &str = "task show task.json";
const SCENARIO: &str = "export --mjcf scenario.json";
const WORLD: &str = "world check world.toml";
const PROBLEMS: &str = "lab motion --problems problems.json --ik-poses 1";
const ROBOT: &str = "lab motion --problems none.json --ik-poses 1 --robot six";
const GRASPS: &str = "grasps show 001 --file grasps.json";
const SETTINGS: &str =
    "task new --designer llm --settings settings.toml --cassettes replay --kind spatial --count 1 --out out";
const EVALUATION: &str = "report run";
const PROBLEM: &str = "{\"start\":[0,0,0,0,0,0,0],\"goal\":[0,0,0,0,0,0,0],\"obstacles\":[]},";
const NODE: &str = "{\"id\":\"001\",\"asset\":{\"source\":\"builtin\",\"uid\":\"001\",\"version\":2}},";

const FILLINGS: [Filling; 33] = [
    filling("task.json", limits::TASK, ["", " ", ""], TASK),
    filling("task.json", limits::TASK, ["", "[", ""], TASK),
    filling("task.json", limits::TASK, ["{\"schema\":\"genmanip.task/2\",\"id\":[", "0,", "0]}"], TASK),
    filling("task.json", limits::TASK, ["{\"schema\":\"genmanip.task/2\",\"id\":[", "{},", "0]}"], TASK),
    filling(
        "task.json",
        limits::TASK,
        ["{\"schema\":\"genmanip.task/2\",\"scene_graph\":{\"nodes\":[", NODE, "0]}}"],
        TASK,
    ),
    filling(
        "task.json",
        limits::TASK,
        ["{\"task_type\":\"spatial\",\"objects\":[", "\"001\",", "\"001\"]}"],
        "task check task.json",
    ),
    filling(
        "task.json",
        limits::TASK,
        ["{\"task_type\":\"spatial\",\"objects\":[\"001\"],\"num_objects\":1,\"response\":\"", "{", "\"}"],
        "task check task.json",
    ),
    filling(
        "scenario.json",
        limits::SCENARIO,
        ["{\"schema\":\"genmanip.scenario/2\",\"objects\":[", "{\"id\":\"1\"},", "0]}"],
        SCENARIO,
    ),
    filling(
        "scenario.json",
        limits::SCENARIO,
        ["{\"schema\":\"genmanip.scenario/2\",\"objects\":[", "0,", "0]}"],
        SCENARIO,
    ),
    filling("scenario.json", limits::SCENARIO, ["{\"schema\":\"genmanip.scenario/2\",\"id\":\"", "x", "\"}"], SCENARIO),
    filling("world.toml", limits::WORLD, ["", "#\n", ""], WORLD),
    filling("world.toml", limits::WORLD, ["", "[[cameras]]\n", ""], WORLD),
    filling("world.toml", limits::WORLD, ["", "[[surfaces]]\n", ""], WORLD),
    filling("world.toml", limits::WORLD, ["a = [", "0,", "0]"], WORLD),
    filling("world.toml", limits::WORLD, ["a = ", "[", ""], WORLD),
    filling("problems.json", limits::PROBLEMS, ["{\"problems\":[", PROBLEM, "0]}"], PROBLEMS),
    filling("problems.json", limits::PROBLEMS, ["{\"problems\":[{\"start\":[", "0,", "0]}]}"], PROBLEMS),
    filling("problems.json", limits::PROBLEMS, ["{\"problems\":[", "{},", "0]}"], PROBLEMS),
    filling("six/six.urdf", limits::ROBOT, ["<robot>", "<link name=\"a\"/>", "</robot>"], ROBOT),
    filling("six/six.urdf", limits::ROBOT, ["<robot>", "<a>", ""], ROBOT),
    filling("six/six.urdf", limits::ROBOT, ["<robot>", "<joint/>", "</robot>"], ROBOT),
    filling(
        "six/six.srdf",
        limits::ROBOT,
        ["<robot>", "<disable_collisions link1=\"base\" link2=\"upper\"/>", "</robot>"],
        ROBOT,
    ),
    filling("six/fore.obj", limits::MESH, ["", "v 0.1 0.1 0.1\n", ""], ROBOT),
    filling("six/fore.obj", limits::MESH, ["", "#\n", ""], ROBOT),
    filling("six/tip.stl", limits::MESH, ["solid\n", "vertex 0.1 0 0\n", ""], ROBOT),
    filling(
        "grasps.json",
        limits::GRASPS,
        ["{\"schema\":\"genmanip.grasps/1\",\"objects\":{\"001\":[", "0,", "0]}}"],
        GRASPS,
    ),
    filling("grasps.json", limits::GRASPS, ["{", "\"a\":1,", "\"b\":1}"], GRASPS),
    filling("settings.toml", limits::SETTINGS, ["", "[prices.a]\n", ""], SETTINGS),
    filling("settings.toml", limits::SETTINGS, ["a = [", "0,", "0]"], SETTINGS),
    filling(
        "run/evaluation/do_nothing_seconds=0.1.json",
        limits::EVALUATION,
        ["{\"schema\":\"genmanip.evaluation/2\",\"results\":[", "{},", "0]}"],
        EVALUATION,
    ),
    filling("run/run.json", limits::RUN, ["{\"schema\":\"genmanip.run/2\",\"tasks\":[", "{},", "0]}"], EVALUATION),
    filling(
        "run/timings.json",
        limits::TIMINGS,
        ["{\"schema\":\"genmanip.timings/1\",\"attempts\":[", "0,", "0]}"],
        EVALUATION,
    ),
    filling(
        "run/episodes/021_spatial-000/episode.json",
        limits::EPISODE_RECORD,
        ["{\"schema\":\"genmanip.episode/2\",\"files\":[", "{},", "0]}"],
        "replay --check run",
    ),
];

impl Filling {
    /// Any of them.
    pub(super) fn any(rng: &mut impl Rng) -> &'static Self {
        &FILLINGS[rng.random_range(0..FILLINGS.len())]
    }

    /// A file that is just as large as is read.
    pub(super) fn bytes(&self) -> Vec<u8> {
        let Self { before, unit, after, limit, .. } = self;
        let room = limit.bytes as usize - before.len() - after.len();
        format!("{before}{}{after}", unit.repeat(room / unit.len())).into_bytes()
    }
}
