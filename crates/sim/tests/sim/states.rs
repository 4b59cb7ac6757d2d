//! Saved states are complete, results are bit-identical on every thread, and invalid input is rejected.

use std::f64::consts::FRAC_PI_2;
use std::sync::Arc;

use genmanip_core::glam::{DMat3, DQuat, DVec3};
use genmanip_core::{Pose, RobotModel, World};
use genmanip_sim::{BodyId, Model, SettleSettings, Sim, SimError};

use crate::models::{ball, can, cuboid, rigid};
use crate::{placed, scene, six_objects};
use genmanip_assets::{panda, worlds::default_world};

/// A command that sweeps the arm through the objects.
fn command(step: usize) -> Vec<f32> {
    let t = step as f32 / 60.0;
    let mut joints: Vec<f32> = panda().home.iter().map(|&value| value as f32).collect();
    joints[0] += 0.5 * (1.3 * t).sin();
    joints[1] += 0.45 * (1.0 - (0.9 * t).cos());
    joints[3] -= 0.3 * (1.0 - (1.1 * t).cos());
    joints.push(0.04 + 0.04 * (3.0 * t).cos());
    joints
}

fn run(sim: &mut Sim, steps: std::ops::Range<usize>) -> Vec<u64> {
    for step in steps {
        sim.control_step(&command(step)).unwrap();
    }
    sim.state().iter().map(|value| value.to_bits()).collect()
}

#[test]
fn restored_states_continue_byte_for_byte() {
    let scene = scene();
    let mut sim = Sim::new(Arc::clone(&scene));
    run(&mut sim, 0..150);
    let saved = sim.state();
    let frame_after_save = sim.control_step(&command(150)).unwrap();
    let expected = run(&mut sim, 151..350);

    sim.set_state(&saved).unwrap();
    assert_eq!(sim.state(), saved);
    // Querying contacts must not change the simulation.
    assert!(!sim.contacts().is_empty());
    assert_eq!(sim.control_step(&command(150)).unwrap(), frame_after_save);
    assert_eq!(run(&mut sim, 151..350), expected);

    let mut fresh = Sim::new(scene);
    fresh.set_state(&saved).unwrap();
    assert_eq!(run(&mut fresh, 150..350), expected);
}

#[test]
fn threads_agree_to_the_last_bit() {
    let scene = scene();
    let work = || run(&mut Sim::new(Arc::clone(&scene)), 0..120);
    let expected = work();
    std::thread::scope(|scope| {
        let handles = [scope.spawn(work), scope.spawn(work)];
        for handle in handles {
            assert_eq!(handle.join().unwrap(), expected);
        }
    });
}

#[test]
fn applied_commands_replay_exactly() {
    let scene = scene();
    let mut sim = Sim::new(Arc::clone(&scene));
    // Far beyond range and speed, so that nearly every command is clamped.
    let wild = |step: usize| command(step).iter().map(|value| value * 3.0 + 1.0).collect::<Vec<f32>>();
    let applied: Vec<Vec<f32>> = (0..90).map(|step| sim.control_step(&wild(step)).unwrap().command).collect();
    let mut replay = Sim::new(scene);
    for command in &applied {
        assert_eq!(&replay.control_step(command).unwrap().command, command);
    }
    assert_eq!(replay.state(), sim.state());
}

#[test]
fn jumping_commands_are_approached_at_the_published_speed() {
    let robot = panda();
    let mut sim = Sim::new(scene());
    let mut previous = robot.home.clone();
    for _ in 0..120 {
        let frame = sim.control_step(&[9.0; 8]).unwrap();
        for (index, joint) in robot.arm_joints().enumerate() {
            let target = f64::from(frame.command[index]);
            assert!(target <= joint.upper + 1e-6);
            assert!((target - previous[index]).abs() <= joint.max_velocity / 60.0 + 1e-6);
            assert!(frame.joint_torque[index] <= joint.max_effort);
            previous[index] = target;
        }
        assert!(frame.command[7] <= 0.08);
    }
    let end = sim.control_step(&[9.0; 8]).unwrap();
    assert!(end.joint_velocity.iter().all(|speed| speed.abs() < 0.05), "{:?}", end.joint_velocity);
}

