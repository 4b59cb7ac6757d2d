//! URDF and MJCF objects in the layouts of common libraries.

use genmanip_core::{JointKind, ObjectModel, Pose};
use genmanip_import::{Given, ImportError};
use glam::DVec3;

use crate::rigid::{Disk, disk, import_from, upright_box};

/// A box as OBJ.
pub fn box_obj(size: [f32; 3]) -> Vec<u8> {
    let (corners, triangles) = upright_box(size);
    let mut text: String = corners.iter().map(|[x, y, z]| format!("v {x} {y} {z}\n")).collect();
    text.extend(triangles.iter().map(|[a, b, c]| format!("f {} {} {}\n", a + 1, b + 1, c + 1)));
    text.into_bytes()
}

/// A cabinet in PartNet-Mobility's layout: an empty base, a body fixed to it, a revolute door.
pub fn cabinet() -> Disk {
    let urdf = br#"<?xml version="1.0"?>
<robot name="StorageFurniture">
  <link name="base"/>
  <link name="link_0">
    <visual name="door-1"><origin xyz="0 0 -0.5"/><geometry><mesh filename="textured_objs/door.obj"/></geometry></visual>
    <collision><origin xyz="0 0 -0.5"/><geometry><mesh filename="textured_objs/door.obj"/></geometry></collision>
  </link>
  <link name="link_1">
    <visual name="body-2"><origin xyz="0 0 0"/><geometry><mesh filename="textured_objs/body.obj"/></geometry></visual>
    <collision><geometry><mesh filename="textured_objs/body.obj"/></geometry></collision>
  </link>
  <joint name="joint_1" type="fixed"><origin rpy="0 0 0" xyz="0 0 0"/><child link="link_1"/><parent link="base"/></joint>
  <joint name="joint_0" type="revolute"><origin xyz="-0.02 0 0.5"/><axis xyz="0 0 1"/><child link="link_0"/><parent link="link_1"/>
    <limit lower="0" upper="1.5"/></joint>
</robot>"#;
    disk(&[
        ("45132/mobility.urdf", urdf),
        ("45132/textured_objs/body.obj", &box_obj([0.6, 0.8, 1.0])),
        ("45132/textured_objs/door.obj", &box_obj([-0.05, 0.8, 1.0])),
    ])
}

pub fn refused(files: &Disk, path: &str) -> ImportError {
    import_from(files, path, &Given::default()).map(|object| object.report).unwrap_err()
}

fn joints(model: &ObjectModel) -> Vec<(&str, JointKind, [f64; 2])> {
    model
        .links
        .iter()
        .filter_map(|link| link.joint.as_ref())
        .map(|joint| (joint.name.as_str(), joint.kind, joint.range))
        .collect()
}

#[test]
fn a_partnet_cabinet_has_one_door_and_two_states() {
    let object = import_from(&cabinet(), "45132/mobility.urdf", &Given::default()).unwrap();
    let model = &object.model;
    assert_eq!(model.links.len(), 2, "the fixed link is merged into the base");
    assert_eq!(joints(model), [("joint_0", JointKind::Revolute, [0.0, 1.5])]);
    assert_eq!(model.card.states, ["closed", "open"]);
    assert!(model.card.is_articulated && !model.card.can_grasp);
    let longest = model.card.size_m.max_element();
    assert!((0.1..0.8).contains(&longest), "normalised sizes are scaled to a table: {longest}");
    // The door swings about its hinge at the object's front.
    let open = model.joint_states[1].nominal.clone();
    let reach = |joints: &[f64]| model.world_bounds(&Pose::IDENTITY, joints).min.x;
    assert!(reach(&open) < reach(&[0.0]) - 0.1 * longest, "{} {}", reach(&open), reach(&[0.0]));
}

