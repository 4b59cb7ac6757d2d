//! Masses, friction and bindings of materials of USD stages, against values of Pixar's library (26.11) for the same
//! stages.

use genmanip_import::{Given, Imported};
use glam::DVec3;

use crate::rigid::{disk, import_from};

/// Strength of a binding.
const STRONGER: &str = r#"(bindMaterialAs = "strongerThanDescendants")"#;
const MEMBERS: &str = "rel collection:some:includes = </mug/body/group/shape>
    rel material:binding:collection:some = [</mug/body/group.collection:some>, </mug/b>]";

/// Imports a body with a group with a cube of 10 cm, each with these statements. Material `a` is red, of 300 kg/m³ and
/// friction 0.3; `b` is green, of 600 kg/m³ and friction 0.6.
fn imported(body: &str, group: &str, shape: &str) -> Imported {
    let material = |name: &str, factor: f64, color: &str| {
        format!(
            r#"
    def Material "{name}" (prepend apiSchemas = ["PhysicsMaterialAPI"])
    {{
        float physics:density = {}
        float physics:dynamicFriction = {}
        float physics:staticFriction = 0.95
        token outputs:surface.connect = </mug/{name}/surface.outputs:surface>
        def Shader "surface"
        {{
            uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor = {color}
            token outputs:surface
        }}
    }}"#,
            1000.0 * factor,
            factor
        )
    };
    let text = format!(
        r#"#usda 1.0
(
    defaultPrim = "mug"
    metersPerUnit = 1
    upAxis = "Z"
)
def Xform "mug"
{{
    def Xform "body" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI", "MaterialBindingAPI"])
    {{
        {body}
        def Xform "group" (prepend apiSchemas = ["PhysicsMassAPI", "MaterialBindingAPI", "CollectionAPI:some"])
        {{
            {group}
            def Cube "shape" (prepend apiSchemas = ["PhysicsCollisionAPI", "PhysicsMassAPI", "MaterialBindingAPI"])
            {{
                double size = 0.1
                {shape}
            }}
        }}
    }}
    {}
    {}
}}
"#,
        material("a", 0.3, "(1, 0, 0)"),
        material("b", 0.6, "(0, 1, 0)")
    );
    import_from(&disk(&[("mug.usda", text.as_bytes())]), "mug.usda", &Given::default()).unwrap()
}

fn bind(material: &str, purpose: &str) -> String {
    format!("rel material:binding{purpose} = </mug/{material}>")
}

/// Checks mass (kg), friction, and the material that is drawn (`a`, `b`, or none).
fn check([body, group, shape]: [&str; 3], mass_kg: f64, friction: Option<f64>, drawn: &str) {
    let object = imported(body, group, shape);
    let place = format!("{body} | {group} | {shape}");
    let (model, notes) = (&object.model, object.report.repairs.join("\n"));
    assert!((model.card.mass_kg - mass_kg).abs() < 1e-6, "{place}: {} kg instead of {mass_kg}", model.card.mass_kg);
    if let Some(friction) = friction {
        assert!((model.friction - friction).abs() < 1e-6, "{place}: friction {} instead of {friction}", model.friction);
    }
    let [red, green, _] = model.links[0].visual[0].material.base_color;
    let found = if red > 0.9 && green < 0.1 {
        "a"
    } else if green > 0.9 && red < 0.1 {
        "b"
    } else {
        ""
    };
    assert_eq!(found, drawn, "{place}");
    assert_eq!(notes.contains("/mug/body/group: its mass is not used"), group.contains("density"), "{place}: {notes}");
}

/// Mass of the collider, its density, that of the body, that of its material, in this order; of the body before all.
#[test]
fn masses_and_densities_take_precedence_as_in_usd_physics() {
    let (all, physics) = (bind("a", ""), bind("a", ":physics"));
    check(["", "", "float physics:density = 500"], 0.5, None, "");
    check(["float physics:density = 700", "", ""], 0.7, None, "");
    check(["float physics:density = 700", "", "float physics:density = 500"], 0.5, None, "");
    check(["", "", &all], 0.3, Some(0.3), "a");
    check(["", "", &physics], 0.3, Some(0.3), "");
    check(["float physics:density = 700", "", &physics], 0.7, Some(0.3), "");
    check(["", "", &format!("{physics}\nfloat physics:density = 500")], 0.5, Some(0.3), "");
    check(["", "", "float physics:mass = 0.2\nfloat physics:density = 500"], 0.2, None, "");
    check(["float physics:mass = 0.4\nfloat physics:density = 500", "", "float physics:mass = 0.2"], 0.4, None, "");
    check(["", "float physics:density = 800", &all], 0.3, Some(0.3), "a");
}

