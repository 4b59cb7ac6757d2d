//! Plans a file of problems and re-checks every path: success, contacts, computing time, path length.
//!
//! `cargo run --release -p genmanip-motion --example planning_problems -- <robot folder> <problems.json>…`
//!
//! The folder holds `panda.urdf` and its convex collision meshes (`*.obj`); a problem file holds joint start and goal
//! and obstacles as boxes and cylinders.
//! A path is valid when no state, re-checked every 0.02 rad (largest joint step) on the convex meshes, touches
//! an obstacle or the robot itself.
#![allow(clippy::print_stdout, clippy::unwrap_used, reason = "a measuring program for developers")]

use std::{collections::BTreeMap, fs, path::Path, sync::Arc, time::Instant};

use genmanip_core::{
    Gripper, JointKind, MassProperties, Piece, Pose, RobotJoint, RobotLink, RobotModel, Seed, Shape,
    glam::{DMat3, DQuat, DVec3, EulerRot},
};
use genmanip_motion::{Allowed, Planner, PlannerSettings, Surroundings, World};
use serde_json::Value;

fn main() {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let robot = Arc::new(read_robot(Path::new(&args[0])));
    let begin = Instant::now();
    let planner = Planner::new(Arc::clone(&robot), PlannerSettings::default()).unwrap();
    println!("planner compiled in {:.1} ms", begin.elapsed().as_secs_f64() * 1e3);
    for file in &args[1..] {
        let problems: Value = serde_json::from_str(&fs::read_to_string(file).unwrap()).unwrap();
        measure(&planner, file, problems["problems"].as_array().unwrap());
    }
}

fn measure(planner: &Planner, file: &str, problems: &[Value]) {
    let (mut plan_ms, mut time_ms, mut lengths, mut durations) = (vec![], vec![], vec![], vec![]);
    let (mut invalid, mut failures) = (vec![], vec![]);
    for (index, problem) in problems.iter().enumerate() {
        let world = read_world(&problem["obstacles"]);
        let allowed = Allowed::none();
        let around = Surroundings { world: &world, attached: None, allowed: &allowed, gripper_width: 0.08 };
        let (start, goal) = (numbers(&problem["start"]), numbers(&problem["goal"]));
        let (planned, milliseconds) =
            timed(|| planner.plan_joint(&around, &start, std::slice::from_ref(&goal), Seed::new(1)));
        plan_ms.push(milliseconds);
        let path = match planned {
            Ok(path) => path,
            Err(error) => {
                failures.push(format!("{index}: {error}"));
                continue;
            }
        };
        let (trajectory, milliseconds) = timed(|| planner.time(&path, 1.0));
        time_ms.push(milliseconds);
        durations.push(trajectory.duration());
        let exact = planner.checker(&around, 0.0);
        let states = path.states(0.02);
        lengths.push(states.windows(2).map(|pair| distance(&pair[0], &pair[1])).sum());
        let touches = |states: &[Vec<f64>]| recheck(states).iter().find_map(|state| exact.check(state));
        if let Some(report) =
            touches(path.waypoints()).or_else(|| touches(&states)).or_else(|| touches(&trajectory.configs))
        {
            invalid.push(format!("{index}: {report}"));
        }
    }
    println!("{file}: solved {}/{}, invalid {}", lengths.len(), problems.len(), invalid.len());
    let row = |name: &str, values: &mut Vec<f64>| {
        values.sort_by(f64::total_cmp);
        let at = |part: f64| values[((values.len() - 1) as f64 * part).round() as usize];
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        println!("  {name:<18} median {:8.3}  p95 {:8.3}  mean {mean:8.3}  max {:8.3}", at(0.5), at(0.95), at(1.0));
    };
    row("plan ms", &mut plan_ms);
    row("time scaling ms", &mut time_ms);
    row("path length rad", &mut lengths);
    row("duration s", &mut durations);
    for line in failures.iter().chain(&invalid).take(12) {
        println!("  {line}");
    }
}

/// The answer and the shortest of three computing times in milliseconds: everything here is a pure function, so what
/// is longer was some other program's doing.
fn timed<T>(work: impl Fn() -> T) -> (T, f64) {
    let run = || {
        let begin = Instant::now();
        let answer = work();
        (answer, begin.elapsed().as_secs_f64() * 1e3)
    };
    let (answer, first) = run();
    let shortest = (0..2).map(|_| run().1).fold(first, f64::min);
    (answer, shortest)
}

/// States every 0.02 rad of the largest joint step.
fn recheck(waypoints: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let mut states = waypoints[..1].to_vec();
    for pair in waypoints.windows(2) {
        let largest = pair[0].iter().zip(&pair[1]).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        let steps = (largest / 0.02).ceil().max(1.0) as usize;
        states.extend((1..=steps).map(|k| {
            let t = k as f64 / steps as f64;
            pair[0].iter().zip(&pair[1]).map(|(a, b)| a + (b - a) * t).collect()
        }));
    }
    states
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
}

fn read_world(obstacles: &Value) -> World {
    let mut world = World::new();
    for (index, obstacle) in obstacles.as_array().unwrap().iter().enumerate() {
        let position = DVec3::from_slice(&numbers(&obstacle["pos"]));
        let shape = match obstacle["type"].as_str().unwrap() {
            "box" => Shape::Box { half_extents: DVec3::from_slice(&numbers(&obstacle["size"])) / 2.0 },
            "cylinder" => Shape::Cylinder {
                radius: obstacle["radius"].as_f64().unwrap(),
                half_height: obstacle["length"].as_f64().unwrap() / 2.0,
            },
            other => panic!("unknown obstacle {other}"),
        };
        let pose = Pose::from_position_yaw(position, obstacle["yaw"].as_f64().unwrap());
        world.add(&format!("obstacle {index}"), &[Piece::at(DVec3::ZERO, shape)], &pose).unwrap();
    }
    world
}

