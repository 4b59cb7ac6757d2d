//! Worlds with changed physics, as text that keeps the comments of the world that they change.

use genmanip_assets::AssetError;
use genmanip_assets::world_text::WorldText;
use genmanip_core::World;

use crate::parameters::CONTACT;

/// TOML text of a world whose robot, arm dynamics, frictions, damping of contacts or sensors differ from those of
/// `before`, which was read from `text`; comments are kept.
///
/// # Errors
/// [`AssetError::Data`] if the text is no TOML of a world.
pub fn edited(text: &str, before: &World, world: &World) -> Result<String, AssetError> {
    let mut text = WorldText::read(text)?;
    text.set(&["robot"], "name", &world.robot.name)?;
    if before.physics.pad_friction != world.physics.pad_friction {
        text.set(&["physics"], "pad_friction", &world.physics.pad_friction)?;
    }
    for (index, (old, new)) in before.surfaces.iter().zip(&world.surfaces).enumerate() {
        if old.friction != new.friction {
            text.set_entry("surfaces", index, "friction", &new.friction)?;
        }
    }
    if let (old, Some(new)) = (before.physics.engine.get(CONTACT), world.physics.engine.get(CONTACT))
        && old != Some(new)
    {
        text.set(&["physics", "engine"], CONTACT, new)?;
    }
    for (index, (old, new)) in before.cameras.iter().zip(&world.cameras).enumerate() {
        if let (Some(sensor), true) = (new.sensor, old.sensor != new.sensor) {
            text.set_entry("cameras", index, "sensor", &sensor)?;
        }
    }
    match &world.physics.arm {
        Some(arm) if before.physics.arm.as_ref() != Some(arm) => {
            text.put_table(
                &["physics"],
                "arm",
                arm,
                "Joint dynamics as identified; one number per joint, base to tip.",
            )?;
        }
        Some(_) => {}
        None => text.remove(&["physics"], "arm")?,
    }
    Ok(text.to_string())
}

#[cfg(test)]
mod tests {
    use genmanip_assets::worlds;
    use genmanip_core::ArmPhysics;

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
        assert_eq!(worlds::read(&first).unwrap().0, world);
        assert!(
            first.contains("# Usable part of the table.") && first.contains("larger coefficient of the two bodies")
        );
        // A second change replaces the first.
        let mut again = world.clone();
        again.physics.arm.as_mut().unwrap().latency_s = 0.01;
        let second = edited(&first, &world, &again).unwrap();
        assert_eq!(second.matches("[physics.arm]").count(), 1);
        assert_eq!(worlds::read(&second).unwrap().0, again);
        // Whichever way the text sets the values.
        for form in ["arm = { latency_s = 0.2 }", "arm.latency_s = 0.2"] {
            let text = worlds::DEFAULT_TEXT.replace("[physics]\n", &format!("[physics]\n{form}\n"));
            let (read, _) = worlds::read(&text).unwrap();
            let text = edited(&text, &read, &again).unwrap();
            assert_eq!(worlds::read(&text).unwrap().0, again, "{form}:\n{text}");
        }
    }
}
