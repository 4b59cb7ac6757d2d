"""Observation and action spaces of Gymnasium, and observations in them."""

from __future__ import annotations

from typing import Any, Sequence

import numpy as np
from gymnasium import spaces

from ._genmanip import Error, Scenes

OBSERVATIONS = ("state", "rgb", "rgbd", "points")
#: Nothing measured is farther from zero than this, m and rad; chosen.
FAR = 100.0
#: An arm reaches no farther than this, m; chosen.
REACH_M = 1.2
#: Largest change of the tool's position in one action, m; chosen, as of robosuite's controllers.
STEP_M = 0.05
#: The same of its rotation, rad.
STEP_RAD = 0.5


class Spaces:
    """What is seen and commanded, as spaces."""

    def __init__(
        self,
        scenes: Scenes,
        observation: str,
        cameras: Sequence[str],
        size: tuple[int, int],
        action: str,
        rate_hz: float,
        normalized: bool,
    ) -> None:
        if observation not in OBSERVATIONS:
            raise Error(f"unknown observation `{observation}`\nhint: observations are {', '.join(OBSERVATIONS)}")
        self.kind, self.cameras, self.size = observation, tuple(cameras), size
        robot = scenes.robot()
        self.most_objects = scenes.most_objects()
        bounds = _action_space(action, robot, rate_hz)
        self._middle, self._half = (bounds.high + bounds.low) / 2, (bounds.high - bounds.low) / 2
        self.normalized = normalized
        self.action = spaces.Box(-1.0, 1.0, bounds.shape, np.float32) if normalized else bounds
        self.observation = self._observation_space(len(robot))

    @property
    def privileged(self) -> bool:
        """Whether true poses of objects are seen."""
        return self.kind == "state"

    def commanded(self, actions: np.ndarray) -> list[Any]:
        """Actions of the space in metres, radians and seconds."""
        if self.normalized:
            actions = self._middle + self._half * np.asarray(actions, np.float32)
        return np.asarray(actions, np.float32).tolist()

    def requests(self) -> list[dict[str, Any]]:
        """The cameras as a session asks for them."""
        channels = {"rgb": True, "depth": self.kind == "rgbd", "points": self.kind == "points"}
        if self.kind == "state":
            return []
        return [{"name": name, "size": list(self.size), "channels": channels} for name in self.cameras]

    def _observation_space(self, own: int) -> spaces.Dict:
        def box(shape: tuple[int, ...], low: float = -FAR, high: float = FAR, dtype: Any = np.float32) -> spaces.Box:
            return spaces.Box(low, high, shape, dtype)

        width, height = self.size
        parts: dict[str, spaces.Space[Any]] = {"agent_pos": box((own,))}
        if self.kind == "state":
            parts["environment_state"] = box((7 * self.most_objects,))
            return spaces.Dict(parts)
        colour = {name: box((height, width, 3), 0, 255, np.uint8) for name in self.cameras}
        parts["pixels"] = spaces.Dict(colour)
        if self.kind == "rgbd":
            parts["depth"] = spaces.Dict({name: box((height, width), 0) for name in self.cameras})
        if self.kind == "points":
            parts["points"] = spaces.Dict({name: box((height, width, 3)) for name in self.cameras})
        return spaces.Dict(parts)

    def seen(self, observation: dict[str, Any]) -> dict[str, Any]:
        """An observation of a session as an element of the space."""
        images = observation["images"]
        seen: dict[str, Any] = {"agent_pos": observation["state"].astype(np.float32)}
        if self.kind == "state":
            state = np.zeros(7 * self.most_objects, np.float32)
            poses = observation["objects"].ravel()
            state[: poses.size] = np.clip(poses, -FAR, FAR)
            seen["environment_state"] = state
            return seen
        seen["pixels"] = {name: images[name]["rgb"] for name in self.cameras}
        if self.kind == "rgbd":
            # Where nothing was seen there is no distance: zero.
            seen["depth"] = {name: _finite(images[name]["depth_m"]) for name in self.cameras}
        if self.kind == "points":
            seen["points"] = {name: _finite(images[name]["points_m"]) for name in self.cameras}
        return seen


def _finite(numbers: np.ndarray) -> np.ndarray:
    np.nan_to_num(numbers, copy=False, nan=0.0, posinf=0.0, neginf=0.0)
    return np.clip(numbers, -FAR, FAR, out=numbers)


def _action_space(action: str, robot: list[tuple[str, float, float, float]], rate_hz: float) -> spaces.Box:
    *arm, (_, shut, widest, _) = robot
    if action == "joint":
        low, high = [joint[1] for joint in arm], [joint[2] for joint in arm]
    elif action in ("joint_delta", "joint_velocity"):
        share = 1.0 / rate_hz if action == "joint_delta" else 1.0
        high = [joint[3] * share for joint in arm]
        low = [-most for most in high]
    else:
        high = [REACH_M] * 3 + [np.pi] * 3 if action == "ee" else [STEP_M] * 3 + [STEP_RAD] * 3
        low = [-most for most in high]
    return spaces.Box(np.array([*low, shut], np.float32), np.array([*high, widest], np.float32), dtype=np.float32)
