//! Files at their reader's size limit, filled with the most expensive entries or with valid ones.

use std::borrow::Cow;

use genmanip_core::limits::{self, Limit};
use serde_json::Value;

/// A file at its size limit, and the call that reads it.
#[derive(Clone, Debug)]
pub(super) struct Filling {
    /// Name of the file.
    pub(super) file: Cow<'static, str>,
    pub(super) limit: Limit,
    before: Cow<'static, str>,
    pub(super) unit: Cow<'static, str>,
    after: Cow<'static, str>,
    /// The call that reads it.
    pub(super) call: &'static str,
}

const fn filling(
    file: &'static str,
    limit: Limit,
    [before, unit, after]: [&'static str; 3],
    call: &'static str,
) -> Filling {
    let [before, unit, after] = [Cow::Borrowed(before), Cow::Borrowed(unit), Cow::Borrowed(after)];
    Filling { file: Cow::Borrowed(file), limit, before, unit, after, call }
}

const TASK: &str = "task show task.json";
const SCENARIO: &str = "export --mjcf scenario.json";
const WORLD: &str = "world check world.toml";
const PROBLEMS: &str = "lab motion --problems problems.json --count 10 --ik-poses 1";
const ROBOT: &str = "lab motion --problems none.json --ik-poses 1 --robot six";
const GRASPS: &str = "grasps show 001 --file grasps.json";
const SETTINGS: &str =
    "task new --designer llm --settings settings.toml --cassettes replay --kind spatial --count 1 --out out";
const EVALUATION: &str = "report run";
const KEPT: &str = "evaluate run --policy do_nothing:seconds=0.1 --keep-episodes";
const RELATIONS: &str = "lab relations --cases cases.json --profile seed";
const FIT: &str = "lab fit trials.jsonl";
const CAMERAS: &str = "evaluate scenario.json --policy do_nothing:seconds=0.1 --cameras cameras.json";
const PROBLEM: &str = "{\"start\":[0,0,0,0,0,0,0],\"goal\":[0,0,0,0,0,0,0],\"obstacles\":[]},";
const NODE: &str = "{\"id\":\"001\",\"asset\":{\"source\":\"builtin\",\"uid\":\"001\",\"version\":2}},";

const FILLINGS: [Filling; 45] = [
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
    filling("run/run.json", LONG_RUN, ["{\"schema\":\"genmanip.run/2\",\"tasks\":[", "{},", "0]}"], EVALUATION),
    filling(
        "run/timings.json",
        limits::TIMINGS,
        ["{\"schema\":\"genmanip.timings/1\",\"attempts\":[", "0,", "0]}"],
        EVALUATION,
    ),
    filling("scenario.json", limits::SCENARIO, ["", "{\"a\":0},", ""], "camera list scenario.json"),
    filling("scenario.json", limits::SCENARIO, ["[", "{\"a\":0},", "0]"], "camera list scenario.json"),
    filling("world.toml", limits::WORLD, ["a = [", "{b=0},", "0]"], WORLD),
    filling("problems.json", limits::PROBLEMS, ["{\"problems\":[", "{\"a\":[0]},", "0]}"], PROBLEMS),
    filling("cameras.json", limits::CAMERAS, ["[", "{\"name\":\"a\"},", "0]"], CAMERAS),
    filling("cases.json", limits::CASES, ["{\"cases\":[", "{\"a\":0},", "0]}"], RELATIONS),
    filling("cases.json", limits::CASES, ["{\"positions\":[\"", "a\",\"", "\"]}"], RELATIONS),
    filling("cases.npz", limits::CLOUDS, ["PK\u{5}\u{6}", "PK\u{1}\u{2}", ""], RELATIONS),
    filling("trials.jsonl", limits::TRIALS, ["[", "0,", "0]"], FIT),
    filling("trials.jsonl", limits::TRIALS, ["", "{\"grasp\":null,\"ending\":\"x\"}\n", ""], FIT),
    filling("six/six.urdf", limits::ROBOT, ["<robot>", "<link name=\"a\"><collision/></link>", "</robot>"], ROBOT),
    filling("run/evaluation/do_nothing_seconds=0.1/identity.json", limits::IDENTITY, ["[", "{\"a\":0},", "0]"], KEPT),
    filling(
        "run/episodes/021_spatial-000/episode.json",
        limits::EPISODE_RECORD,
        ["{\"schema\":\"genmanip.episode/2\",\"files\":[", "{},", "0]}"],
        "replay --check run",
    ),
];

/// Size of the tested run record. Longer ones are read task by task in the same memory; this one is read within the
/// time
/// limit.
const LONG_RUN: Limit = Limit { what: "the record of a run", bytes: 192 << 20 };

impl Filling {
    /// Files whose contents do not depend on the corpus.
    pub(super) fn fixed() -> Vec<Self> {
        FILLINGS.to_vec()
    }

    /// Valid documents of a run, extended to their size limit; `value` returns the JSON of a file of the run.
    pub(super) fn sound(value: impl Fn(&str) -> Option<Value>) -> Vec<Self> {
        const REPORT: &str = "run/evaluation/do_nothing_seconds=0.1.json";
        let run =
            value("run/run.json").and_then(|run| Self::repeating(("run/run.json", LONG_RUN), run, "tasks", EVALUATION));
        let report = value(REPORT)
            .and_then(|report| Self::repeating((REPORT, limits::EVALUATION), report, "results", EVALUATION));
        [run, report, value(REPORT).and_then(|report| Self::results(&report))].into_iter().flatten().collect()
    }

    /// Unfinished results (`results.jsonl`): the first result of an evaluation, repeated line by line.
    fn results(report: &Value) -> Option<Self> {
        let mut line = serde_json::json!({"schema": "genmanip.result/2"});
        line.as_object_mut()?.extend(report.get("results")?.get(0)?.as_object()?.clone());
        Some(Self {
            file: "run/evaluation/do_nothing_seconds=0.1/results.jsonl".into(),
            limit: limits::RESULTS,
            before: "".into(),
            unit: format!("{line}\n").into(),
            after: "".into(),
            call: KEPT,
        })
    }

    /// Valid document whose list `list` repeats its first entry up to the size limit.
    fn repeating(
        (file, limit): (&'static str, Limit),
        mut document: Value,
        list: &str,
        call: &'static str,
    ) -> Option<Self> {
        const HERE: &str = "here it goes on";
        let entry = document.get(list)?.get(0)?.to_string();
        document[list] = Value::from(vec![HERE]);
        let text = document.to_string();
        let (before, after) = text.split_once(&format!("\"{HERE}\""))?;
        let (before, unit, after) = (before.to_owned(), format!("{entry},"), format!("{entry}{after}"));
        Some(Self { file: file.into(), limit, before: before.into(), unit: unit.into(), after: after.into(), call })
    }

    /// Content of the file: `before`, as many copies of `unit` as fit, `after`; at most the size limit.
    pub(super) fn bytes(&self) -> Vec<u8> {
        let Self { before, unit, after, limit, .. } = self;
        let room = limit.bytes as usize - before.len() - after.len();
        format!("{before}{}{after}", unit.repeat(room / unit.len())).into_bytes()
    }
}
