"""Observation and action spaces of Gymnasium, and observations in them."""

from __future__ import annotations

from typing import Any, Mapping, Sequence

import numpy as np
from gymnasium import spaces

from . import _arguments as arguments
from ._genmanip import Scenes
from .environment import ACTIONS

OBSERVATIONS = ("state", "flat", "rgb", "flat_rgb", "rgbd", "points")
#: Parts of every observation by their names in a policy's observation.
OWN = {"agent_pos": "state", "agent_target": "command", "tool": "tool", "tool_target": "tool_target"}
#: Relations in the order of the goal's encoding.
RELATIONS = ("front", "back", "left", "right", "near", "top", "on", "in", "between")
#: Joint states of the built-in objects in that order; one of an imported object may have another name.
STATES = (
    "open", "closed", "top_open", "bottom_open", "both_open", "on", "off", "pressed", "released", "low", "high"
)
#: Objects of a condition.
ROLES = ("subject", "reference", "second_reference")
#: Conditions of a goal that are encoded, the first ones of its first alternative.
CONDITIONS = 4
POSE = ("x", "y", "z", "qw", "qx", "qy", "qz")
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
        action: str | Mapping[str, Any],
        rate_hz: float,
        normalized: bool,
    ) -> None:
        self.kind = arguments.choice("observation", observation, OBSERVATIONS)
        self.cameras, self.size = tuple(arguments.names("cameras", cameras)), arguments.size("size", size)
        self.joints = [name for name, *_ in scenes.robot()]
        self.most_objects, self.most_joints = scenes.most_objects(), scenes.most_joints()
        bounds = _action_space(_space_name(action), scenes.robot(), rate_hz)
        self._middle, self._half = (bounds.high + bounds.low) / 2, (bounds.high - bounds.low) / 2
        self.normalized = normalized
        self.action = spaces.Box(-1.0, 1.0, bounds.shape, np.float32) if normalized else bounds
        self.parts = self._parts()
        self.observation: spaces.Space[Any] = spaces.Dict(self.parts)
        if self.kind == "flat":
            low, high = (np.concatenate([getattr(part, end) for part in self.parts.values()]) for end in ("low", "high"))
            self.observation = spaces.Box(low, high, dtype=np.float32)

    @property
    def privileged(self) -> bool:
        """Whether true poses of objects are seen."""
        return self.kind in ("state", "flat")

    def names(self, objects: Sequence[str]) -> list[str]:
        """Names of the numbers of `flat`, in order; also those of the parts of `state`, one after the other."""
        slots = [*objects, *(f"none_{number}" for number in range(len(objects), self.most_objects))]
        named = [f"{part}.{joint}" for part in ("agent_pos", "agent_target") for joint in self.joints]
        named += [f"{part}.{axis}" for part in ("tool", "tool_target") for axis in POSE]
        named += [f"{slot}.{axis}" for slot in slots for axis in POSE]
        named += [f"{slot}.joint_{number}" for slot in slots for number in range(self.most_joints)]
        named += [f"grasped.{slot}" for slot in slots]
        row = [*RELATIONS, *STATES, "state", *(f"{role}.{slot}" for role in ROLES for slot in slots)]
        return named + [f"goal_{number}.{entry}" for number in range(CONDITIONS) for entry in row]

    def goal(self, scenario: Mapping[str, Any]) -> np.ndarray:
        """The goal of a scenario as numbers: per condition the relation or state, and its objects by role."""
        ids = [item["id"] for item in scenario["objects"]]
        kinds = (*RELATIONS, *STATES)
        rows = np.zeros((CONDITIONS, self._condition_size), np.float32)
        alternatives = scenario["task"]["goal"]
        for row, atom in zip(rows, alternatives[0] if alternatives else []):
            kind, objects = atom.get("relation", atom.get("state")), {"subject": atom.get("object"), **atom}
            if kind in kinds:
                row[kinds.index(kind)] = 1.0
            row[len(kinds)] = "state" in atom
            for role, place in zip(ROLES, row[len(kinds) + 1 :].reshape(len(ROLES), -1)):
                if objects.get(role) in ids:
                    place[ids.index(objects[role])] = 1.0
        return rows.ravel()

    @property
    def _condition_size(self) -> int:
        return len(RELATIONS) + len(STATES) + 1 + len(ROLES) * self.most_objects

    def commanded(self, actions: np.ndarray, count: tuple[int, ...] = ()) -> list[Any]:
        """Actions of the space in metres, radians and seconds; of several environments, a row each."""
        actions, shape = arguments.numbers_of_action(actions, np.float32, "see action_space"), (*count, *self.action.shape)
        if actions.shape != shape:
            given = " x ".join(map(str, actions.shape)) or "a single number"
            hint = "an action is the motion, then the opening of the gripper; see action_space"
            raise arguments.refuse(f"expected an action of shape {' x '.join(map(str, shape))}, got {given}", hint)
        if self.normalized:
            actions = self._middle + self._half * actions
        return actions.tolist()

    def requests(self) -> list[dict[str, Any]]:
        """The cameras as a session asks for them."""
        channels = {"rgb": True, "depth": self.kind == "rgbd", "points": self.kind == "points"}
        if self.privileged:
            return []
        return [{"name": name, "size": list(self.size), "channels": channels} for name in self.cameras]

    def _parts(self) -> dict[str, spaces.Space[Any]]:
        def box(shape: tuple[int, ...], low: float = -FAR, high: float = FAR, dtype: Any = np.float32) -> spaces.Box:
            return spaces.Box(low, high, shape, dtype)

        width, height = self.size
        own, most = len(self.joints), self.most_objects
        parts: dict[str, spaces.Space[Any]] = {"agent_pos": box((own,)), "agent_target": box((own,))}
        parts |= {"tool": box((7,)), "tool_target": box((7,))}
        if self.privileged:
            parts["environment_state"] = box((7 * most,))
            if self.most_joints > 0:
                parts["object_joints"] = box((most * self.most_joints,))
            parts["grasped"] = box((most,), 0, 1)
            parts["goal"] = box((CONDITIONS * self._condition_size,), 0, 1)
            return parts
        colour = {name: box((height, width, 3), 0, 255, np.uint8) for name in self.cameras}
        if self.kind == "flat_rgb":
            return parts | colour
        parts["pixels"] = spaces.Dict(colour)
        if self.kind == "rgbd":
            parts["depth"] = spaces.Dict({name: box((height, width), 0) for name in self.cameras})
        if self.kind == "points":
            parts["points"] = spaces.Dict({name: box((height, width, 3)) for name in self.cameras})
        return parts

    def seen(self, observation: dict[str, Any], goal: np.ndarray) -> Any:
        """An observation of a session as an element of the space."""
        images = observation["images"]
        seen: dict[str, Any] = {ours: observation[name].astype(np.float32) for ours, name in OWN.items()}
        if self.privileged:
            seen["environment_state"] = _padded(np.clip(observation["objects"], -FAR, FAR), self.most_objects, 7)
            if self.most_joints > 0:
                seen["object_joints"] = _padded(observation["object_joints"], self.most_objects, self.most_joints)
            seen["grasped"] = np.zeros(self.most_objects, np.float32)
            if observation["grasped"] is not None:
                seen["grasped"][observation["grasped"]] = 1.0
            seen["goal"] = goal.copy()
            return np.concatenate(list(seen.values())) if self.kind == "flat" else seen
        colour = {name: images[name]["rgb"] for name in self.cameras}
        if self.kind == "flat_rgb":
            return seen | colour
        seen["pixels"] = colour
        if self.kind == "rgbd":
            # Where nothing was seen there is no distance: zero.
            seen["depth"] = {name: _finite(images[name]["depth_m"]) for name in self.cameras}
        if self.kind == "points":
            seen["points"] = {name: _finite(images[name]["points_m"]) for name in self.cameras}
        return seen


def _padded(rows: Sequence[Sequence[float]], count: int, width: int) -> np.ndarray:
    """Rows of at most that width, one after the other, zeros where nothing is."""
    table = np.zeros((count, width), np.float32)
    for place, row in zip(table, rows):
        place[: len(row)] = row
    return table.ravel()


def _finite(numbers: np.ndarray) -> np.ndarray:
    np.nan_to_num(numbers, copy=False, nan=0.0, posinf=0.0, neginf=0.0)
    return np.clip(numbers, -FAR, FAR, out=numbers)


def _space_name(action: str | Mapping[str, Any]) -> str:
    """The name in ACTIONS of an action or of the space of a contract."""
    if isinstance(action, str):
        return action
    return next((name for name, known in ACTIONS.items() if known["space"] == action.get("space")), "joint")


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
