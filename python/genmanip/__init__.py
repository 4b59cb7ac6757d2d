"""GenManip in Python: environments, tasks, demonstrations, evaluation.

    import genmanip
    env = genmanip.Env(genmanip.Scenes.tasks(["task.json"]))
    seen = env.reset()
    step = env.step(seen["state"])

Gymnasium's environments are in genmanip.gym, and gymnasium.make("GenManip-v0", …) finds them after this import.
Units are metres, radians and seconds; the world is the robot's base frame: x away from the robot, y to its left, z up.
"""

from ._genmanip import Error, Saved, Scenes, __version__, engine, policies
from ._registration import register as _register
from .check import PolicyCheck, check_policy
from .environment import ACTIONS, Env, Step
from .functions import Dataset, Policy, collect, design, evaluate, export, layout, plan, render, tasks, train
from .projection import Projection

_register()

__all__ = [
    "ACTIONS",
    "Dataset",
    "Env",
    "Error",
    "Policy",
    "PolicyCheck",
    "Projection",
    "Saved",
    "Scenes",
    "Step",
    "__version__",
    "check_policy",
    "collect",
    "design",
    "engine",
    "evaluate",
    "export",
    "layout",
    "plan",
    "policies",
    "render",
    "tasks",
    "train",
]
