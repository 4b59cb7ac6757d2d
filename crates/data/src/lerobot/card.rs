//! Data-set card: `README.md` with the YAML front matter that data set hubs read.

use super::LerobotSettings;
use super::imported::Imported;
use crate::export::{ExtraColumns, describe_action};

/// Card of the main data set.
pub fn color(name: &str, settings: &LerobotSettings, version: &str) -> String {
    let asks = |columns| settings.export.columns.contains(&columns);
    let mut depth = String::new();
    if asks(ExtraColumns::Boxes) {
        depth += "`sim.box.*` are boxes (left, top, right, bottom in pixels) around what the pictures show of each object.\n";
    }
    if settings.export.depth {
        depth += &format!("Depth images of the same frames are in the sibling data set `{name}-depth`.\n");
    }
    if asks(ExtraColumns::Masks) {
        depth += &format!(
            "`{name}-depth` also has masks: the object that each pixel shows, 0 = nothing, 1 = table, 2 = robot, 3 + i = object i \
             of `objects` in the episodes table.\n"
        );
    }
    let corrections = if settings.export.has_corrections {
        "- `is_correction`: the expert has taken over from the policy that acted first and failed; the rows before are \
         that policy's, not to be imitated. `corrected_policy`, `corrected_cause` and `corrected_from_step` (60 Hz) in \
         the episodes table.\n"
    } else {
        ""
    };
    let record = if settings.record {
        "`extras/record` holds every episode as it was simulated: scenario, initial state, every 60 Hz command.\n\
         `genmanip replay` reproduces an episode from it, byte for byte.\n"
    } else {
        ""
    };
    format!(
        "{}# {name}\n\n\
         Tabletop manipulation demonstrations, made in simulation by GenManip in Rust, in the LeRobotDataset {version} \
         format.\n\
         Each episode was made by an expert that reads the simulator's state, and was verified after settling; \
         `success` in the episodes table says so.\n\n\
         - `observation.state`: arm joint positions (rad) and gripper opening (m).\n\
         - `action`: {}.\n\
         - `observation.images.*`: RGB video at {} frames per second.\n\
         - `ee.*`: the tool's pose; `ee.state` and `ee.action` have angles about the fixed x, y, z axes, \
         R = Rz·Ry·Rx, which jump; train on `ee.rotation_6d` or `ee.quaternion`, which do not.\n\
         - `is_idle`: the command stays and nothing moves.\n{corrections}\
         - `sim.*`: simulator truth, not for policies.\n\
         - `camera.*`: camera poses; intrinsics are in the episodes table.\n\n\
         `meta/genmanip.json` says what every column means, `meta/action_contract.json` what the actions are.\n\
         The episodes table also holds seed, scenario, task, policy, engine and program version.\n{depth}{record}",
        front_matter(),
        describe_action(&settings.export.action),
        settings.export.fps
    )
}

/// Card of the depth data set.
pub fn depth(name: &str) -> String {
    format!(
        "{}# {name}-depth\n\n\
         Depth images of the data set `{name}`, with the same episode and frame indices.\n\
         They are kept apart because training code takes every image column for an input of the policy.\n\n\
         Each `observation.images.*_depth` is a 16-bit grey PNG: millimetres along the optical axis, 0 = nothing hit.\n",
        front_matter()
    )
}

/// Card of an imported data set, which keeps the licence of its source.
pub fn imported(name: &str, imported: &Imported) -> String {
    let notes: String = imported.notes.iter().map(|note| format!("- {note}.\n")).collect();
    let notes = if notes.is_empty() { notes } else { format!("\nIt differs from its source:\n\n{notes}") };
    let front = "---\ntask_categories:\n- robotics\ntags:\n- LeRobot\nconfigs:\n- config_name: default\n  data_files: \
                 data/*/*.parquet\n---\n\n";
    format!(
        "{front}# {name}\n\n\
         Imported by GenManip in Rust from a data set in the format {}; what the columns mean, and the licence, are \
         those of its source.\n\
         `store_id` of the episodes table says which episode of the source each one was.\n{notes}",
        imported.format
    )
}

/// YAML front matter of data sets that this program exports, with their licence and tags.
fn front_matter() -> &'static str {
    "---\n\
     license: cc0-1.0\n\
     task_categories:\n\
     - robotics\n\
     tags:\n\
     - LeRobot\n\
     - GenManip\n\
     - simulation\n\
     configs:\n\
     - config_name: default\n\
     \u{20} data_files: data/*/*.parquet\n\
     ---\n\n"
}
