"""Gymnasium's environments: gymnasium.make("GenManip-v0", suite=… or tasks=…) and gymnasium.make_vec(…)."""

from __future__ import annotations

import difflib
import inspect
import json
import numbers
import os
from typing import Any, Callable, Iterable, Sequence

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space, concatenate, create_empty_array

from . import _genmanip
from ._arguments import choice, count, count_or_none, flag, paths, refuse
from ._arguments import options as known_options
from ._genmanip import Error, Scenes
from ._spaces import Spaces
from .environment import settings
from .results import EnvironmentEvaluation

#: Built-in tasks that end before the cube is on the plate.
PARTS = ("reach", "lift")
BUILT_IN = (*PARTS, "place")


class _Setup:
    """What single and vector environments share: scenes, spaces, settings, and where the next episode starts."""

    def __init__(
        self,
        suite: str | os.PathLike[str] | None = None,
        tasks: str | os.PathLike[str] | Sequence[str | os.PathLike[str]] | None = None,
        index: int | None = None,
        observation: str = "state",
        cameras: Sequence[str] = ("static", "wrist"),
        size: tuple[int, int] = (256, 256),
        action: str = "joint",
        normalized: bool = True,
        rate_hz: float = 15.0,
        reward: str = "score",
        layouts: int = 1,
        horizon_s: float | None = None,
        stop_on_success: bool = True,
        discount: float = 1.0,
        scenes_kept: int = 16,
    ) -> None:
        if (suite is None) == (tasks is None):
            raise Error("expected suite=… or tasks=…, one of them\nhint: a suite is a frozen suite, a run or scenarios")
        choice("reward", reward, ("score", "sparse", "dense"))
        if not isinstance(discount, numbers.Real) or not 0 < discount <= 1:
            raise refuse(f"discount={discount!r} is not possible", "expected that of the learner, above 0 and at most 1")
        keep = count("scenes_kept", scenes_kept, 1)
        if suite is not None:
            self.scenes = Scenes.suite(suite, keep=keep)
        else:
            self.scenes = Scenes.tasks(_known(paths("tasks", tasks)), keep=keep)
        self.has_layouts, self.layouts = suite is None, count("layouts", layouts, 1)
        #: True if episodes end in success before the goal of their task is reached.
        self.is_part = tasks in (*PARTS, *([part] for part in PARTS))
        self.ids = self.scenes.ids()
        if index is not None:
            count("index", index, 0, len(self.ids) - 1)
        self.index, self.sparse, self.rate_hz = index, reward == "sparse", rate_hz
        shaping = discount if reward == "dense" else None
        times = (horizon_s, stop_on_success, shaping)
        self.settings = settings(action, rate_hz, [], False, *times)  # refuses an unknown action
        scale = flag("normalized", normalized)
        self.spaces = Spaces(self.scenes, observation, cameras, size, action, rate_hz, scale)
        seen = (self.spaces.requests(), self.spaces.privileged)
        self.settings = settings(action, rate_hz, *seen, *times)
        self.longest = None if horizon_s is None else int(round(horizon_s * rate_hz))

    def start(self, chance: np.random.Generator, seed: int | None, options: dict[str, Any] | None) -> tuple[int, int | None]:
        """Index and seed of the next episode."""
        options = known_options(options, ("index", "layout") if self.has_layouts else ("index",))
        index = options.get("index", self.index)
        if index is None:
            index = int(chance.integers(len(self.ids)))
        if self.has_layouts:
            seed = count("layout", options.get("layout", int(chance.integers(self.layouts))))
        return count("index", index, 0, len(self.ids) - 1), seed

    def started(self, about: tuple[str, str, str], scenario: str) -> tuple[np.ndarray, dict[str, Any]]:
        """The goal as numbers, and the info of a reset."""
        known = json.loads(scenario)
        name, kind, instruction = about
        goal = [[_words(atom) for atom in atoms] for atoms in known["task"]["goal"]]
        info = {"is_success": False, "score": 0.0, "task": name, "kind": kind, "instruction": instruction}
        return self.spaces.goal(known), info | {"objects": [item["id"] for item in known["objects"]], "goal": goal}

    def told(self, told: tuple[float, float, bool, bool, bool, str | None]) -> tuple[float, bool, bool, dict[str, Any]]:
        """Reward, terminated, truncated and info of a step."""
        reward, score, success, terminated, truncated, refused = told
        if self.sparse:
            reward = float(success and (terminated or truncated))
        info: dict[str, Any] = {"is_success": success, "score": score}
        if refused is not None:
            info["refused"] = refused
        return reward, terminated, truncated, info


