//! MJCF objects against MuJoCo compiling the original: poses, sizes, masses, inertias and joint ranges.

use std::sync::Arc;

use genmanip_assets::worlds::default_world;
use genmanip_core::glam::{DMat3, DQuat, DVec3};
use genmanip_core::{PhysicsFactors, Pose, Shape};
use genmanip_import::Given;
use genmanip_sim::{FlatBody, FlatJointKind, FlatShape, Flattened, Model, SceneObject};

use crate::described::{box_obj, refused};
use crate::rigid::{Disk, disk, import_from};

/// Pseudo-random numbers (SplitMix64).
struct Random(u64);

impl Random {
    fn number(&mut self, low: f64, high: f64) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        low + (high - low) * ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn three(&mut self, low: f64, high: f64) -> String {
        let numbers: Vec<String> = (0..3).map(|_| format!("{:.5}", self.number(low, high))).collect();
        numbers.join(" ")
    }

    fn one_of<'a>(&mut self, choices: &[&'a str]) -> &'a str {
        choices[self.number(0.0, choices.len() as f64) as usize]
    }

    /// An orientation in one of MJCF's forms, in degrees or rad.
    fn turn(&mut self, degrees: bool) -> String {
        let most = if degrees { 180.0 } else { 3.1 };
        match self.number(0.0, 5.0) as usize {
            0 => format!("euler=\"{}\"", self.three(-most, most)),
            1 => format!("axisangle=\"{} {:.4}\"", self.three(-1.0, 1.0), self.number(-most, most)),
            2 => format!("quat=\"{:.4} {}\"", self.number(0.1, 1.0), self.three(-1.0, 1.0)),
            3 => format!("xyaxes=\"1 {:.3} 0.1 {:.3} 1 0.2\"", self.number(-0.5, 0.5), self.number(-0.5, 0.5)),
            _ => format!("zaxis=\"{}\"", self.three(0.1, 1.0)),
        }
    }

    fn geom(&mut self, degrees: bool) -> String {
        let place = format!("pos=\"{}\" {}", self.three(-0.02, 0.02), self.turn(degrees));
        let density = format!("density=\"{:.1}\"", self.number(300.0, 900.0));
        match self.number(0.0, 9.0) as usize {
            0 => format!("<geom type=\"box\" size=\"{}\" {place} {density}/>", self.three(0.01, 0.03)),
            1 => format!(
                "<geom size=\"{:.4}\" {place} mass=\"{:.4}\"/>",
                self.number(0.01, 0.03),
                self.number(0.02, 0.1)
            ),
            2 => format!("<geom class=\"thin\" {place}/>"),
            3 => format!(
                "<geom type=\"capsule\" size=\"0.012\" fromto=\"{} {}\"/>",
                self.three(-0.03, -0.01),
                self.three(0.01, 0.03)
            ),
            4 => format!("<geom type=\"ellipsoid\" size=\"{}\" {place}/>", self.three(0.01, 0.03)),
            5 => format!("<geom mesh=\"block\" type=\"mesh\" {place} {density} material=\"layered\"/>"),
            6 => format!("<geom mesh=\"block\" type=\"{}\" {place}/>", self.one_of(&["box", "cylinder", "ellipsoid"])),
            7 => format!(
                "<frame {place}><geom type=\"cylinder\" size=\"0.015 0.02\"/><frame {}><geom class=\"thin\"/></frame></frame>",
                self.turn(degrees)
            ),
            _ => format!(
                "<replicate count=\"3\" offset=\"0.01 0.004 0\" {}><geom type=\"box\" size=\".008 .01 .012\"/></replicate>",
                if degrees { "euler=\"0 0 20\"" } else { "euler=\"0 0 0.3\"" }
            ),
        }
    }

    fn joint(&mut self, name: &str, degrees: bool) -> String {
        let (low, high) = (self.number(-1.5, -0.1), self.number(0.2, 1.5));
        let anchor = format!("pos=\"{}\" axis=\"{}\"", self.three(-0.02, 0.02), self.three(0.1, 1.0));
        let scale = if degrees { 57.0 } else { 1.0 };
        match self.number(0.0, 4.0) as usize {
            0 => format!(
                "<joint name=\"{name}\" type=\"slide\" {anchor} range=\"{:.4} {:.4}\"/>",
                low / 20.0,
                high / 20.0
            ),
            1 => format!(
                "<joint name=\"{name}\" {anchor} range=\"{:.4} {:.4}\" ref=\"{:.4}\"/>",
                low * scale,
                high * scale,
                0.1 * scale
            ),
            2 => format!("<joint name=\"{name}\" class=\"hinged\" {anchor}/>"),
            _ => format!(
                "<joint name=\"{name}\" type=\"slide\" {anchor} range=\"{:.4} {:.4}\" ref=\"0.004\" damping=\"0.3\"/>",
                low / 20.0,
                high / 20.0
            ),
        }
    }
}

