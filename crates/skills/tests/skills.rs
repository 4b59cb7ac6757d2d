//! A take of the scripted operator becomes a skill, and the skill an episode of another object.

#![allow(clippy::unwrap_used)] // The exemption for tests does not reach helpers of an integration test.

use std::sync::Arc;

use genmanip_assets::worlds::default_world;
use genmanip_assets::{Catalogue, GraspLibrary, robots};
use genmanip_core::{Document, DocumentError, Episode, Pose, RobotModel, Seed};
use genmanip_layout::articulation::joint_changes;
use genmanip_layout::{LayoutSettings, lay_out};
use genmanip_motion::{Planner, PlannerSettings};
use genmanip_rollout::expert::{Expert, ExpertSettings};
use genmanip_rollout::policies::DoNothing;
use genmanip_rollout::{RolloutSettings, Stage, replay, run_episode};
use genmanip_skills::operator::joint_script;
use genmanip_skills::tasks::state_task;
use genmanip_skills::{Grip, Skill, SkillSet, Transfer, TransferSettings, Verb, record, serves_task};
use genmanip_teleop::scripted::{Habits, ScriptedOperator, VirtualKind};
use genmanip_teleop::{TeleopSettings, Teleoperation};

/// Scene with a button of the catalogue that is to be pressed.
fn stage(uid: &str, planner: &Planner, seed: u64) -> Stage {
    let catalogue = Catalogue::full();
    let card = catalogue.card(uid).unwrap();
    let task = state_task(card, "released", "pressed");
    let (world, settings) = (default_world(), LayoutSettings::default());
    let grasps = GraspLibrary::builtin();
    let scenario = lay_out(&task, catalogue, &world, planner, grasps, Seed::new(seed), &settings).unwrap();
    Stage::open(Arc::new(scenario), catalogue, planner.robot()).unwrap()
}

fn robot() -> Arc<RobotModel> {
    robots::named(&default_world().robot.name).unwrap()
}

/// Take of the scripted operator, at another device for each seed.
fn take(stage: &Stage, seed: u64) -> Episode {
    let placed = &stage.scenario.objects[0];
    let change = joint_changes(stage.start(), 0, "pressed").remove(0);
    let tcp = stage.robot.tcp_pose(&stage.scenario.world.robot.home);
    let script = joint_script(&stage.models[0], &placed.pose, &placed.joint_positions, &change, &tcp).unwrap();
    let settings = TeleopSettings::default();
    let operator = ScriptedOperator::new(
        VirtualKind::ALL[seed as usize % VirtualKind::ALL.len()],
        script,
        Habits::default(),
        settings.mapping.clone(),
        1.0 / stage.control_rate_hz(),
    );
    let mut policy = Teleoperation::new(settings, Box::new(operator), &stage.robot, &stage.scenario.world).unwrap();
    let rollout = RolloutSettings { horizon_s: 60.0, ..RolloutSettings::default() };
    run_episode(stage, &mut policy, "take", Seed::new(seed), &rollout).unwrap()
}