#[test]
fn invalid_input_is_rejected_without_side_effects() {
    let mut sim = Sim::new(scene());
    let before = sim.state();
    let check = |sim: &mut Sim, command: &[f32], expected: &str| {
        assert_eq!(sim.control_step(command).unwrap_err().to_string(), expected);
    };
    check(&mut sim, &[0.0; 3], "a command has 8 numbers (arm joint targets, then gripper width), got 3");
    let mut command = command(0);
    command[2] = f32::NAN;
    check(&mut sim, &command, "command number 2 is NaN, expected a finite number");
    assert_eq!(
        sim.set_state(&before[1..]).unwrap_err(),
        SimError::StateLength { expected: before.len(), got: before.len() - 1 }
    );
    let mut broken = before.clone();
    broken[5] = f64::INFINITY;
    assert!(matches!(sim.set_state(&broken), Err(SimError::NotFinite(_))));
    assert_eq!(sim.state(), before);

    let refused = |world: &World, robot: &RobotModel, objects: &[_]| {
        Model::compile(world, robot, objects).map(|_| ()).unwrap_err()
    };
    let compile = |objects: &[_]| refused(&default_world(), &panda(), objects);
    let mut objects = six_objects();
    objects[1].name = "Pen".into();
    assert_eq!(compile(&objects), SimError::DuplicateName("Pen".into()));
    let mut objects = six_objects();
    objects[5].joint_positions.clear();
    assert!(matches!(compile(&objects), SimError::JointPositions { expected: 1, got: 0, .. }));
    let mut objects = six_objects();
    objects[0].pose.position.x = f64::NAN;
    assert!(matches!(compile(&objects), SimError::NotFinite(_)));
    let mut world = (*default_world()).clone();
    world.physics.control_rate_hz = 50;
    assert!(matches!(refused(&world, &panda(), &[]), SimError::Settings(_)));
    let mut strong = (*panda()).clone();
    strong.drives.as_mut().unwrap().grip_force_n = 200.0;
    assert!(matches!(refused(&default_world(), &strong, &[]), SimError::Settings(_)));
    let settings = [
        ("solver_iteration", 30.into(), "`solver_iterations`?"),
        ("contact_solref", "stiff".into(), "`physics.engine.contact_solref`: expected two numbers, got \"stiff\""),
        ("impedance_ratio", 0.into(), "`physics.engine.impedance_ratio`: expected a positive number, got 0"),
    ];
    for (name, value, expected) in settings {
        let mut world = (*default_world()).clone();
        world.physics.engine.insert(name.into(), value);
        let error = refused(&world, &panda(), &[]).to_string();
        assert!(error.contains(expected), "{name}: {error}");
    }
    let mut world = (*default_world()).clone();
    world.physics.engine.remove("arena_mib");
    assert!(refused(&world, &panda(), &[]).to_string().contains("`physics.engine.arena_mib` is missing"));
    let mut model = rigid("flat", 1.0, 0.5, vec![cuboid(0.1, 0.1, 0.1)]);
    Arc::get_mut(&mut model).unwrap().links[0].mass.inertia = DMat3::from_diagonal(DVec3::new(1.0, 0.1, 0.1));
    let error = compile(&[placed("flat", model, 0.5, 0.0, 0.0)]);
    assert!(matches!(&error, SimError::Compile(text) if text.contains("nertia")), "{error}");
}

#[test]
fn a_diverging_simulation_is_an_error() {
    let mut sim = Sim::new(scene());
    let mut state = sim.state();
    // Time and the positions of arm, fingers and six objects with one drawer come first, then the speeds.
    let speeds = 1 + 7 + 2 + 6 * 7 + 1;
    state[speeds..speeds + 7].fill(1e9);
    sim.set_state(&state).unwrap();
    let outcome = (0..60).try_for_each(|step| sim.control_step(&command(step)).map(|_| ()));
    assert!(matches!(outcome, Err(SimError::Unstable { .. })), "{outcome:?}");
}