/// A file with frames, replicas, attached models, nested defaults, reference poses, fitted shapes and layers.
fn generated(number: u64) -> String {
    let mut random = Random(number);
    let degrees = number.is_multiple_of(2);
    let mut geoms = |count: usize| (0..count).map(|_| random.geom(degrees)).collect::<String>();
    let (base, arm, hand) = (geoms(3), geoms(2), geoms(2));
    let (first, second) = (random.joint("first", degrees), random.joint("second", degrees));
    let (places, turn) = ([random.three(-0.03, 0.03), random.three(-0.03, 0.03)], random.turn(degrees));
    let limits = if degrees { "-40 70" } else { "-0.7 1.2" };
    let order = random.one_of(&["xyz", "ZYX", "zxz"]);
    let reference = random.three(-0.05, 0.05);
    let inertial = match number % 3 {
        0 => "<inertial pos=\"0.002 0 0.003\" mass=\"0.12\" fullinertia=\"5e-5 6e-5 4e-5 4e-6 -3e-6 2e-6\"/>",
        _ => "",
    };
    let attached = if number % 4 < 2 { "<attach model=\"knob\" body=\"knob\" prefix=\"k_\"/>" } else { "" };
    format!(
        r#"<?xml version="1.0"?><!DOCTYPE mujoco>
<mujoco model="gadget">
<compiler angle="{}" eulerseq="{order}"/>
<default><geom density="700"/><default class="part"><joint damping="0.2"/>
<default class="thin"><geom type="box" size="0.025 0.02 0.006" density="1200" rgba="0.2 0.5 0.8 1"/></default>
<default class="hinged"><joint type="hinge" range="{limits}"/></default></default></default>
<asset><texture name="grid" type="2d" builtin="checker" rgb1="1 0 0" rgb2="0 0 1" width="16" height="16"/>
<material name="layered"><layer texture="grid" role="rgb"/></material><model name="knob" file="knob.xml"/>
<mesh name="block" file="block.obj" scale="0.02 0.03 0.025" refpos="{reference}" refquat="0.9 0.1 0.3 -0.2"/></asset>
<worldbody><light pos="0 0 2"/><body name="base" pos="0.1 0.2 0.3"><freejoint/><geom type="box" size="0.04 0.04 0.02"/>{base}
<body name="fixed" pos="{}" {turn}><geom size="0.02"/></body>
<body name="arm" childclass="part" pos="0 0 0.05" euler="0 0 0.4">{first}<geom type="box" size="0.03 0.02 0.02"/>{arm}
<body name="hand" pos="{}">{inertial}{second}<geom type="box" size="0.02 0.03 0.02"/>{hand}</body></body>
<frame pos="0.05 0 0.02">{attached}</frame></body></worldbody><sensor><framepos objtype="body" objname="hand"/></sensor></mujoco>"#,
        if degrees { "degree" } else { "radian" },
        places[0],
        places[1],
    )
}

const KNOB: &str = r#"<mujoco model="knob"><compiler angle="radian"/><default><geom density="400"/></default><worldbody>
<body name="knob" euler="0.3 0 0.1"><geom type="cylinder" size="0.012 0.01"/><geom type="box" size="0.01 0.004 0.006" pos="0 0 0.012"/></body></worldbody></mujoco>"#;

