"""The published vla-eval package and GenManip, both ways; run by `cargo xtask test --interop`.

Usage: interop_vla_eval.py PROGRAM SCENARIOS FOLDER: a model server of vla-eval leads our arm in `genmanip evaluate`, and
vla-eval's orchestrator runs the same server on our scenes.
"""

import json
import pathlib
import subprocess
import sys

import numpy as np
from vla_eval import api
from vla_eval.model_servers.base import ModelServer
from vla_eval.specs import GRIPPER_CLOSE_POS, IMAGE_RGB, LANGUAGE, POSITION_DELTA, ROTATION_AA

STEPS = 10


class Down(ModelServer):
    """Lowers the open hand by 1 cm per action, ten times, then holds still."""

    def __init__(self):
        self.told, self.episodes = [], 0

    async def on_episode_start(self, config, ctx):
        self.episodes += 1

    async def on_observation(self, obs, ctx):
        shapes = {name: image.shape for name, image in obs["images"].items()}
        self.told.append((obs["task_description"], shapes, np.shape(obs.get("states", []))))
        down = -0.2 if ctx.step < STEPS else 0.0
        await ctx.send_action({"actions": np.array([0, 0, down, 0, 0, 0, -1], np.float32)})

    def get_action_spec(self):
        return {"position": POSITION_DELTA, "rotation": ROTATION_AA, "gripper": GRIPPER_CLOSE_POS}

    def get_observation_spec(self):
        return {"image": IMAGE_RGB, "language": LANGUAGE}

    def get_observation_params(self):
        return {"send_wrist_image": True, "send_state": True}


program, scenarios, folder = sys.argv[1:]

# Their server, our loop.
server = Down()
with api.serve_background(server) as handle:
    out = pathlib.Path(folder) / "ours"
    policy = f"vla-eval:url={handle.url},preset=libero"
    subprocess.run([program, "--quiet", "evaluate", scenarios, "--policy", policy, "--out", out], check=True)
(report,) = [json.loads(file.read_text()) for file in (out / "evaluation").glob("vla-eval*.json")]
(row,) = report["results"]
assert row["policy"] == "vla-eval" and row["ending"] == "horizon" and not report["not_run"], row
assert row["tcp_path_m"] > 0.08, row["tcp_path_m"]
assert server.episodes == 1 and server.told[0][1:] == ({"agentview": (256, 256, 3), "wrist": (256, 256, 3)}, (8,))
asked = len(server.told)

# Their orchestrator, their server, our scenes.
benchmark = {
    "benchmark": "genmanip.vla_eval:GenManipBenchmark",
    "params": {"suite": scenarios},
    "episodes_per_task": 1,
    "max_steps": 20,
}
server = Down()
(result,) = api.evaluate(server, {"render": "cpu", "benchmarks": [benchmark]}, docker=False, no_save=True)
episodes = [episode for task in result["tasks"] for episode in task["episodes"]]
assert len(episodes) == 1 and episodes[0]["steps"] == 20 and episodes[0]["metrics"]["success"] in (False, 0.0), result
assert server.told[0][1]["wrist"] == (256, 256, 3) and server.told[0][2] == (8,)
print(f"interop: vla-eval's server led our arm for {asked} actions, and its orchestrator ran {len(episodes)} episode on our scenes")