#[test]
fn a_pybullet_urdf_keeps_its_mass_and_reports_its_inertia() {
    let urdf = br#"<robot name="blob"><link name="blob"><contact><lateral_friction value="1.0"/></contact>
<inertial><mass value="0.1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="0"/></inertial>
<visual><geometry><mesh filename="000.obj" scale="0.015 0.015 0.015"/></geometry>
<material name="m"><color rgba="0.04 0.07 0.91 1"/></material></visual>
<collision><geometry><mesh filename="000.obj" scale="0.015 0.015 0.015"/></geometry></collision></link></robot>"#;
    let files = disk(&[("000/000.urdf", urdf), ("000/000.obj", &box_obj([4.0, 4.0, 2.0]))]);
    let model = import_from(&files, "000/000.urdf", &Given::default()).unwrap();
    let guess = model.report.guesses.iter().find(|guess| guess.what == "inertia").unwrap();
    assert!(guess.because.contains("implausible"), "{guess:?}");
    let model = model.model;
    assert!(model.card.size_m.abs_diff_eq(DVec3::new(0.06, 0.06, 0.03), 1e-6), "{}", model.card.size_m);
    assert_eq!(
        (model.card.mass_kg, model.friction, model.card.colors.as_slice()),
        (0.1, 1.0, &["blue".to_owned()][..])
    );
    let even = 0.1 * (0.06 * 0.06 + 0.03 * 0.03) / 12.0;
    assert!((model.links[0].mass.inertia.x_axis.x - even).abs() < 1e-8);
}

/// A drawer in MetaWorld's layout: dependencies in a sibling file, classes, collision geoms in group 4.
pub fn drawer() -> Disk {
    let main = br#"<mujoco><include file="assets/drawer_dependencies.xml"/><include file="scene.xml"/>
<worldbody><geom type="plane" size="1 1 1"/><include file="assets/drawer.xml"/></worldbody></mujoco>"#;
    let dependencies = br#"<mujocoinclude><compiler angle="radian" meshdir="meshes"/>
<asset><material name="green" rgba=".1 .7 .2 1"/><mesh name="case" file="case.obj" scale="0.1 0.1 0.1"/></asset>
<default><default class="base"><joint damping="2"/><geom contype="0" conaffinity="0" group="1" type="mesh"/>
<default class="col"><geom contype="1" conaffinity="1" group="4" type="box"/></default></default></default></mujocoinclude>"#;
    let body = br#"<mujocoinclude><body childclass="base" pos="0 0 0.05"><geom material="green" mesh="case" pos="-0.1 -0.1 -0.05"/>
<geom class="col" pos="0 0 0" size="0.1 0.1 0.05" mass="0.5"/>
<body name="tray" pos="0 -0.1 0"><joint type="slide" axis="0 1 0" range="-0.1 0" name="slide"/>
<geom class="col" pos="0 -0.01 0" size="0.08 0.01 0.03" mass="0.1"/>
<geom class="col" type="capsule" fromto="-0.03 -0.04 0 0.03 -0.04 0" size="0.006" mass="0.02"/></body></body></mujocoinclude>"#;
    disk(&[
        ("objects/drawer.xml", main),
        ("objects/assets/drawer_dependencies.xml", dependencies),
        ("objects/assets/drawer.xml", body),
        (
            "objects/scene.xml",
            b"<mujocoinclude><worldbody><body><geom type='box' size='1 1 .1'/></body></worldbody></mujocoinclude>",
        ),
        ("objects/meshes/case.obj", &box_obj([2.0, 2.0, 1.0])),
    ])
}