def _setup(given: dict[str, Any]) -> _Setup:
    """Of arguments, none of them unknown."""
    for name in given:
        choice("argument", name, list(inspect.signature(_Setup).parameters))
    return _Setup(**given)


def _known(tasks: list[str]) -> list[str]:
    """Paths, after a look for misspelt names of built-in tasks."""
    for name in tasks:
        if not os.path.exists(name) and difflib.get_close_matches(name, BUILT_IN, 1):
            choice("task", name, BUILT_IN)
    return tasks


def _words(atom: dict[str, str]) -> str:
    """A condition of a goal, such as `046 on 008` or `057 open`."""
    return " ".join(part for key, part in atom.items() if key != "test")


class GenManipEnv(gymnasium.Env[dict[str, Any], np.ndarray]):
    """A scene of a suite, or a task that is laid out, as an environment of Gymnasium.

    suite or tasks: a suite, run or scenarios; or task files, of which "reach", "lift" and "place" are built in.
    observation: "state" (the robot and the true state of objects), "flat" (the same as one vector), "rgb", "flat_rgb"
    (images beside the state instead of below pixels), "rgbd" or "points" (in the world).
    action: "joint", "joint_delta", "joint_velocity", "ee" or "ee_delta", see genmanip.ACTIONS; at rate_hz.
    normalized: whether actions run from -1 to 1, between limits that the arm can reach; else they are in m, rad and s.
    reward: "score", the change of the goal's score, "sparse", 1 when the episode ends with the goal reached, or "dense",
    the score's change and that of a potential, with a discount: that of the learner ranks policies as the score does, 1
    also rewards early progress.
    scenes_kept: how many scenes are kept ready in memory, the ones used last.
    index: which scene; None draws one at each reset. layouts: of tasks, how many layouts are drawn from.
    An action that the arm cannot reach is not carried out: info["refused"] says why, and the last command is held.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 15}

    def __init__(self, render_mode: str | None = None, **given: Any) -> None:
        self.setup = _setup(given)
        self.render_mode = render_mode
        self.metadata = {**self.metadata, "render_fps": int(round(self.setup.rate_hz))}
        self.observation_space, self.action_space = self.setup.spaces.observation, self.setup.spaces.action
        self.native = _genmanip.Env(self.setup.scenes, self.setup.settings)
        self._max_episode_steps = self.setup.longest
        self.task = self.task_description = ""
        self._goal = np.zeros(0, np.float32)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        super().reset(seed=seed)
        self.native.reset(*self.setup.start(self.np_random, seed, options))
        self._goal, info = self.setup.started(self.native.about(), self.native.scenario())
        self.task, self.task_description = info["task"], info["instruction"]
        return self._seen(info), info

    def step(self, action: np.ndarray):
        reward, terminated, truncated, info = self.setup.told(self.native.step(self.setup.spaces.commanded(action)))
        return self._seen(info), reward, terminated, truncated, info

    def _seen(self, info: dict[str, Any]) -> Any:
        """The observation; info gets the commanded target."""
        seen = self.native.glance()
        info |= {"command": seen["command"], "tool_target": seen["tool_target"]}
        return self.setup.spaces.seen(seen, self._goal)

    def scenario(self) -> dict[str, Any] | None:
        """The scenario of the episode, as its file has it."""
        text = self.native.scenario()
        return None if text is None else json.loads(text)

    def state_names(self) -> list[str]:
        """Names of the numbers of `flat`, in order; the parts of `state` one after the other have the same."""
        scenario = self.scenario()
        return self.setup.spaces.names([item["id"] for item in scenario["objects"]] if scenario else [])

    def render(self) -> np.ndarray | None:
        if self.render_mode is None:
            return None
        return self.native.picture("static", None)["rgb"]

    def finish(self, policy: str = "gymnasium") -> str:
        """Ends the episode: its row as of the results of an evaluation, JSON."""
        return self.native.finish(policy)


def evaluate(
    env: gymnasium.Env[Any, Any],
    act: Callable[[Any], Any],
    starts: Iterable[int] = range(1000, 1200),
    *,
    name: str = "gymnasium",
) -> EnvironmentEvaluation:
    """Success of a policy in the environment that it was trained in, wrappers included: an episode per start.

    act: from an observation to an action, both as the wrapped environment has them. starts: layouts of `tasks`, which
    should lie above the `layouts` of training, or indices of the scenes of a `suite`. An episode succeeds by
    info["is_success"] of its last step; unless the task is "reach" or "lift", it is then left to settle and judged as
    `genmanip evaluate` does, which gives its row the verdict, the causes of failure and the success of the table.
    """
    native: GenManipEnv = env.unwrapped  # type: ignore[assignment]
    key = "layout" if native.setup.has_layouts else "index"
    rows: list[dict[str, Any]] = []
    for start in starts:
        seen, info = env.reset(options={key: start})
        over = False
        while not over:
            seen, _, terminated, truncated, info = env.step(act(seen))
            over = terminated or truncated
        row = {"id": native.task, "success": bool(info["is_success"]), "score": info["score"]}
        rows.append(row if native.setup.is_part else json.loads(native.finish(name)))
    if not rows:
        raise refuse("starts is empty", "expected layouts or indices, such as range(1000, 1200)")
    successes = sum(row["success"] for row in rows)
    low, high = _genmanip.success_interval(successes, len(rows))
    return EnvironmentEvaluation(name, successes / len(rows), low, high, len(rows), rows)


class GenManipVectorEnv(VectorEnv[dict[str, Any], np.ndarray, np.ndarray]):
    """Many of them at once, stepped by threads without Python's lock; the arguments are those of GenManipEnv.

    An environment whose episode ended is reset by the next step, which does not look at its action.
    """

    metadata = {"render_modes": [], "render_fps": 15, "autoreset_mode": AutoresetMode.NEXT_STEP}

    def __init__(self, num_envs: int = 1, threads: int | None = None, render_mode: str | None = None, **given: Any) -> None:
        if render_mode is not None:
            raise Error("many environments draw no picture\nhint: leave render_mode away, or ask for pixels")
        count("num_envs", num_envs, 1)
        self.setup = _setup(given)
        self.num_envs, self.render_mode = num_envs, None
        self.metadata = {**self.metadata, "render_fps": int(round(self.setup.rate_hz))}
        self.single_observation_space = self.setup.spaces.observation
        self.single_action_space = self.setup.spaces.action
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        threads = count_or_none("threads", threads) or os.cpu_count() or 1
        self.native = _genmanip.Pool(self.setup.scenes, self.setup.settings, num_envs, threads)
        self._max_episode_steps = self.setup.longest
        self._over = np.zeros(num_envs, bool)
        self._goals: list[np.ndarray] = [np.zeros(0, np.float32)] * num_envs
        self._chances = [np.random.default_rng() for _ in range(num_envs)]

    def reset(self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None):
        super().reset(seed=seed if isinstance(seed, int) else None)
        seeds = [seed + at for at in range(self.num_envs)] if isinstance(seed, int) else list(seed or [None] * self.num_envs)
        for at, own in enumerate(seeds):
            if own is not None or seed is None:
                self._chances[at] = np.random.default_rng(own)
        resets = [self.setup.start(chance, own, options) for chance, own in zip(self._chances, seeds)]
        return self._turn(np.zeros((self.num_envs, self.single_action_space.shape[0]), np.float32), resets)[::4]

    def step(self, actions: np.ndarray):
        resets = [self.setup.start(chance, None, None) if over else None for chance, over in zip(self._chances, self._over)]
        return self._turn(actions, resets)

    def _turn(self, actions: np.ndarray, resets: list[tuple[int, int | None] | None]):
        told, seen = self.native.step(self.setup.spaces.commanded(actions, (self.num_envs,)), resets)
        rewards = np.zeros(self.num_envs)
        ended = np.zeros((2, self.num_envs), bool)
        infos: dict[str, Any] = {}
        scenarios = self.native.scenarios() if any(reset is not None for reset in resets) else []
        for at, one in enumerate(told):
            if one is not None:
                rewards[at], ended[0, at], ended[1, at], info = self.setup.told(one)
            else:
                self._goals[at], info = self.setup.started(self.native.about()[at], scenarios[at])
            info |= {"command": seen[at]["command"], "tool_target": seen[at]["tool_target"]}
            infos = self._add_info(infos, info, at)
        self._over = ended[0] | ended[1]
        empty = create_empty_array(self.single_observation_space, self.num_envs)
        batch = concatenate(self.single_observation_space, [*map(self.setup.spaces.seen, seen, self._goals)], empty)
        return batch, rewards, ended[0], ended[1], infos

    @property
    def instructions(self) -> list[str]:
        """What each robot is told to do."""
        return [about[2] if about else "" for about in self.native.about()]

    @property
    def task_description(self) -> list[str]:
        return self.instructions

    def call(self, name: str, *given: Any, **named: Any) -> tuple[Any, ...]:
        """An attribute of all environments, or what the method of that name returns, once for each."""
        found = getattr(self, name)
        found = found(*given, **named) if callable(found) else found
        return tuple(found) if isinstance(found, list) else (found,) * self.num_envs

    def get_attr(self, name: str) -> tuple[Any, ...]:
        return self.call(name)
