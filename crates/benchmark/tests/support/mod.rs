//! Made-up but realistic input: real tasks, invented layouts, images and results.
#![allow(clippy::unwrap_used)] // shared with the example, which clippy does not take for a test

use genmanip_core::ReferenceId;
use std::collections::BTreeMap;

use genmanip_benchmark::*;
use genmanip_core::*;
use genmanip_viz::drawing::color_of_word;
use genmanip_viz::*;

/// Ten recorded answers as tasks.
pub fn tasks() -> Vec<Task> {
    parse_tasks(include_str!("../../../viz/testdata/tasks.json"))
}

pub fn parse_tasks(text: &str) -> Vec<Task> {
    let values: Vec<serde_json::Value> = serde_json::from_str(text).unwrap();
    values.into_iter().map(|value| Task::from_value(value).unwrap()).collect()
}

/// Positions that satisfy the relations, one object after the other.
fn positions(task: &Task) -> Vec<[f64; 2]> {
    let index = |id: &ReferenceId| task.scene_graph.index_of(id).unwrap();
    let mut at: Vec<Option<[f64; 2]>> = vec![None; task.objects.len()];
    at[0] = Some([0.5, 0.0]);
    for _ in 0..task.objects.len() {
        for edge in &task.scene_graph.edges {
            let (a, b) = (index(&edge.subject), index(&edge.reference));
            let (ca, cb) = (&task.objects[a].size_m, &task.objects[b].size_m);
            let [dx, dy] = [(ca.x + cb.x) / 2.0 + 0.06, (ca.y + cb.y) / 2.0 + 0.07];
            let [ox, oy] = match edge.relation {
                Relation::Front => [dx, 0.012],
                Relation::Back => [-dx, -0.008],
                Relation::Left => [0.015, dy],
                Relation::Right => [-0.01, -dy],
                Relation::Top | Relation::On | Relation::In => [0.0, 0.0],
                Relation::Near | Relation::Between => [0.0, dy],
            };
            match (at[a], at[b]) {
                (None, Some(b)) => at[a] = Some([b[0] + ox, b[1] + oy]),
                (Some(a), None) => at[b] = Some([a[0] - ox, a[1] - oy]),
                _ => {}
            }
        }
    }
    at.into_iter().map(|at| at.unwrap_or([0.7, 0.3])).collect()
}

pub fn top_view(task: &Task) -> TopView {
    let footprint = |(number, (card, at)): (usize, (&std::sync::Arc<ObjectCard>, [f64; 2]))| {
        let (half_x, half_y) = (card.size_m.x / 2.0, card.size_m.y / 2.0);
        let round = ["round", "cylinder", "sphere", "hemisphere"].iter().any(|word| card.shape.contains(word));
        let (sides, power) = if round { (36, 1.0) } else { (40, 0.25) };
        let turn = if round { 0.0 } else { (number as f64 * 1.7).sin() * 0.35 };
        let outline = (0..sides).map(|step| {
            let angle = f64::from(step) / f64::from(sides) * std::f64::consts::TAU;
            let round_off = |value: f64| value.signum() * value.abs().powf(power);
            let (x, y) = (half_x * round_off(angle.cos()), half_y * round_off(angle.sin()));
            [at[0] + x * turn.cos() - y * turn.sin(), at[1] + x * turn.sin() + y * turn.cos()]
        });
        Footprint {
            id: card.uid.as_str().into(),
            name: card.name.clone(),
            color: color_of_word(&card.colors[0]),
            polygons: vec![outline.collect()],
        }
    };
    TopView {
        workspace: Workspace { x: [0.2, 0.9], y: [-0.5, 0.5] },
        footprints: task.objects.iter().zip(positions(task)).enumerate().map(footprint).collect(),
        edges: task
            .scene_graph
            .edges
            .iter()
            .map(|edge| DrawnEdge { edge: edge.clone(), role: EdgeRole::Initial })
            .collect(),
        reach_m: vec![0.855],
        windows: vec![],
    }
}