/// PartNet-Mobility's files lack meshes now and then; the name is that of the metadata.
#[test]
fn missing_meshes_are_left_out_and_noted() {
    let robot = r#"<robot name="partnet_3f2a9c81b7e04d55"><link name="base">
        <visual><geometry><mesh filename="objs/a.obj"/></geometry></visual><visual><geometry><mesh filename="objs/gone.obj"/></geometry></visual>
        <collision><geometry><mesh filename="objs/a.obj"/></geometry></collision><collision><geometry><mesh filename="objs/gone.obj"/></geometry></collision>
        </link></robot>"#;
    let body = box_obj([0.5, 0.4, 1.8]);
    let mut files = disk(&[
        ("45132/mobility.urdf", robot.as_bytes()),
        ("45132/objs/a.obj", &body),
        ("45132/meta.json", br#"{"model_cat": "StorageFurniture", "anno_id": "7"}"#),
    ]);
    let object = import_from(&files, "45132/mobility.urdf", &Given::default()).unwrap();
    assert_eq!(object.model.card.name, "Storage Furniture");
    let left_out = |note: &&String| note.contains("left out") && note.contains("gone.obj");
    assert!(object.report.repairs.iter().any(|note| left_out(&note)), "{:?}", object.report.repairs);
    let proportions = object.model.card.size_m / object.model.card.size_m.z;
    assert!(proportions.abs_diff_eq(DVec3::new(0.5 / 1.8, 0.4 / 1.8, 1.0), 1e-6), "{proportions}");
    files.remove("45132/objs/a.obj");
    assert!(refused(&files, "45132/mobility.urdf").to_string().contains("no such file"));
}

/// Joints of objects that have no limits, or should follow another one, are read with a note; one with an empty range is
/// held where it is.
#[test]
fn joints_of_unusual_objects_are_noted() {
    let link = |name: &str, up: f64| {
        format!(
            "<link name='{name}'><visual><origin xyz='0 0 {up}'/><geometry><box size='0.1 0.1 0.02'/></geometry></visual>\
             <visual><geometry><heightmap/></geometry></visual></link>"
        )
    };
    let joint = |name: &str, child: &str, rest: &str| {
        format!(
            "<joint name='{name}' type='prismatic'><parent link='a'/><child link='{child}'/><axis xyz='0 0 1'/>{rest}</joint>"
        )
    };
    let limits = "<limit lower='0' upper='0.05' effort='1' velocity='1'/>";
    let text = [
        "<robot name='stand'>".to_owned(),
        ["a", "b", "c", "d"].iter().zip([0.0, 0.03, 0.06, 0.09]).map(|(name, up)| link(name, up)).collect(),
        joint("free", "b", ""),
        joint("led", "c", &format!("{limits}<mimic joint='free'/>")),
        joint("held", "d", "<limit lower='0.2' upper='0.2' effort='1' velocity='1'/>"),
        "</robot>".to_owned(),
    ]
    .concat();
    let object = import_from(&disk(&[("stand.urdf", text.as_bytes())]), "stand.urdf", &Given::default()).unwrap();
    let slide = JointKind::Prismatic;
    assert_eq!(joints(&object.model), [("free", slide, [-0.2, 0.2]), ("led", slide, [0.0, 0.05])]);
    assert!((object.model.card.size_m.z - 0.31).abs() < 1e-3, "held at 0.2 m: {}", object.model.card.size_m);
    for note in [
        "joint free states no limits: -0.20 to 0.20 are assumed",
        "joint led should follow free; joints of an object move by themselves",
        "joint held has an empty range: taken as fixed at 0.2",
        "line 1: visual geometry of an unknown kind is left out",
    ] {
        assert!(object.report.repairs.iter().any(|said| said == note), "{note}: {:?}", object.report.repairs);
    }
}

/// Found by `genmanip-lab hostile`: a plausible diagonal with products of inertia that no body can have.
#[test]
fn an_impossible_inertia_is_replaced_and_reported() {
    for (products, is_reported) in [
        (r#"ixy="0" ixz="0" iyz="0""#, false),
        (r#"ixy="0.05" ixz="0.05" iyz="0.05""#, true),
        (r#"ixy="0.003""#, false),
    ] {
        let text = format!(
            r#"<robot name="block"><link name="base">
            <inertial><mass value="2"/><inertia ixx="0.02" iyy="0.02" izz="0.02" {products}/></inertial>
            <visual><geometry><box size="0.2 0.2 0.2"/></geometry></visual></link></robot>"#
        );
        let files = disk(&[("block.urdf", text.as_bytes())]);
        let object = import_from(&files, "block.urdf", &Given::default()).unwrap();
        let reported = object.report.guesses.iter().any(|guess| guess.what == "inertia");
        assert_eq!(reported, is_reported, "{products}: {:?}", object.report.guesses);
    }
}

#[test]
fn an_mjcf_drawer_with_includes_and_classes_slides() {
    let object = import_from(&drawer(), "objects/drawer.xml", &Given::default()).unwrap();
    let model = &object.model;
    assert_eq!(joints(model), [("slide", JointKind::Prismatic, [-0.1, 0.0])]);
    assert_eq!(model.links.iter().map(|link| link.pieces.len()).collect::<Vec<_>>(), [1, 2]);
    assert_eq!(model.links[0].visual.len(), 1, "the collision box is not rendered");
    // MuJoCo counts visual geoms too: 4 dm³ of 1000 kg/m³.
    assert!((model.card.mass_kg - 4.62).abs() < 1e-6, "{}", model.card.mass_kg);
    assert_eq!(model.links[1].joint.as_ref().unwrap().damping, 2.0);
    let bounds = model.world_bounds(&Pose::IDENTITY, &[0.0]);
    assert!(bounds.min.z.abs() < 1e-6 && (bounds.max.z - 0.1).abs() < 1e-3, "{bounds:?}");
    assert!(
        object.report.repairs.iter().any(|repair| repair.contains("surrounding scene")),
        "{:?}",
        object.report.repairs
    );
    let shut = bounds.min.y;
    let opened = model.world_bounds(&Pose::IDENTITY, &model.joint_states[1].nominal).min.y;
    assert!((shut - opened - 0.09).abs() < 1e-6, "{shut} {opened}");
}

#[test]
fn a_robosuite_mjcf_collides_with_the_hull_of_its_mesh() {
    let can = br#"<mujoco model="can"><asset><mesh file="meshes/can.obj" name="can_mesh"/></asset><worldbody><body>
<body name="object"><geom mesh="can_mesh" type="mesh" density="100" friction="0.95 0.3 0.1" rgba="0.8 0.1 0.1 1"/></body>
<site name="bottom_site" pos="0 0 -0.06"/></body></worldbody></mujoco>"#;
    let files = disk(&[("can.xml", can), ("meshes/can.obj", &box_obj([0.05, 0.05, 0.1]))]);
    let object = import_from(&files, "can.xml", &Given::default()).unwrap();
    let card = &object.model.card;
    assert_eq!((object.model.friction, object.model.links.len()), (0.95, 1));
    assert!((card.mass_kg - 0.025).abs() < 1e-4, "density times volume: {}", card.mass_kg);
    assert!(card.can_grasp && card.states.is_empty(), "{card:?}");
}

#[test]
fn the_root_is_the_base_and_free_motion_is_not_a_joint() {
    let model = |joints: &str| {
        let text = format!(
            "<mujoco><worldbody><body>{joints}<geom type='box' size='.02 .02 .02'/></body></worldbody></mujoco>"
        );
        import_from(&disk(&[("a.xml", text.as_bytes())]), "a.xml", &Given::default()).unwrap()
    };
    for joints in [
        "<freejoint/>",
        "<joint type='slide' axis='1 0 0'/><joint type='slide' axis='0 1 0'/>",
        "<joint axis='0 0 1'/>",
    ] {
        let object = model(joints);
        assert_eq!((object.model.links.len(), object.model.joint_count()), (1, 0), "{joints}");
        assert_eq!(object.report.repairs.is_empty(), !joints.contains("<joint axis"), "{:?}", object.report.repairs);
    }
}

#[test]
fn orientation_formats_are_equivalent() {
    let body = |attributes: &str| {
        let text = format!(
            "<mujoco><compiler angle=\"degree\"/><worldbody><body><geom type=\"capsule\" {attributes}/></body></worldbody></mujoco>"
        );
        let model = import_from(&disk(&[("a.xml", text.as_bytes())]), "a.xml", &Given::default()).unwrap().model;
        model.card.size_m
    };
    let expected = DVec3::new(0.02, 0.12, 0.02);
    for attributes in [
        "size=\"0.01 0.05\" euler=\"90 0 0\"",
        "size=\"0.01 0.05\" quat=\"0.70710678 0.70710678 0 0\"",
        "size=\"0.01\" fromto=\"0 -0.05 0 0 0.05 0\"",
        "size=\"0.01 0.05\" axisangle=\"1 0 0 90\"",
        "size=\"0.01 0.05\" zaxis=\"0 1 0\"",
    ] {
        assert!(body(attributes).abs_diff_eq(expected, 1e-4), "{attributes}: {}", body(attributes));
    }
}

#[test]
fn invalid_descriptions_are_located() {
    let urdf = |inside: &str| disk(&[("a.urdf", format!("<robot name='a'>{inside}</robot>").as_bytes())]);
    let mjcf = |inside: &str| disk(&[("a.xml", format!("<mujoco>\n{inside}</mujoco>").as_bytes())]);
    let sphere = "<visual><geometry><sphere radius='0.03'/></geometry></visual>";
    let link = |name: &str| format!("<link name='{name}'>{sphere}</link>");
    let joint = |parent: &str, child: &str| {
        format!(
            "<joint name='j' type='revolute'><parent link='{parent}'/><child link='{child}'/><limit lower='0' upper='1'/></joint>"
        )
    };
    let loops = format!("{}{}{}{}{}", link("a"), link("b"), link("c"), joint("b", "c"), joint("c", "b"));
    let cases: Vec<(Disk, &str, &str)> = vec![
        (urdf(""), "a.urdf", "0 links"),
        (urdf(&format!("{}{}", link("a"), link("a"))), "a.urdf", "duplicate link name"),
        (urdf(&format!("{}{}", link("a"), link("b"))), "a.urdf", "got 2"),
        (urdf(&format!("{}{}", link("a"), joint("a", "x"))), "a.urdf", "`x`"),
        (urdf(&loops), "a.urdf", "loop"),
        (
            urdf("<link name='a'><visual><geometry><sphere radius='nan'/></geometry></visual></link>"),
            "a.urdf",
            "expected numbers",
        ),
        (
            urdf("<link name='a'><visual><geometry><box size='1 2'/></geometry></visual></link>"),
            "a.urdf",
            "expected 3 numbers",
        ),
        (
            urdf("<link name='a'><visual><geometry><mesh filename='/etc/passwd.obj'/></geometry></visual></link>"),
            "a.urdf",
            "absolute",
        ),
        (
            urdf("<link name='a'><visual><geometry><mesh filename='x.obj'/></geometry></visual></link>"),
            "a.urdf",
            "no such file",
        ),
        (disk(&[("a.urdf", b"<robot><link")]), "a.urdf", "not XML"),
        (disk(&[("a.urdf", b"<!DOCTYPE x [<!ENTITY a \"b\">]><robot/>")]), "a.urdf", "not XML"),
        (mjcf("<worldbody/>"), "a.xml", "no triangle"),
        (mjcf("<worldbody><body><geom class='x'/></body></worldbody>"), "a.xml", "unknown default class"),
        (mjcf("<worldbody><body><geom mesh='x'/></body></worldbody>"), "a.xml", "mesh"),
        (mjcf("<worldbody><body><geom size='0.1' material='x'/></body></worldbody>"), "a.xml", "material"),
        (mjcf("<include file='a.xml'/>"), "a.xml", "include each other"),
        (mjcf("<include file='../b.xml'/>"), "a.xml", "outside"),
        (
            mjcf(
                "<worldbody><body><freejoint/><geom size='0.1'/></body><body><freejoint/><geom size='0.1'/></body></worldbody>",
            ),
            "a.xml",
            "several objects",
        ),
    ];
    for (files, path, expected) in cases {
        let error = refused(&files, path);
        assert!(error.to_string().contains(expected), "expected `{expected}`: {error}");
        assert_eq!(error.to_string().lines().count(), 1, "{error}");
    }
}
