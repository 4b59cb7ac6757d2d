//! Objects as free bodies with convex collision pieces and explicit inertia.

use std::sync::Arc;

use genmanip_core::{JointKind, MassProperties, ObjectModel};

use super::{Parts, color, geom, inertial, mesh, with_pose};
use crate::SceneObject;
use crate::engine_settings::CheckedSettings;
use crate::xml::Element;

pub(crate) fn object_body(object: &str, link: &str) -> String {
    format!("object/{object}/{link}")
}

pub(crate) fn object_joint(object: &str, joint: &str) -> String {
    format!("object/{object}/{joint}")
}

/// Name of an object's free joint.
pub(crate) fn object_free_joint(object: &str) -> String {
    format!("object/{object}")
}

pub(super) fn add(parts: &mut Parts, objects: &[SceneObject], settings: &CheckedSettings) {
    for (index, object) in objects.iter().enumerate() {
        // Objects that share a model share its meshes, named after the first object.
        let first = objects[..index].iter().find(|other| Arc::ptr_eq(&other.model, &object.model));
        let owner = first.map_or(object.name.as_str(), |other| other.name.as_str());
        if first.is_none() {
            add_meshes(parts, &object.model, owner);
        }
        let mut writer = Writer { object, owner, settings, qpos: &mut parts.qpos };
        let body = writer.root();
        parts.bodies.push(body);
    }
}

/// Name of a geom or mesh of a collision piece; `owner` is the object, for a mesh the first one with that model.
fn piece_name(owner: &str, link: &str, piece: usize) -> String {
    format!("object/{owner}/{link}/{piece}")
}

fn add_meshes(parts: &mut Parts, model: &ObjectModel, owner: &str) {
    for link in &model.links {
        for (number, piece) in link.pieces.iter().enumerate() {
            parts.assets.extend(mesh(piece, &piece_name(owner, &link.name, number)));
        }
    }
}

struct Writer<'a> {
    object: &'a SceneObject,
    owner: &'a str,
    settings: &'a CheckedSettings,
    qpos: &'a mut Vec<f64>,
}

impl Writer<'_> {
    fn root(&mut self) -> Element {
        let pose = self.object.pose;
        self.qpos.extend(pose.position.to_array());
        self.qpos.extend(pose.to_wxyz_array());
        let name = object_body(&self.object.name, &self.object.model.links[0].name);
        let mut body = with_pose(Element::named("body", &name), &pose)
            .child(Element::named("freejoint", &object_free_joint(&self.object.name)));
        self.fill(&mut body, 0);
        body
    }

    fn fill(&mut self, body: &mut Element, index: usize) {
        let model = Arc::clone(&self.object.model);
        let link = &model.links[index];
        let [turning, rolling] = self.settings.physics.rotational_friction_m;
        let rgba = color(link.visual.first().map(|part| &part.material));
        let factors = self.object.physics;
        body.push(inertial(&MassProperties {
            mass_kg: factors.mass * link.mass.mass_kg,
            inertia: link.mass.inertia * factors.mass,
            ..link.mass
        }));
        let [time_s, ratio] = self.settings.engine.contact_solref;
        let solref = [time_s, factors.contact_damping * ratio];
        for (number, piece) in link.pieces.iter().enumerate() {
            let name = piece_name(&self.object.name, &link.name, number);
            let mut geom = geom(&name, "object", piece, &piece_name(self.owner, &link.name, number))
                .numbers("friction", &[factors.friction * model.friction, turning, rolling])
                .numbers("rgba", &rgba);
            if solref != self.settings.engine.contact_solref {
                geom = geom.numbers("solref", &solref);
            }
            body.push(geom);
        }
        for (child, link) in model.links.iter().enumerate() {
            let Some(joint) = link.joint.as_ref().filter(|joint| joint.parent == index) else { continue };
            let kind = match joint.kind {
                JointKind::Revolute => "hinge",
                JointKind::Prismatic => "slide",
            };
            // Positions are listed in link order, which may differ from tree order.
            let number = model.links[..child].iter().filter(|link| link.joint.is_some()).count();
            self.qpos.push(self.object.joint_positions.get(number).copied().unwrap_or(0.0));
            let name = object_body(&self.object.name, &link.name);
            let mut element = with_pose(Element::named("body", &name), &joint.parent_from_joint).child(
                Element::named("joint", &object_joint(&self.object.name, &joint.name))
                    .text("type", kind)
                    .numbers("axis", &joint.axis.to_array())
                    .numbers("range", &joint.range)
                    .number("damping", factors.joint_friction * joint.damping)
                    .number("frictionloss", factors.joint_friction * joint.friction_loss)
                    .numbers("solimpfriction", &self.settings.engine.joint_friction_solimp)
                    .number("stiffness", joint.stiffness)
                    .number("springref", joint.spring_reference),
            );
            self.fill(&mut element, child);
            body.push(element);
        }
    }
}