/// A synthetic image that changes with time.
pub fn jpeg(task: &Task, time: f64, width: u16, height: u16) -> Vec<u8> {
    let places = positions(task);
    let mut pixels = Vec::with_capacity(usize::from(width) * usize::from(height) * 3);
    for row in 0..height {
        for column in 0..width {
            let (u, v) = (f64::from(column) / f64::from(width), f64::from(row) / f64::from(height));
            let mut color = if v < 0.28 { [232, 234, 238] } else { [214, 205, 190] };
            for (number, (card, at)) in task.objects.iter().zip(&places).enumerate() {
                let moving = if number == 0 { time * 0.2 } else { 0.0 };
                let (cx, cy) = (0.5 + at[1] * 0.9 + moving, 0.62 + (0.55 - at[0]) * 0.8 - moving * 0.4);
                let radius = card.size_m.y.max(0.05) * 0.55;
                if ((u - cx) * 1.78).hypot(v - cy) < radius {
                    let shade = 1.0 - 0.35 * (v - cy + radius) / (2.0 * radius);
                    color = color_of_word(&card.colors[0]).map(|part| (f64::from(part) * shade) as u8);
                }
            }
            pixels.extend(color);
        }
    }
    let mut bytes = Vec::new();
    jpeg_encoder::Encoder::new(&mut bytes, 80).encode(&pixels, width, height, jpeg_encoder::ColorType::Rgb).unwrap();
    bytes
}

/// A verdict in which the first alternative holds if `success`, and nothing else does.
pub fn verdict(task: &Task, success: bool) -> GoalVerdict {
    let judged =
        |holds: bool, atom: &Atom| {
            let (quantity, value, threshold, unit, margin) = match atom {
                Atom::State { .. } if holds => ("joint position", 1.31, 0.9, Unit::Radian, 0.41),
                Atom::State { .. } => ("joint position", 0.02, 0.9, Unit::Radian, -0.88),
                _ if holds => ("gap in the plane", 0.0423, 0.15, Unit::Metre, 0.1077),
                _ => ("gap in the plane", 0.2811, 0.15, Unit::Metre, -0.1311),
            };
            let measure = |quantity: &str, value: f64, threshold: f64, unit: Unit, met: bool, margin: f64| {
                Measurement { quantity: quantity.into(), value, threshold, unit, met, margin }
            };
            let mut measurements = vec![measure(quantity, value, threshold, unit, holds, margin)];
            if let Atom::Relation { .. } = atom {
                measurements.push(measure("overlap along x", 0.018, 0.0, Unit::Metre, true, 0.018));
            }
            let state = matches!(atom, Atom::State { .. });
            let sign = match (state, holds) {
                (false, true) => "≤",
                (false, false) => ">",
                (true, true) => "≥",
                (true, false) => "<",
            };
            AtomVerdict {
                atom: atom.clone(),
                holds,
                margin,
                measurements,
                other_readings: Vec::new(),
                explanation: format!(
                    "{quantity} {value:.3} {symbol} {sign} {threshold:.3} {symbol}",
                    symbol = unit.symbol()
                ),
            }
        };
    let alternatives = task.goal.alternatives.iter().enumerate();
    GoalVerdict::from_alternatives(
        alternatives
            .map(|(index, atoms)| atoms.iter().map(|atom| judged(success && index == 0, atom)).collect())
            .collect(),
    )
}

pub fn result(task: &Task, policy: &str, number: u64, success: bool, failure: Option<Failure>) -> EpisodeResult {
    EpisodeResult {
        id: format!("{}-{number:02}-{policy}", task.id),
        scenario_id: format!("{}-{number:02}", task.id),
        task_id: task.id.clone(),
        policy: policy.into(),
        oracle: policy == "expert",
        seed: Seed::new(1).fork(&task.id).fork_index(number),
        success,
        success_once: success || number == 2 && policy == "replay",
        verdict: verdict(task, success),
        ending: Some(Ending::Finished),
        failures: failure.into_iter().collect(),
        duration_s: 9.4 + number as f64 * 0.7,
        horizon_s: 30.0,
        control_rate_hz: 60.0,
        frames: 560 + 42 * number as usize,
        unreachable_actions: 0,
        tcp_path_m: if policy == "do_nothing" { 0.0 } else { 1.9 + 0.11 * number as f64 },
        max_stray_contact_n: if success { 1.2 } else { 31.0 },
        stray_contact: None,
        world_hashes: None,
        cloud: None,
        other_request_success: None,
        correction: None,
        expert: genmanip_core::ExpertStyle::Default,
        agent_failure: None,
        source: None,
        engine: "mujoco 3.17.0".into(),
        genmanip_version: "0.1.0".into(),
    }
}