/// A moving body with what is fixed to it, in the world.
struct Link {
    mass_kg: f64,
    center: DVec3,
    inertia: DMat3,
    range: Option<[f64; 2]>,
    low: DVec3,
    high: DVec3,
}

/// Links with joints at a share of their ranges; bodies without joints belong to their parents.
fn links(flat: &Flattened, share: f64) -> Vec<Link> {
    let mut poses = vec![(Pose::IDENTITY, None); flat.bodies.len()];
    let mut links: Vec<Link> = Vec::new();
    for (index, body) in flat.bodies.iter().enumerate().skip(1) {
        let (around, parent): (Pose, Option<usize>) = poses[body.parent];
        let moving = body.joints.iter().find(|joint| joint.kind != FlatJointKind::Free);
        let mut pose = around * body.parent_from_body;
        if let Some(joint) = moving {
            let [low, high] = joint.range.unwrap();
            let moved = low + share * (high - low) - joint.reference;
            let motion = match joint.kind {
                FlatJointKind::Hinge => {
                    Pose { rotation: DQuat::from_axis_angle(joint.axis, moved), position: DVec3::ZERO }
                }
                _ => Pose::from_position(joint.axis * moved),
            };
            pose = pose * Pose::from_position(joint.anchor) * motion * Pose::from_position(-joint.anchor);
        }
        let link = match (parent, moving) {
            (Some(parent), None) => parent,
            (_, moving) => {
                let (low, high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
                let range = moving.and_then(|joint| joint.range);
                links.push(Link { mass_kg: 0.0, center: DVec3::ZERO, inertia: DMat3::ZERO, range, low, high });
                links.len() - 1
            }
        };
        poses[index] = (pose, Some(link));
        add(&mut links[link], flat, body, pose);
    }
    links
}

fn add(link: &mut Link, flat: &Flattened, body: &FlatBody, pose: Pose) {
    let axes = DMat3::from_quat(pose.rotation);
    let (mass_kg, center) = (body.mass.mass_kg, pose.transform_point(body.mass.center));
    let total = link.mass_kg + mass_kg;
    let middle = (link.center * link.mass_kg + center * mass_kg) / total;
    let shifted = |mass_kg: f64, offset: DVec3| {
        let outer = DMat3::from_cols(offset * offset.x, offset * offset.y, offset * offset.z);
        (DMat3::from_diagonal(DVec3::splat(offset.length_squared())) - outer) * mass_kg
    };
    link.inertia += shifted(link.mass_kg, link.center - middle)
        + axes * body.mass.inertia * axes.transpose()
        + shifted(mass_kg, center - middle);
    (link.mass_kg, link.center) = (total, middle);
    for geom in body.geoms.iter().filter(|geom| geom.collides) {
        let placed = pose * geom.body_from_geom;
        for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
            let local = placed.rotation.inverse() * axis;
            let reach = match &geom.shape {
                FlatShape::Primitive(Shape::Box { half_extents }) => [half_extents.dot(local.abs()); 2],
                FlatShape::Primitive(Shape::Sphere { radius }) => [*radius; 2],
                FlatShape::Primitive(Shape::Capsule { radius, half_length }) => {
                    [radius + half_length * local.z.abs(); 2]
                }
                FlatShape::Primitive(Shape::Cylinder { radius, half_height }) => {
                    [radius * local.truncate().length() + half_height * local.z.abs(); 2]
                }
                FlatShape::Primitive(Shape::Ellipsoid { radii }) => [(*radii * local).length(); 2],
                FlatShape::Primitive(Shape::Hull { .. }) | FlatShape::Unbounded(_) => continue,
                FlatShape::Mesh(index) => {
                    let along = flat.meshes[*index].positions.iter().map(|corner| corner.dot(local));
                    along.fold([f64::NEG_INFINITY; 2], |[low, high], at| [low.max(-at), high.max(at)])
                }
            };
            let at = placed.position.dot(axis);
            link.low = link.low.min(axis * (at - reach[0]) + (DVec3::ONE - axis) * 1e9);
            link.high = link.high.max(axis * (at + reach[1]) - (DVec3::ONE - axis) * 1e9);
        }
    }
}

