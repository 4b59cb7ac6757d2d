//! Arguments of the policies of the registry.

/// An argument of a policy.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PolicyArgument {
    /// Its name.
    pub name: &'static str,
    /// Its value where none is given.
    pub default: &'static str,
    /// One-line description with its unit.
    pub about: &'static str,
}

const URL: PolicyArgument = PolicyArgument { name: "url", default: "ws://127.0.0.1:8000", about: "where it is" };
const EXTERIOR: PolicyArgument =
    PolicyArgument { name: "exterior", default: "static", about: "the camera that stands beside the robot" };
const TIMEOUT: PolicyArgument =
    PolicyArgument { name: "timeout_s", default: "120", about: "how long is waited for an answer, s" };

/// Arguments of a vla-eval model server.
pub(super) const VLA_EVAL_ARGUMENTS: [PolicyArgument; 5] = [
    URL,
    PolicyArgument {
        name: "preset",
        default: "libero",
        about: "what it is shown and what it answers: libero or joint",
    },
    EXTERIOR,
    PolicyArgument { name: "wrist", default: "wrist", about: "the camera at the hand, or nothing" },
    TIMEOUT,
];

/// Arguments of a Python policy.
pub(super) const PYTHON_ARGUMENTS: [PolicyArgument; 3] = [
    PolicyArgument {
        name: "class",
        default: "",
        about: "MODULE:CLASS; the module lies in the working folder or PYTHONPATH",
    },
    PolicyArgument { name: "python", default: "python3", about: "the interpreter, which has NumPy" },
    TIMEOUT,
];

/// Arguments of an openpi policy server.
pub(super) const OPENPI_ARGUMENTS: [PolicyArgument; 6] = [
    URL,
    PolicyArgument {
        name: "preset",
        default: "droid",
        about: "what it is shown and what it answers: droid (joint speeds), droid_jointpos or libero",
    },
    EXTERIOR,
    PolicyArgument { name: "wrist", default: "wrist", about: "the camera at the hand" },
    PolicyArgument { name: "execute", default: "", about: "actions of a chunk that are executed; droid 8, libero 5" },
    TIMEOUT,
];

/// Arguments of the agent.
pub(super) const AGENT_ARGUMENTS: [PolicyArgument; 19] = [
    PolicyArgument {
        name: "vlm",
        default: "oracle",
        about: "who answers: oracle, random, recorded, or the settings file of a model",
    },
    PolicyArgument { name: "answers", default: "", about: "folder where answers are recorded and given again from" },
    PolicyArgument { name: "masks", default: "rgbd", about: "where masks come from: rgbd, oracle, or http:URL" },
    PolicyArgument { name: "grasps", default: "rgbd", about: "where grasps come from: rgbd, or http:URL" },
    PolicyArgument { name: "path", default: "p2p", about: "p2p asks for one cell, grid for a path over the grid" },
    PolicyArgument { name: "preset", default: "full", about: "paper is as published, full is sturdier" },
    PolicyArgument { name: "ctof", default: "no", about: "yes asks for the part to hold, too" },
    PolicyArgument { name: "arrows", default: "yes", about: "no leaves out the robot's directions" },
    PolicyArgument { name: "loop", default: "closed", about: "open splits the task once and picks each thing once" },
    PolicyArgument { name: "reasoning", default: "no", about: "yes asks for reasons before each answer" },
    PolicyArgument { name: "camera", default: "overview", about: "the camera whose image models are shown" },
    PolicyArgument { name: "prompts", default: "", about: "folder of prompt files that replace the built-in ones" },
    PolicyArgument { name: "transcripts", default: "", about: "folder for questions, pictures and answers" },
    PolicyArgument { name: "err_decompose", default: "0", about: "share of asks that the oracle answers wrongly" },
    PolicyArgument { name: "err_object", default: "0", about: "the same" },
    PolicyArgument { name: "err_part", default: "0", about: "the same" },
    PolicyArgument { name: "err_grab_point", default: "0", about: "the same" },
    PolicyArgument { name: "err_path", default: "0", about: "the same, of paths and cells" },
    PolicyArgument { name: "err_check", default: "0", about: "the same" },
];