/// A report on tasks, four attempts each, with some failures.
pub fn report_input(tasks: Vec<Task>) -> ReportInput {
    let kinds: BTreeMap<String, TaskKind> = tasks.iter().map(|task| (task.id.clone(), task.kind)).collect();
    let failure = |task: &Task, cause| Failure {
        cause,
        evidence: format!(
            "{} left the gripper at 3.2 s, 0.14 m above the table, 0.21 m before its goal",
            task.objects[0].name
        ),
    };
    let mut all = Vec::new();
    let (mut sections, mut episodes) = (Vec::new(), Vec::new());
    let rows = tasks.iter().map(TaskRow::of).collect();
    for (index, task) in tasks.into_iter().enumerate() {
        let fails = |number: u64| index == 3 || (index as u64 + number * 3) % 11 == 4;
        let cause = [FailureCause::Slipped, FailureCause::GoalMissed, FailureCause::Planning][index % 3];
        let mut results = Vec::new();
        for policy in ["expert", "replay", "do_nothing"] {
            for number in 0..4 {
                let failure = (policy == "expert" && fails(number)).then(|| failure(&task, cause));
                results.push(result(&task, policy, number, policy != "do_nothing" && !fails(number), failure));
            }
        }
        let attempts = (0..4).map(|number| AttemptRow {
            id: format!("{}-{number:02}", task.id),
            outcome: if fails(number) {
                AttemptOutcome::Failed(failure(&task, cause))
            } else {
                AttemptOutcome::Verified
            },
            seconds: 2.1 + number as f64 * 0.37,
        });
        for number in 0..4 {
            let failure = fails(number).then(|| failure(&task, cause));
            let made = EpisodeResult {
                id: format!("{}-{number:02}", task.id),
                ..result(&task, "expert", number, !fails(number), failure)
            };
            episodes.push(EpisodeRow::of(&made, index, None, true, Some(2.1 + number as f64 * 0.37)));
        }
        let evaluated = |result: &EpisodeResult| EpisodeRow::of(result, index, Some(&result.policy), false, None);
        episodes.extend(results.iter().map(evaluated));
        sections.push(TaskSection {
            why: None,
            episode: Some(16 * index),
            scenario: None,
            graph: graph_svg(&task),
            layout: Some(layout_svg(&top_view(&task))),
            first_image: Some(jpeg(&task, 0.0, 512, 288)),
            last_image: Some(jpeg(&task, 1.0, 512, 288)),
            film: (0..20)
                .map(|frame| EpisodeImage {
                    time_s: f64::from(frame) * 0.5,
                    jpeg: jpeg(&task, f64::from(frame) / 19.0, 256, 144),
                })
                .collect(),
            shown: results.first().cloned(),
            attempts: attempts.collect(),
            results: results.clone(),
            task,
        });
        all.extend(results);
    }
    let settings = StatisticsSettings::default();
    let reference: BTreeMap<String, f64> =
        all.iter().filter(|result| result.policy == "expert").map(|r| (r.scenario_id.clone(), 1.9)).collect();
    let of = |policy: &str| -> Vec<EpisodeResult> { all.iter().filter(|r| r.policy == policy).cloned().collect() };
    ReportInput {
        title: "From recorded answers to verified demonstrations".into(),
        generated_by: "genmanip 0.1.0".into(),
        seed: Seed::new(1),
        commands: vec![
            "genmanip collect --tasks examples/tasks --seed 1 --attempts 4".into(),
            "genmanip evaluate --policy expert,replay,do_nothing --suite demo".into(),
        ],
        versions: vec![("physics".into(), "mujoco 3.17.0, step 1/480 s".into()), ("suite".into(), "demo, 3fa81c20b7e4".into())],
        summaries: summarise(&all, &kinds, &reference, &settings).unwrap(),
        not_run: BTreeMap::new(),
        baseline: Some("do_nothing".into()),
        comparisons: vec![compare(&of("expert"), &of("do_nothing"), &settings).unwrap()],
        timings: vec![
            Timing { phase: "layouts".into(), seconds: 4.31 },
            Timing { phase: "collecting".into(), seconds: 184.2 },
            Timing { phase: "report".into(), seconds: 0.41 },
        ],
        notes: vec![
            "The expert reads the simulator's truth (poses and shapes); its results are marked oracle and are no measure of perception.".into(),
            "Replay applies the recorded commands open loop; it succeeds exactly where the recorded episode did.".into(),
        ],
        tasks: rows,
        episodes,
        cases: sections,
        rule: None,
        has_pages: false,
    }
}