#[test]
fn fifty_generated_files_are_as_mujoco_compiles_them() {
    let block = box_obj([1.0, 1.0, 1.0]);
    for number in 0..50 {
        let text = generated(number);
        let given = [("block.obj".to_owned(), block.clone()), ("knob.xml".to_owned(), KNOB.as_bytes().to_vec())];
        let without_type = text.replace("<!DOCTYPE mujoco>", "");
        let original =
            Flattened::compile(&without_type, &given).unwrap_or_else(|error| panic!("{number}: {error}\n{text}"));
        let files = disk(&[("gadget.xml", text.as_bytes()), ("block.obj", &block), ("knob.xml", KNOB.as_bytes())]);
        let object = import_from(&files, "gadget.xml", &Given::default())
            .unwrap_or_else(|error| panic!("{number}: {error}\n{text}"));
        assert!(
            object.report.repairs.iter().any(|note| note.contains("<sensor> is not used")),
            "{:?}",
            object.report.repairs
        );
        let joint_positions = vec![0.0; object.model.joint_count()];
        let model = Arc::new(object.model);
        let placed = SceneObject {
            name: "it".into(),
            model,
            pose: Pose::IDENTITY,
            joint_positions,
            physics: PhysicsFactors::default(),
        };
        let built = Model::compile_without_robot(&default_world(), &[placed]).unwrap();
        let mut built = Flattened::compile(built.mjcf(), &[]).unwrap();
        // The world's table and floor have bodies of their own.
        let first = built.bodies.iter().position(|body| body.name.starts_with("object/")).unwrap();
        for body in &mut built.bodies[1..first] {
            body.mass.mass_kg = 1.0;
        }
        for share in [0.0, 0.35, 1.0] {
            let expected = links(&original, share);
            let mut found = links(&built, share);
            found.drain(..found.len() - expected.len());
            let origins = [expected[0].center, found[0].center];
            for (index, (one, other)) in expected.iter().zip(&found).enumerate() {
                let close = |a: DVec3, b: DVec3| a.abs_diff_eq(b, 1e-6);
                let told = format!("{number}, link {index} at {share}: {:?}\n{text}", object.report.guesses);
                assert!((one.mass_kg - other.mass_kg).abs() < 1e-6, "mass {} {}: {told}", one.mass_kg, other.mass_kg);
                assert!(close(one.center - origins[0], other.center - origins[1]), "center: {told}");
                let largest = one.inertia.x_axis.x + one.inertia.y_axis.y + one.inertia.z_axis.z;
                assert!(one.inertia.abs_diff_eq(other.inertia, 1e-6 * largest.max(1e-3)), "inertia: {told}");
                assert!(close(one.low - origins[0], other.low - origins[1]), "lower bound: {told}");
                assert!(close(one.high - origins[0], other.high - origins[1]), "upper bound: {told}");
                let range = |link: &Link| link.range.map_or(DVec3::ZERO, |[low, high]| DVec3::new(low, high, 0.0));
                assert!(close(range(one), range(other)), "range: {told}");
            }
        }
    }
}

