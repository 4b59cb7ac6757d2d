//! Restricts objects to those that a robot's workspace takes, and objects to move to those that its gripper holds.

use genmanip_core::{ObjectCard, RobotModel};

/// Opening of the gripper for which cards say `can_grasp`, metres: that of the Panda hand.
const USUAL_WIDTH_M: f64 = 0.08;

/// Free opening beside a grasped object, metres; also the limit for imported objects.
const CLEARANCE_M: f64 = 0.006;

/// Mass held per newton of grip force (sum over both fingers), kg/N: 40 to 50 N hold 700 g by friction alone.
const KG_PER_NEWTON: f64 = 0.7 / 45.0;

/// Longest side and height of objects in the workspace of arms with the reach of the default one, metres: those of the
/// catalogue.
const LARGEST_M: [f64; 2] = [0.36, 0.24];

/// The cards that are as small in the workspace of a robot with a short reach ([`RobotModel::reach_scale`]) as the
/// catalogue's objects are in the default one; all of them for other robots.
pub fn fitting(robot: &RobotModel, cards: &[ObjectCard]) -> Vec<ObjectCard> {
    let scale = robot.reach_scale();
    let [side_m, height_m] = LARGEST_M.map(|metres| metres * scale);
    let fits = |card: &&ObjectCard| {
        scale >= 1.0 || card.size_m.truncate().max_element() <= side_m && card.size_m.z <= height_m
    };
    cards.iter().filter(fits).cloned().collect()
}

/// The cards, with `can_grasp` false where the robot's gripper is too narrow or too weak. Unchanged for grippers that
/// open as far as the Panda hand.
///
/// A hollow object passes at any width, since its rim may be grasped.
pub fn graspable_by(robot: &RobotModel, cards: &[ObjectCard]) -> Vec<ObjectCard> {
    let width_m = robot.gripper.max_width;
    if width_m >= USUAL_WIDTH_M {
        return cards.to_vec();
    }
    let max_mass_kg = robot.drives.as_ref().map_or(f64::INFINITY, |drives| drives.grip_force_n * KG_PER_NEWTON);
    let holds = |card: &ObjectCard| {
        let is_narrow = card.size_m.x.min(card.size_m.y) <= width_m - CLEARANCE_M;
        card.mass_kg <= max_mass_kg && (is_narrow || card.annotations.room.is_some())
    };
    cards.iter().map(|card| ObjectCard { can_grasp: card.can_grasp && holds(card), ..card.clone() }).collect()
}

#[cfg(test)]
mod tests {
    use genmanip_assets::{Catalogue, panda};
    use genmanip_core::Reach;

    use super::*;

    #[test]
    fn a_short_arm_gets_small_objects() {
        let cards = Catalogue::builtin().cards();
        assert_eq!(fitting(&panda(), cards), cards);
        let short = RobotModel { reach: Some(Reach { max_m: 0.45, from_above_m: [0.12, 0.35] }), ..(*panda()).clone() };
        let small = fitting(&short, cards);
        let is_small = |card: &ObjectCard| card.size_m.truncate().max_element() <= 0.18 && card.size_m.z <= 0.12;
        assert!(small.len() < cards.len() && small.len() >= 20 && small.iter().all(is_small));
        assert!(cards.iter().filter(|card| is_small(card)).count() == small.len());
    }

    #[test]
    fn a_small_gripper_holds_less() {
        let cards = Catalogue::builtin().cards();
        assert_eq!(graspable_by(&panda(), cards), cards);
        let mut small = (*panda()).clone();
        small.gripper.max_width = 0.05;
        let held = graspable_by(&small, cards);
        let gone: Vec<&ObjectCard> = held
            .iter()
            .zip(cards)
            .filter(|(now, before)| now.can_grasp != before.can_grasp)
            .map(|(now, _)| now)
            .collect();
        let side = |card: &ObjectCard| card.size_m.x.min(card.size_m.y);
        assert!(!gone.is_empty() && gone.iter().all(|card| side(card) > 0.044 && card.annotations.room.is_none()));
        assert!(held.iter().filter(|card| card.can_grasp).count() > 10);
        small.drives.as_mut().unwrap().grip_force_n = 1.0;
        let light = |card: &ObjectCard| !card.can_grasp || card.mass_kg <= 0.016;
        assert!(graspable_by(&small, cards).iter().all(light));
    }
}