#[test]
fn a_take_becomes_a_skill_and_a_verified_episode() {
    let planner = Arc::new(Planner::new(robot(), PlannerSettings::default()).unwrap());
    // The operator errs now and then, as people do.
    let skill_of = |seed: u64| {
        let source = stage("push-button-1", &planner, seed);
        record(&source, &take(&source, seed), "press-1", "0123").ok()
    };
    let skill = (1..16).find_map(skill_of).unwrap();
    assert_eq!(skill.verb, Verb::Press);
    assert!(matches!(skill.grip, Grip::Fixed { .. }), "{:?}", skill.grip);
    let [begin, end] = skill.segments.manipulate;
    assert!(skill.segments.approach[1] <= begin && begin < end, "{:?}", skill.segments);
    assert_eq!(Skill::from_json(&skill.to_json()).unwrap(), skill);

    let target = stage("push-button-4", &planner, 9);
    let settings = RolloutSettings { horizon_s: 40.0, ..RolloutSettings::default() };
    let transfer = |skill: &Skill| {
        let skills: Arc<[Skill]> = Arc::new([skill.clone()]);
        let mut policy = Transfer::new(&target, &planner, skills, TransferSettings::default());
        run_episode(&target, &mut policy, "transfer", Seed::new(4), &settings).unwrap()
    };
    let episode = transfer(&skill);
    assert!(episode.result.success, "{:?}", episode.result.failures);
    assert!(replay::check(&target, &episode).unwrap().identical);
    let bits = |episode: &Episode| episode.final_state.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
    assert_eq!(bits(&transfer(&skill)), bits(&episode), "the same seed gives the same bytes");

    // The expert presses by the skill, and by its own motions where no skill serves.
    let model = |index: usize| target.models.get(index).cloned();
    for (verb, is_used) in [(Verb::Press, true), (Verb::Pull, false)] {
        let set = SkillSet::new(vec![Skill { verb, ..skill.clone() }]);
        assert_eq!(serves_task(&set.skills[0], &target.scenario.task, &model), is_used);
        let expert = Expert::new(&target, &planner, GraspLibrary::builtin(), ExpertSettings::default()).unwrap();
        let mut expert = expert.with_skills(Arc::new(set));
        let episode = run_episode(&target, &mut expert, "expert", Seed::new(4), &settings).unwrap();
        assert!(episode.result.success, "{:?}", episode.result.failures);
        assert_eq!(expert.has_used_skill(), is_used);
    }

    // A skill of another kind does not serve the goal.
    let other = transfer(&Skill { verb: Verb::Pull, ..skill });
    assert!(other.result.failures[0].evidence.contains("no skill to press"), "{:?}", other.result.failures);

    let mut idle = DoNothing { duration_s: 0.1 };
    let failed = run_episode(&target, &mut idle, "idle", Seed::new(0), &settings).unwrap();
    assert!(record(&target, &failed, "idle", "").unwrap_err().to_string().contains("did not reach its goal"));
}

/// A minimal valid skill.
const SKILL: &str = include_str!("../testdata/press.json");

#[test]
fn files_are_refused_with_the_place() {
    let check = |from: &str, to: &str, place: &str| {
        assert!(SKILL.contains(from), "{from}");
        let error = Skill::from_json(&SKILL.replacen(from, to, 1)).unwrap_err();
        assert!(error.to_string().contains(place), "{from} as {to}: {error}");
        assert!(!matches!(error, DocumentError::NotJson { .. }), "{error}");
    };
    let valid = Skill::from_json(SKILL).unwrap();
    assert_eq!(valid.motion.as_ref().unwrap().along[0].position, Pose::from_position([0.0, 0.0, 0.02].into()).position);
    check("genmanip.skill/1", "genmanip.skill/9", "genmanip.skill/9");
    check("\"press-1\"", "\"../press\"", "$.name");
    check("\"verb\": \"press\"", "\"verb\": \"shove\"", "verb");
    check("\"verb\": \"press\"", "\"verb\": \"pick_and_place\"", "$.verb");
    check("\"motion\"", "\"carry\"", "carry");
    check("[0.0, 0.0075]", "[0.0, 0.0]", "$.motion.from_to");
    check("\"nominal\": 0.0075", "\"nominal\": 0.5", "$.motion.nominal");
    check(
        "\"approach\": [{\"position_m\": [0, 0, 0.1], \"orientation_wxyz\": [0, 1, 0, 0]}]",
        "\"approach\": []",
        "$.motion.approach",
    );
    check("[0, 0, 0.02]", "[0, 0, 50]", "$.motion.along[0]");
    check("\"width_m\": 0.0", "\"width_m\": -1.0", "$.grip");
    check("\"retreat\": []", "\"retreat\": [], \"more\": 1", "more");
}

#[test]
fn the_schema_is_up_to_date() {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../schemas/skill.schema.json");
    let text = serde_json::to_string_pretty(&schemars::schema_for!(Skill)).unwrap() + "\n";
    if std::env::var_os("GENMANIP_UPDATE_SCHEMAS").is_some() {
        std::fs::write(&path, &text).unwrap();
    }
    let stored = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(stored == text, "schemas/skill.schema.json is stale: run the tests with GENMANIP_UPDATE_SCHEMAS=1");
}