/// The fixtures of public bug reports: a head in a frame, a reference pose, a texture in a layer.
#[test]
fn frames_reference_poses_and_layers_are_read() {
    let size = |files: &Disk, path: &str| import_from(files, path, &Given::default()).unwrap().model;
    let hammer = r#"<mujoco model="hammer"><worldbody><body name="hammer"><freejoint/><geom type="cylinder" size="0.012 0.08"/>
        <frame pos="0 0 0.09" euler="90 0 0"><geom type="cylinder" size="0.02 0.045"/></frame></body></worldbody></mujoco>"#;
    let model = size(&disk(&[("hammer.xml", hammer.as_bytes())]), "hammer.xml");
    assert!(model.card.size_m.abs_diff_eq(DVec3::new(0.04, 0.09, 0.19), 1e-6), "{}", model.card.size_m);
    let carton = r#"<mujoco><asset><mesh name="m" file="cube.obj" refpos="2 0 0" scale="0.05 0.05 0.08"/></asset><worldbody>
        <body name="b"><freejoint/><geom type="mesh" mesh="m"/><geom type="box" size="0.01 0.01 0.06"/></body></worldbody></mujoco>"#;
    let files = disk(&[("carton.xml", carton.as_bytes()), ("cube.obj", &box_obj([1.0, 1.0, 1.0]))]);
    let compiled = Flattened::compile(carton, &[("cube.obj".into(), box_obj([1.0, 1.0, 1.0]))]).unwrap();
    let link = &links(&compiled, 0.0)[0];
    let model = size(&files, "carton.xml");
    assert!(
        model.card.size_m.abs_diff_eq(link.high - link.low, 1e-6),
        "{} {}",
        model.card.size_m,
        link.high - link.low
    );
    let tin = r#"<mujoco><asset><texture name="t" type="2d" builtin="flat" rgb1="1 0 0" width="4" height="4"/>
        <texture name="gone" type="2d" file="gone.png"/><material name="layered"><layer texture="t" role="rgb"/></material>
        <material name="bare" texture="gone"/></asset><worldbody><body name="tin"><freejoint/>
        <geom type="box" size="0.03 0.03 0.03" material="layered"/><geom type="box" size="0.02 0.02 0.04" material="bare"/></body></worldbody></mujoco>"#;
    let object = import_from(&disk(&[("tin.xml", tin.as_bytes())]), "tin.xml", &Given::default()).unwrap();
    assert_eq!(object.model.links[0].visual[0].material.base_color, [1.0, 0.0, 0.0]);
    assert!(object.report.repairs.iter().any(|note| note.contains("gone.png")), "{:?}", object.report.repairs);
}

/// A moving body without mass gets a least one, and a note says so; the others keep theirs.
#[test]
fn moving_bodies_without_mass_are_read() {
    let cabinet = b"<mujoco model='cabinet'><worldbody><body name='cabinet'><geom type='box' size='.1 .1 .1' mass='2'/>
        <body name='drawer' pos='.12 0 0'><joint type='slide' axis='1 0 0' range='0 .1'/>
        <geom type='box' size='.01 .08 .05' mass='0'/></body></body></worldbody></mujoco>";
    let object = import_from(&disk(&[("cabinet.xml", cabinet)]), "cabinet.xml", &Given::default()).unwrap();
    let [body, drawer] = &object.model.links[..] else { panic!("{} links", object.model.links.len()) };
    assert!((body.mass.mass_kg - 2.0).abs() < 1e-6 && drawer.mass.mass_kg > 0.0, "{}", drawer.mass.mass_kg);
    let said = &object.report.repairs;
    assert!(said.iter().any(|note| note.contains("mass") && note.contains("0.001 kg")), "{said:?}");
}

/// MuJoCo's own messages, with the line of the original and of an included file.
#[test]
fn refusals_of_the_compiler_are_shown_with_their_place() {
    let included = b"<mujocoinclude>\n<body>\n<geom sizze='1'/></body></mujocoinclude>";
    let main = b"<mujoco>\n\n<worldbody><include file='part.xml'/></worldbody></mujoco>";
    let error = refused(&disk(&[("a.xml", main), ("part.xml", included)]), "a.xml");
    assert!(
        error.file == "part.xml" && error.to_string().contains("sizze") && error.to_string().contains("line 3"),
        "{error}"
    );
    let wrong = b"<mujoco><worldbody>\n<body><geom type='sphere'/></body></worldbody></mujoco>";
    let error = refused(&disk(&[("a.xml", wrong)]), "a.xml");
    assert!(error.to_string().contains("MuJoCo") && error.to_string().contains("size"), "{error}");
    let many = b"<mujoco><worldbody><body><replicate count='1000000'><geom size='.1'/></replicate></body></worldbody></mujoco>";
    assert!(refused(&disk(&[("a.xml", many)]), "a.xml").to_string().contains("replicas"));
}
