"""GenManip in Python: environments, tasks, demonstrations, evaluation.

    import genmanip
    env = genmanip.Env(genmanip.Scenes.tasks(["task.json"]))
    seen = env.reset()
    step = env.step(seen["state"])

Gymnasium's environments are in genmanip.gym, and gymnasium.make("GenManip-v0", …) finds them after this import.
Units are metres, radians and seconds; the world is the robot's base frame: x away from the robot, y to its left, z up.
"""

from ._library import load as _load

_load()

from ._genmanip import Error, Saved, Scenes, __version__, engine, policies  # noqa: E402
from ._registration import register as _register  # noqa: E402
from .environment import ACTIONS, Env, Step  # noqa: E402
from .functions import Dataset, Policy, collect, design, evaluate, layout, tasks  # noqa: E402
from .projection import Projection  # noqa: E402

_register()

__all__ = [
    "ACTIONS",
    "Dataset",
    "Env",
    "Error",
    "Policy",
    "Projection",
    "Saved",
    "Scenes",
    "Step",
    "__version__",
    "collect",
    "design",
    "engine",
    "evaluate",
    "layout",
    "policies",
    "tasks",
]