#[test]
fn objects_settle_in_place() {
    let mut sim = Sim::new(Arc::new(Model::compile_without_robot(&default_world(), &six_objects()).unwrap()));
    let report = sim.settle(&SettleSettings::default()).unwrap();
    assert!(report.settled && report.seconds < 1.0, "{report:?}");
    assert!(report.displacement.iter().all(|&moved| moved < 1e-3), "{report:?}");
    assert!(report.max_penetration < 5e-4, "{report:?}");

    // A can on its edge topples; two overlapping boxes are reported as deep.
    let mut tilted = placed("can", rigid("can", 0.3, 0.5, vec![can(0.03, 0.12)]), 0.5, 0.0, 0.0);
    tilted.pose = Pose::new(DVec3::new(0.5, 0.0, 0.03), DQuat::from_rotation_x(0.7));
    let mut sim = Sim::new(Arc::new(Model::compile_without_robot(&default_world(), &[tilted]).unwrap()));
    let report = sim.settle(&SettleSettings { max_seconds: 5.0, ..SettleSettings::default() }).unwrap();
    assert!(report.rotation[0] > 0.5 && report.settled, "{report:?}");
    let box_at = |name: &str, x: f64| placed(name, rigid("box", 0.3, 0.5, vec![cuboid(0.1, 0.1, 0.1)]), x, 0.0, 0.0);
    let overlapping = [box_at("a", 0.5), box_at("b", 0.58)];
    let mut sim = Sim::new(Arc::new(Model::compile_without_robot(&default_world(), &overlapping).unwrap()));
    assert!((sim.penetration() - 0.02).abs() < 1e-3, "{}", sim.penetration());
}

/// Regression: without rolling friction a ball that is put down with any speed rolls off the table.
#[test]
fn a_rolling_ball_comes_to_rest() {
    let ball = placed("ball", rigid("ball", 0.06, 0.5, vec![ball(0.0325)]), 0.5, 0.0, 0.0);
    let mut sim = Sim::new(Arc::new(Model::compile_without_robot(&default_world(), &[ball]).unwrap()));
    // Time and seven pose numbers, then the velocity of the origin, which is the contact point and therefore at rest.
    let mut state = sim.state();
    state[8 + 4] = 0.1 / 0.0325;
    sim.set_state(&state).unwrap();
    let report = sim.settle(&SettleSettings { max_seconds: 3.0, ..SettleSettings::default() }).unwrap();
    let rolled = sim.object_states()[0].pose.transform_point(DVec3::Z * 0.0325).x - 0.5;
    assert!(report.settled && (0.02..0.06).contains(&rolled), "rolled {rolled} m, {report:?}");
}

#[test]
fn a_stack_stands() {
    let slab = |name: &str, z: f64, yaw: f64| {
        let mut slab = placed(name, rigid("slab", 0.4, 0.5, vec![cuboid(0.2, 0.14, 0.03)]), 0.5, 0.0, yaw);
        slab.pose.position.z = z;
        slab
    };
    let mut mug = placed("mug", rigid("mug", 0.3, 0.5, crate::models::mug(0.04, 0.09, 0.004, 16)), 0.5, 0.0, 0.0);
    mug.pose.position.z = 0.09;
    let stack = [slab("a", 0.0, 0.0), slab("b", 0.03, 0.5), slab("c", 0.06, 1.0), mug];
    let mut sim = Sim::new(Arc::new(Model::compile_without_robot(&default_world(), &stack).unwrap()));
    sim.advance(480 * 3).unwrap();
    let report = sim.settle(&SettleSettings::default()).unwrap();
    assert!(report.settled && report.final_penetration < 3e-4, "{report:?}");
    for (state, object) in sim.object_states().iter().zip(&stack) {
        assert!(state.pose.position.distance(object.pose.position) < 1e-3, "{}: {:?}", object.name, state.pose);
    }
}