/// The nearest binding, unless one above is stronger; for a purpose before all; to a collection before a direct one.
#[test]
fn materials_are_bound_as_in_usd_shade() {
    let [a, a_physics, b, b_physics] = [bind("a", ""), bind("a", ":physics"), bind("b", ""), bind("b", ":physics")];
    let stronger = |binding: &str| format!("{binding} {STRONGER}");
    check([&b, "", &a], 0.3, Some(0.3), "a");
    check([&stronger(&b), "", &a], 0.6, Some(0.6), "b");
    check([&b_physics, "", &a], 0.6, Some(0.6), "a");
    check([&b, "", &a_physics], 0.3, Some(0.3), "b");
    check([&stronger(&b), "", &a_physics], 0.3, Some(0.3), "b");
    check([&stronger(&b_physics), "", &a_physics], 0.6, Some(0.6), "");
    check(["", MEMBERS, ""], 0.6, Some(0.6), "b");
    check(["", MEMBERS, &a], 0.3, Some(0.3), "a");
    check(["", &stronger(MEMBERS), &a], 0.6, Some(0.6), "b");
    check(["", &format!("{MEMBERS}\n{a}"), ""], 0.6, Some(0.6), "b");
    check([&stronger(&a), &stronger(MEMBERS), ""], 0.3, Some(0.3), "a");
    check([&bind("a", ":preview"), "", &b], 0.6, Some(0.6), "a");
}

/// Colliders of different densities: their masses, centres and inertia add up, and the largest friction is used.
#[test]
fn colliders_of_one_body_add_up() {
    let second = |bound: &str| {
        format!(
            r#"
                {}
            }}
            def Cube "other" (prepend apiSchemas = ["PhysicsCollisionAPI", "MaterialBindingAPI"])
            {{
                double size = 0.1
                double3 xformOp:translate = (0.1, 0, 0)
                uniform token[] xformOpOrder = ["xformOp:translate"]
                {bound}
"#,
            bind("a", "")
        )
    };
    let object = imported("", "", &second(&bind("b", "")));
    let (model, mass) = (&object.model, &object.model.links[0].mass);
    assert!((mass.mass_kg - 0.9).abs() < 1e-9 && (model.friction - 0.6).abs() < 1e-6, "{mass:?} {}", model.friction);
    // The object stands at the middle of its extent, so that the centres of the cubes are at -5 and 5 cm.
    assert!((mass.center.x - (0.6 - 0.3) * 0.05 / 0.9).abs() < 1e-9, "{}", mass.center);
    let about_z = 0.9 * 0.01 / 6.0 + 0.3 * 0.6 / 0.9 * 0.01;
    assert!((mass.inertia.z_axis.z - about_z).abs() < 1e-9, "{} instead of {about_z}", mass.inertia.z_axis.z);
    let notes = object.report.repairs.join("\n");
    assert!(notes.contains("frictions of 0.3 to 0.6; the largest is used"), "{notes}");
    // Where one collider states a density, another one without has that of water.
    let object = imported("", "", &second(""));
    assert!((object.model.card.mass_kg - 1.3).abs() < 1e-9, "{}", object.model.card.mass_kg);
}

/// A stated centre moves the inertia of the shape by the parallel axis theorem, as in Pixar's library.
#[test]
fn a_stated_centre_moves_the_inertia() {
    let object = imported("float physics:mass = 4\npoint3f physics:centerOfMass = (0.02, 0, 0)", "", "");
    let mass = object.model.links[0].mass;
    let [about_x, about_y] = [4.0 * 0.01 / 6.0, 4.0 * 0.01 / 6.0 + 4.0 * 0.02 * 0.02];
    assert!((mass.center - DVec3::new(0.02, 0.0, 0.05)).length() < 1e-6, "{}", mass.center);
    let inertia = mass.inertia;
    assert!((inertia.x_axis.x - about_x).abs() < 1e-6 && (inertia.y_axis.y - about_y).abs() < 1e-6, "{inertia}");
}
