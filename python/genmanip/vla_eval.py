"""GenManip as a benchmark of vla-eval (allenai/vla-evaluation-harness), whose model servers then drive our robot.

In a configuration of the harness:

    benchmarks:
      - benchmark: "genmanip.vla_eval:GenManipBenchmark"
        params: {suite: suites/my-suite}
"""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from vla_eval.benchmarks.base import StepBenchmark, StepResult
from vla_eval.specs import GRIPPER_CLOSE_POS, IMAGE_RGB, LANGUAGE, POSITION_DELTA, ROTATION_AA, STATE_JOINT, DimSpec

from .environment import Env

#: Actions as LIBERO's controller reads them: changes of the tool's pose and a hand that is open or shut.
_LIBERO = {
    "space": "ee_delta",
    "delta_from": "measured",
    "rotation": "axis_angle",
    "gripper": {"encoding": "plus_one_closed", "binary_threshold": 0.0},
}
#: Step of such an action at 1: 5 cm, 0.5 rad.
_SCALE = np.array([0.05] * 3 + [0.5] * 3, np.float32)


class GenManipBenchmark(StepBenchmark):
    """The scenes of a suite, a run or scenarios, at 20 actions per second as in LIBERO."""

    # Pictures are drawn by GenManip itself, which needs no GPU and takes none.
    render_backends = frozenset({"gpu", "cpu"})

    @classmethod
    def configure_render(cls, mode: str) -> dict[str, str]:
        return {}

    def __init__(
        self,
        suite: str,
        size: int = 256,
        send_wrist_image: bool = False,
        send_state: bool = False,
        horizon_s: float | None = None,
    ) -> None:
        super().__init__()
        self.send_wrist_image, self.send_state = send_wrist_image, send_state
        names = ["static", "wrist"] if send_wrist_image else ["static"]
        cameras = [{"name": name, "size": [size, size]} for name in names]
        self.suite = os.path.basename(os.path.normpath(suite))
        given = {"action": _LIBERO, "rate_hz": 20, "cameras": cameras, "horizon_s": horizon_s}
        self.env = Env(suite, stop_on_success=True, **given)

    def get_tasks(self) -> list[dict[str, Any]]:
        return [{"name": name, "suite": self.suite, "index": at} for at, name in enumerate(self.env.scenes.ids())]

    def reset(self, task: dict[str, Any]) -> Any:
        # Another episode of the same scene has the same start and another stream of chance.
        again = int(task.get("episode_idx", 0) or 0)
        return self.env.reset(task["index"], again or None)

    def step(self, action: dict[str, Any]) -> StepResult:
        given = np.asarray(action["actions"], np.float32).ravel()
        if given.size != 7:
            raise ValueError(f"expected 7 numbers (position, axis times angle, gripper), got {given.size}")
        motion = np.clip(given[:6], -1.0, 1.0) * _SCALE
        told = self.env.step(np.append(motion, given[6]))
        info = {"success": told.success, "score": told.score, "refused": told.refused}
        return StepResult(self.env.observe(), told.reward, told.terminated or told.truncated, info)

    def make_obs(self, raw_obs: Any, task: dict[str, Any]) -> dict[str, Any]:
        names = {"agentview": "static", "wrist": "wrist"} if self.send_wrist_image else {"agentview": "static"}
        images = {ours: raw_obs["images"][name]["rgb"] for ours, name in names.items()}
        seen = {"images": images, "task_description": self.env.instruction}
        if self.send_state:
            seen["states"] = raw_obs["state"].astype(np.float32)
        return seen

    def get_step_result(self, step_result: StepResult) -> dict[str, Any]:
        if not step_result.done:
            # The harness ran out of steps; the goal is judged as it is then, after the settling.
            return {"success": self.env.finish("vla-eval")["success"]}
        return {"success": bool(step_result.info["success"]), "score": step_result.info["score"]}

    def get_metadata(self) -> dict[str, Any]:
        return {"max_steps": 2400}

    def get_action_spec(self) -> dict[str, DimSpec]:
        return {"position": POSITION_DELTA, "rotation": ROTATION_AA, "gripper": GRIPPER_CLOSE_POS}

    def get_observation_spec(self) -> dict[str, DimSpec]:
        spec = {"image": IMAGE_RGB, "language": LANGUAGE}
        if self.send_wrist_image:
            spec["wrist"] = IMAGE_RGB
        if self.send_state:
            spec["state"] = STATE_JOINT
        return spec
