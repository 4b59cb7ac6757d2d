//! Arguments of the policies of the registry.

use super::label::InLabel;
use crate::remote::CAMERAS;

/// An argument of a policy.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PolicyArgument {
    /// Name of the argument.
    pub name: &'static str,
    /// Default value, as text; may be empty.
    pub default: &'static str,
    /// Description in one line, with the unit.
    pub about: &'static str,
    /// Form of the value in the label of an evaluation.
    pub in_label: InLabel,
}

impl PolicyArgument {
    /// An argument whose value is part of the label.
    pub(super) const fn new(name: &'static str, default: &'static str, about: &'static str) -> Self {
        Self { name, default, about, in_label: InLabel::Value }
    }

    pub(super) const fn in_label(self, in_label: InLabel) -> Self {
        Self { in_label, ..self }
    }
}

const URL: PolicyArgument = PolicyArgument::new("url", "ws://127.0.0.1:8000", "where it is").in_label(InLabel::Address);
const EXTERIOR: PolicyArgument = PolicyArgument::new("exterior", CAMERAS[0], "the camera that stands beside the robot");
const TIMEOUT: PolicyArgument =
    PolicyArgument::new("timeout_s", "120", "how long is waited for an answer, s").in_label(InLabel::Omitted);

/// Arguments of a learned policy.
pub(super) const LEARNED_ARGUMENTS: [PolicyArgument; 3] = [
    PolicyArgument::new("folder", "", "folder of the policy").in_label(InLabel::Content),
    PolicyArgument::new("execute", "", "actions of a chunk that are executed; as trained, or 1 with ensemble"),
    PolicyArgument::new(
        "ensemble",
        "",
        "decay m of temporal ensembling, which averages overlapping chunks with weights exp(-m i), oldest first; 0.01 in ACT",
    ),
];

/// Arguments of a vla-eval model server.
pub(super) const VLA_EVAL_ARGUMENTS: [PolicyArgument; 5] = [
    URL,
    PolicyArgument::new("preset", "libero", "what it is shown and what it answers: libero or joint"),
    EXTERIOR,
    PolicyArgument::new("wrist", CAMERAS[1], "the camera at the hand, or nothing"),
    TIMEOUT,
];

/// Arguments of a Python policy.
pub(super) const PYTHON_ARGUMENTS: [PolicyArgument; 3] = [
    PolicyArgument::new("class", "", "MODULE:CLASS; the module lies in the working folder or PYTHONPATH"),
    PolicyArgument::new("python", "python3", "the interpreter, which has NumPy").in_label(InLabel::Omitted),
    TIMEOUT,
];

/// Arguments of an openpi policy server.
pub(super) const OPENPI_ARGUMENTS: [PolicyArgument; 6] = [
    URL,
    PolicyArgument::new(
        "preset",
        "droid",
        "what it is shown and what it answers: droid (joint speeds), droid_jointpos, libero, or genmanip, whose server says it",
    ),
    EXTERIOR,
    PolicyArgument::new("wrist", CAMERAS[1], "the camera at the hand"),
    PolicyArgument::new("execute", "", "actions of a chunk that are executed; droid 8, libero 5"),
    TIMEOUT,
];

/// Arguments of the agent.
pub(super) const AGENT_ARGUMENTS: [PolicyArgument; 21] = [
    PolicyArgument::new("vlm", "oracle", "who answers: oracle, random, recorded, or the settings file of a model")
        .in_label(InLabel::Content),
    PolicyArgument::new("answers", "", "folder where answers are recorded and given again from")
        .in_label(InLabel::Name),
    PolicyArgument::new("masks", "rgbd", "where masks come from: rgbd, oracle, or http:URL").in_label(InLabel::Address),
    PolicyArgument::new("grasps", "rgbd", "where grasps come from: rgbd, or http:URL").in_label(InLabel::Address),
    PolicyArgument::new("path", "p2p", "p2p asks for one cell, grid for a path over the grid"),
    PolicyArgument::new("preset", "full", "paper is as published, full is sturdier"),
    PolicyArgument::new(
        "asks",
        "",
        "every question, as paper, or those that are needed, as full; the preset's by default",
    ),
    PolicyArgument::new("ctof", "no", "yes asks for the part to hold, too"),
    PolicyArgument::new("arrows", "yes", "no leaves out the robot's directions"),
    PolicyArgument::new("loop", "closed", "open splits the task once and picks each thing once"),
    PolicyArgument::new("reasoning", "no", "yes asks for reasons before each answer"),
    PolicyArgument::new("camera", "overview", "the camera whose image models are shown"),
    PolicyArgument::new("prompts", "", "folder of prompt files that replace the built-in ones")
        .in_label(InLabel::Content),
    PolicyArgument::new("transcripts", "", "folder for questions, pictures and answers").in_label(InLabel::Omitted),
    PolicyArgument::new("analysis", "no", "yes classifies failures by simulator truth; results then say oracle"),
    PolicyArgument::new("err_decompose", "0", "share of asks that the oracle answers wrongly"),
    PolicyArgument::new("err_object", "0", "the same"),
    PolicyArgument::new("err_part", "0", "the same"),
    PolicyArgument::new("err_grab_point", "0", "the same"),
    PolicyArgument::new("err_path", "0", "the same, of paths and cells"),
    PolicyArgument::new("err_check", "0", "the same"),
];
