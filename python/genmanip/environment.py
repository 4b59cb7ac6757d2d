"""One environment: reset, step, observe, judge, save, restore, finish."""

from __future__ import annotations

import json
import os
from typing import Any, Mapping, NamedTuple, Sequence

import numpy as np

from . import _genmanip
from ._arguments import action as numbers_of
from ._arguments import choice, count, flag, rate, seconds
from ._genmanip import Saved, Scenes

_WIDTH = {"encoding": "width_m"}

#: The five action spaces by name: motion first, then the opening between the fingers in metres.
ACTIONS: dict[str, dict[str, Any]] = {
    # Joint targets, rad.
    "joint": {"space": "joint_position", "gripper": _WIDTH},
    # Changes of the joint targets over the action, rad.
    "joint_delta": {"space": "joint_delta", "gripper": _WIDTH},
    # Joint speeds during the action, rad/s.
    "joint_velocity": {"space": "joint_velocity", "gripper": _WIDTH},
    # Pose of the tool in the world: position, then axis times angle; m and rad.
    "ee": {"space": "ee_pose", "rotation": "axis_angle", "gripper": _WIDTH},
    # Change of that pose over the action, along and about the axes of the world; m and rad.
    "ee_delta": {"space": "ee_delta", "rotation": "axis_angle", "gripper": _WIDTH},
}


class Step(NamedTuple):
    """What an action led to."""

    #: Change of the goal's score since it was judged before; the goal is judged five times a second, and at the end.
    reward: float
    #: Share of the goal's conditions that hold, 0 to 1, when it was judged last.
    score: float
    #: True if all of them held then.
    success: bool
    #: The goal has held for a second, where the settings say to stop then. The episode is over, and was judged.
    terminated: bool
    #: The time is over, and so is the episode; it was judged.
    truncated: bool
    #: Why the action was not carried out, and the command in force held instead: the arm cannot reach that pose.
    refused: str | None


class Env:
    """An environment that the program drives, action by action.

    scenes: a suite, run or scenario file by its path, or Scenes.
    action: one of ACTIONS, or a contract of its own as in the specification of policies.
    rate_hz: actions per second; must divide the world's control rate, by default 60 Hz.
    cameras: a name, or {"name": …, "size": [width, height], "channels": {"rgb": True, "depth": True}}, each; channels
    are rgb, depth, points and normals.
    privileged: whether observations hold the true poses of objects; results then say oracle.
    horizon_s: longest simulated time, by default that of the suite.
    stop_on_success: whether an episode ends once the goal has held for a second, by default as the suite says.
    """

    def __init__(
        self,
        scenes: Scenes | str | os.PathLike[str],
        *,
        action: str | Mapping[str, Any] = "joint",
        rate_hz: float = 15.0,
        cameras: Sequence[Mapping[str, Any]] = (),
        privileged: bool = False,
        horizon_s: float | None = None,
        stop_on_success: bool | None = None,
    ) -> None:
        self.scenes = scenes if isinstance(scenes, Scenes) else Scenes.suite(scenes)
        given = settings(action, rate_hz, cameras, privileged, horizon_s, stop_on_success)
        self._native = _genmanip.Env(self.scenes, given)

    def reset(self, index: int = 0, seed: int | None = None) -> dict[str, Any]:
        """Begins the episode of a scenario or task; the seed names its stream of chance, or the layout of a task."""
        most = len(self.scenes) - 1
        self._native.reset(count("index", index, 0, most), None if seed is None else count("seed", seed))
        return self._native.observe()

    def step(self, action: Any) -> Step:
        """Carries out an action; raises Error for numbers that are none, and nothing has changed then."""
        return Step(*self._native.step(numbers_of(action)))

    def observe(self) -> dict[str, Any]:
        """What is seen now: time_s, state (arm joints, then opening), images, and the truth where it was asked for."""
        return self._native.observe()

    def picture(self, camera: str = "static", size: tuple[int, int] | None = None) -> np.ndarray:
        """A colour picture for people: rows, columns, red, green and blue."""
        return self._native.picture(camera, size)["rgb"]

    def verdict(self) -> dict[str, Any]:
        """The goal as it is now, condition by condition."""
        return json.loads(self._native.verdict())

    def scenario(self) -> dict[str, Any] | None:
        """The scenario of the episode, as its file has it."""
        text = self._native.scenario()
        return None if text is None else json.loads(text)

    @property
    def name(self) -> str | None:
        """Name of the episode."""
        about = self._native.about()
        return about and about[0]

    @property
    def instruction(self) -> str | None:
        """What the robot is told to do."""
        about = self._native.about()
        return about and about[2]

    def finish(self, policy: str = "python") -> dict[str, Any]:
        """Ends the episode: a row as of the results of an evaluation."""
        return json.loads(self._native.finish(policy))

    def save(self) -> Saved:
        """A moment to go back to."""
        return self._native.save()

    def restore(self, saved: Saved) -> None:
        """Goes back; the same actions then lead to the same bytes."""
        self._native.restore(saved)


def settings(action, rate_hz, cameras, privileged, horizon_s, stop_on_success, shaping_discount=None) -> str:
    """Settings of a session as the native module reads them."""
    if not isinstance(action, Mapping):
        action = ACTIONS[choice("action", action, ACTIONS)]
    spec = {"action": action, "rate_hz": rate("rate_hz", rate_hz), "cameras": cameras, "privileged": privileged}
    stops = None if stop_on_success is None else flag("stop_on_success", stop_on_success)
    given = {"horizon_s": seconds("horizon_s", horizon_s), "stop_on_success": stops}
    given["shaping_discount"] = shaping_discount
    return json.dumps({"spec": spec, **given}, default=_plain)


def _plain(value: Any) -> Any:
    """Mappings, sequences and NumPy's numbers as JSON has them."""
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    return list(value) if isinstance(value, Sequence) else repr(value)
