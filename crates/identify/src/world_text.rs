//! Worlds with changed physics, as text that keeps the comments of the world that they change.

use genmanip_assets::worlds;
use genmanip_core::{ArmPhysics, World};

use crate::parameters::CONTACT;

/// TOML text of a world whose robot, arm dynamics, frictions, damping of contacts or sensors differ from those of
/// `before`, which was read from `text`; comments are kept. `None` if the text sets these values in an unusual form of
/// TOML.
pub fn edited(text: &str, before: &World, world: &World) -> Option<String> {
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    if !has_robot(&lines, &world.robot.name) {
        set(&mut lines, "[robot]", "name", &format!("\"{}\"", world.robot.name));
    }
    if before.physics.pad_friction != world.physics.pad_friction {
        set(&mut lines, "[physics]", "pad_friction", &format!("{:?}", world.physics.pad_friction));
    }
    if let (Some(old), Some(new)) = (before.table(), world.table())
        && old.friction != new.friction
    {
        set(&mut lines, "[[surfaces]]", "friction", &format!("{:?}", new.friction));
    }
    if let (old, Some(new)) = (before.physics.engine.get(CONTACT), world.physics.engine.get(CONTACT))
        && old != Some(new)
    {
        set(&mut lines, "[physics.engine]", CONTACT, &new.to_string());
    }
    for (old, new) in before.cameras.iter().zip(&world.cameras) {
        if let (Some(sensor), true) = (new.sensor, old.sensor != new.sensor) {
            let table = camera_table(&lines, &new.name)?;
            set_in(&mut lines, table, "sensor", &inline(&serde_json::json!(sensor)));
        }
    }
    if before.physics.arm != world.physics.arm {
        remove(&mut lines, "[physics.arm]");
        lines.extend(world.physics.arm.iter().flat_map(arm_table));
    }
    let edited = lines.join("\n") + "\n";
    // Accepted only if the edited text parses to the intended world.
    let is_right = worlds::read(&edited).is_ok_and(|(read, _)| read == *world);
    is_right.then_some(edited)
}

fn has_robot(lines: &[String], name: &str) -> bool {
    section(lines, "[robot]")
        .is_some_and(|(from, to)| lines[from..to].iter().any(|line| line.contains(&format!("\"{name}\""))))
}

/// First and last line (exclusive) of the content of the first table with a header.
fn section(lines: &[String], header: &str) -> Option<(usize, usize)> {
    let at = lines.iter().position(|line| line.trim().split('#').next().unwrap_or_default().trim() == header)?;
    let length = lines[at + 1..].iter().position(|line| line.trim_start().starts_with('['));
    Some((at + 1, length.map_or(lines.len(), |length| at + 1 + length)))
}

/// Content of the `[[cameras]]` table with a name.
fn camera_table(lines: &[String], name: &str) -> Option<(usize, usize)> {
    let mut begin = 0;
    while let Some((from, to)) = section(&lines[begin..], "[[cameras]]").map(|(from, to)| (begin + from, begin + to)) {
        let is_name = |line: &String| {
            line.split_once('=')
                .is_some_and(|(key, value)| key.trim() == "name" && value.contains(&format!("\"{name}\"")))
        };
        if lines[from..to].iter().any(is_name) {
            return Some((from, to));
        }
        begin = from;
    }
    None
}

/// A value as TOML on one line.
fn inline(value: &serde_json::Value) -> String {
    match value {
        serde_json::Value::Object(table) => {
            let entries: Vec<String> = table.iter().map(|(key, value)| format!("{key} = {}", inline(value))).collect();
            format!("{{ {} }}", entries.join(", "))
        }
        other => other.to_string(),
    }
}

/// Sets a key of a table, keeping a comment behind its value; adds the table at the end if there is none.
fn set(lines: &mut Vec<String>, header: &str, key: &str, value: &str) {
    match section(lines, header) {
        Some(table) => set_in(lines, table, key, value),
        None => lines.extend([String::new(), header.into(), format!("{key} = {value}")]),
    }
}

/// The same in the lines of a table.
fn set_in(lines: &mut Vec<String>, (from, to): (usize, usize), key: &str, value: &str) {
    let is_key = |line: &String| line.split_once('=').is_some_and(|(name, _)| name.trim() == key);
    match lines[from..to].iter().position(is_key) {
        Some(at) => {
            let line = &mut lines[from + at];
            let comment = line.split_once('#').map_or_else(String::new, |(_, comment)| format!("  #{comment}"));
            *line = format!("{key} = {value}{comment}");
        }
        None => lines.insert(from, format!("{key} = {value}")),
    }
}

/// Removes a table with its header, up to the next header or comment of its own line.
fn remove(lines: &mut Vec<String>, header: &str) {
    let Some((from, to)) = section(lines, header) else { return };
    let kept = lines[from..to].iter().position(|line| line.trim_start().starts_with('#'));
    lines.drain(from - 1..kept.map_or(to, |kept| from + kept));
}

fn arm_table(arm: &ArmPhysics) -> Vec<String> {
    let mut table = vec![String::new(), "# Joint dynamics as identified; one number per joint, base to tip.".into()];
    table.push("[physics.arm]".into());
    table
        .extend(arm.lists().iter().filter(|(_, list)| !list.is_empty()).map(|(key, list)| format!("{key} = {list:?}")));
    table.push(format!("latency_s = {:?}", arm.latency_s));
    table
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parameters::set_contact_damping;

    #[test]
    fn a_changed_world_reads_back_and_keeps_its_comments() {
        let before = (*worlds::default_world()).clone();
        let mut world = before.clone();
        world.physics.arm = Some(ArmPhysics {
            kp: vec![4000.5; 7],
            kv: vec![150.0; 7],
            damping: vec![1.25; 7],
            friction_loss: vec![0.5; 7],
            latency_s: 0.03,
        });
        world.physics.pad_friction = 0.8;
        world.surfaces[0].friction = 0.45;
        set_contact_damping(&mut world, 0.25);
        world.cameras[1].sensor = Some(genmanip_core::sensor::SENSORS[0].sensor);
        let first = edited(worlds::DEFAULT_TEXT, &before, &world).unwrap();
        assert!(
            first.contains("# Usable part of the table.") && first.contains("larger coefficient of the two bodies")
        );
        // A second change replaces the first.
        let mut again = world.clone();
        again.physics.arm.as_mut().unwrap().latency_s = 0.01;
        let second = edited(&first, &world, &again).unwrap();
        assert_eq!(second.matches("[physics.arm]").count(), 1);
        assert_eq!(worlds::read(&second).unwrap().0, again);
        // Inline tables are no lines of their own.
        let inline = worlds::DEFAULT_TEXT.replace("[physics]\n", "[physics]\narm = { latency_s = 0.2 }\n");
        let (read, _) = worlds::read(&inline).unwrap();
        assert_eq!(edited(&inline, &read, &again), None);
    }
}
