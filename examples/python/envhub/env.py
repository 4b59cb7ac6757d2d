"""LeRobot's EnvHub: a repository with this file as env.py gives `lerobot-eval` GenManip's environments.

    lerobot-eval --env.type=hub --env.hub_path=OWNER/NAME …

`cfg` may hold what GenManip-v0 takes, for example suite, index, size and rate_hz; GENMANIP_SUITE names the suite else.
"""

import os

import gymnasium
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv


def make_env(n_envs=1, use_async_envs=False, cfg=None):
    """{suite: {number of the scene: vector environment}}, of all scenes or the one that cfg["index"] names."""
    from genmanip import Scenes

    given = {"suite": os.environ.get("GENMANIP_SUITE"), "observation": "rgb", "size": (256, 256), "horizon_s": 60.0}
    given["normalized"] = False  # policies act in the units of their dataset
    given.update(cfg if isinstance(cfg, dict) else {})
    indices = [given.pop("index")] if "index" in given else range(len(Scenes.suite(given["suite"])))
    vector = AsyncVectorEnv if use_async_envs else SyncVectorEnv

    def environments(index):
        def make():
            return gymnasium.make("genmanip:GenManip-v0", index=index, **given).unwrapped

        return vector([make] * n_envs, autoreset_mode=AutoresetMode.SAME_STEP)

    name = os.path.basename(os.path.normpath(given["suite"]))
    return {name: {index: environments(index) for index in indices}}