#[test]
fn contacts_name_both_sides_and_carry_the_weight() {
    let boxed = placed("box", rigid("box", 0.5, 0.5, vec![cuboid(0.1, 0.1, 0.1)]), 0.5, 0.0, 0.4);
    let scene = Arc::new(Model::compile(&default_world(), &panda(), &[boxed]).unwrap());
    let mut sim = Sim::new(Arc::clone(&scene));
    sim.settle(&SettleSettings::default()).unwrap();
    let contacts = sim.contacts();
    let weight: f64 = contacts.iter().map(|contact| contact.normal_force).sum();
    assert!((weight - 0.5 * 9.81).abs() < 0.05, "{weight}");
    let it = BodyId::Object { object: 0, link: 0 };
    assert!(contacts.iter().all(|contact| contact.other(it) == Some(BodyId::Table)), "{contacts:?}");
    assert_eq!((scene.body_name(it), scene.body_name(BodyId::Table)), ("box".to_string(), "table".to_string()));
    assert_eq!(scene.body_name(BodyId::Robot { link: 8 }), "robot/hand");
}

#[test]
fn pressing_on_the_table_is_a_stray_contact() {
    let mut sim = Sim::new(scene());
    let mut stray = 0.0f64;
    for step in 0..120 {
        // Straight arm towards the table.
        let mut joints: Vec<f32> = panda().home.iter().map(|&value| value as f32).collect();
        joints[1] += 1.2 * (step as f32 / 60.0).min(1.0);
        joints.push(0.08);
        let frame = sim.control_step(&joints).unwrap();
        assert_eq!(frame.stray_contact_n > 0.0, sim.stray_bodies().is_some());
        if frame.stray_contact_n > stray {
            stray = frame.stray_contact_n;
            let [link, other] = sim.stray_bodies().unwrap();
            assert!(matches!(link, BodyId::Robot { .. }) && other == BodyId::Table, "{link:?} on {other:?}");
        }
    }
    assert!(stray > 20.0, "{stray}");
    let deepest = sim.penetration();
    assert!(deepest < 0.01, "{deepest}");
}

#[test]
fn simulated_links_match_the_robot_model() {
    let robot = panda();
    let mut sim = Sim::new(scene());
    let frame = (0..60).map(|step| sim.control_step(&command(step)).unwrap()).last().unwrap();
    let before = sim.link_poses();
    let frame_now = sim.control_step(&command(60)).unwrap();
    let expected = robot.link_poses(&frame_now.joint_position, frame_now.gripper_width);
    for ((simulated, expected), link) in before.iter().zip(&expected).zip(&robot.links) {
        assert!(simulated.position.distance(expected.position) < 2e-4, "{}", link.name);
        assert!(simulated.angle_to(expected) < 1e-6, "{}", link.name);
    }
    assert!(frame_now.tcp.position.distance(robot.tcp_pose(&frame_now.joint_position).position) < 1e-9);
    assert!(frame_now.time_s > frame.time_s);
}

#[test]
fn a_drawer_moves_on_its_rail() {
    let mut cabinet = placed("Cabinet", crate::models::cabinet(), 0.6, 0.0, 0.0);
    cabinet.joint_positions = vec![0.05];
    cabinet.pose = Pose::new(DVec3::new(0.6, 0.0, 0.2), DQuat::from_rotation_y(-FRAC_PI_2 * 0.9));
    let mut sim = Sim::new(Arc::new(Model::compile_without_robot(&default_world(), &[cabinet]).unwrap()));
    assert_eq!(sim.object_states()[0].joint_positions, vec![0.05]);
    sim.advance(480).unwrap();
    let position = sim.object_states()[0].joint_positions[0];
    assert!((-0.005..=0.125).contains(&position) && (position - 0.05).abs() > 0.01, "{position}");
}

#[test]
fn engine_is_pinned() {
    assert_eq!(genmanip_sim::engine_version(), "mujoco 3.17.0");
}