/// Reads the few things of this one URDF that planning needs.
fn read_robot(folder: &Path) -> RobotModel {
    let text = fs::read_to_string(folder.join("panda.urdf")).unwrap();
    let mass = MassProperties { mass_kg: 1.0, center: DVec3::ZERO, inertia: DMat3::IDENTITY };
    let mut joints = BTreeMap::new();
    for block in blocks(&text, "joint") {
        joints.insert(attribute(block, "child link=\"").to_owned(), block);
    }
    let mut links: Vec<RobotLink> = Vec::new();
    for block in blocks(&text, "link") {
        let name = attribute(block, "name=\"").to_owned();
        let pieces = match block.split_once("<collision>") {
            None => vec![],
            Some((_, collision)) => {
                let mesh = attribute(collision, "filename=\"").trim_start_matches("package://");
                let shape = Shape::Hull { points: read_corners(&folder.join(mesh)) };
                vec![Piece { shape, link_from_piece: origin(collision.split("<geometry>").next().unwrap()) }]
            }
        };
        links.push(RobotLink {
            name,
            parent: None,
            parent_from_link: Pose::IDENTITY,
            joint: None,
            visual: vec![],
            pieces,
            mass,
        });
    }
    let names: Vec<String> = links.iter().map(|link| link.name.clone()).collect();
    for link in &mut links {
        let Some(block) = joints.get(&link.name) else { continue };
        link.parent = names.iter().position(|name| name == attribute(block, "parent link=\""));
        link.parent_from_link = origin(block);
        let number = |key: &str| attribute(block, key).parse::<f64>().unwrap();
        let finger = link.name.contains("finger");
        if block.contains("type=\"revolute\"") {
            let (lower, upper) = (number(" lower=\""), number(" upper=\""));
            link.joint = Some(joint(JointKind::Revolute, DVec3::Z, lower, upper, number(" velocity=\"")));
        } else if finger {
            // The fingers are fixed in this file, 0.065 m apart from the middle; here they open and close.
            let side = link.parent_from_link.position.y.signum();
            link.parent_from_link.position.y -= 0.04 * side;
            link.joint = Some(joint(JointKind::Prismatic, DVec3::Y * side, 0.0, 0.04, 0.2));
        }
    }
    let index = |name: &str| names.iter().position(|other| other == name).unwrap();
    let srdf = fs::read_to_string(folder.join("panda_full.srdf")).unwrap();
    let pairs = srdf.split("<disable_collisions").skip(1);
    let never = pairs.map(|pair| (index(attribute(pair, "link1=\"")), index(attribute(pair, "link2=\""))));
    RobotModel {
        name: "panda".into(),
        hand: index("panda_hand"),
        hand_from_tcp: Pose::from_position(DVec3::Z * 0.1034),
        gripper: Gripper {
            fingers: [index("panda_leftfinger"), index("panda_rightfinger")],
            max_width: 0.08,
            max_force: 140.0,
            pad_size: DVec3::new(0.008, 0.021, 0.017),
        },
        home: vec![0.0, -0.78, 0.0, -2.36, 0.0, 1.57, 0.78],
        never_colliding: never.collect(),
        links,
    }
}

fn joint(kind: JointKind, axis: DVec3, lower: f64, upper: f64, max_velocity: f64) -> RobotJoint {
    let max_acceleration = 10.0;
    RobotJoint {
        name: "joint".into(),
        kind,
        axis,
        lower,
        upper,
        max_velocity,
        max_acceleration,
        max_jerk: 5000.0,
        max_effort: 87.0,
    }
}

fn blocks<'a>(text: &'a str, tag: &'a str) -> impl Iterator<Item = &'a str> {
    let (open, close) = (format!("<{tag} name="), format!("</{tag}>"));
    let starts: Vec<usize> = text.match_indices(&open).map(|(at, _)| at).collect();
    starts.into_iter().map(move |start| &text[start..start + text[start..].find(&close).unwrap()])
}

fn attribute<'a>(block: &'a str, key: &str) -> &'a str {
    let start = block.find(key).map_or(block.len(), |at| at + key.len());
    block[start..].split('"').next().unwrap()
}

fn origin(block: &str) -> Pose {
    let Some((_, rest)) = block.split_once("<origin") else { return Pose::IDENTITY };
    let three = |key: &str| {
        let values: Vec<f64> = attribute(rest, key).split_whitespace().map(|word| word.parse().unwrap()).collect();
        DVec3::from_slice(&values)
    };
    let angles = three("rpy=\"");
    Pose::new(three("xyz=\""), DQuat::from_euler(EulerRot::ZYX, angles.z, angles.y, angles.x))
}

fn read_corners(path: &Path) -> Vec<DVec3> {
    let stl = fs::read(format!("{}.convex.stl", path.display())).unwrap();
    let triangles = stl[84..].chunks_exact(50);
    let mut corners: Vec<DVec3> = Vec::new();
    for triangle in triangles {
        for corner in triangle[12..48].chunks_exact(12) {
            let part = |at: usize| f64::from(f32::from_le_bytes(corner[at..at + 4].try_into().unwrap()));
            let corner = DVec3::new(part(0), part(4), part(8));
            if !corners.contains(&corner) {
                corners.push(corner);
            }
        }
    }
    corners
}
