"""The stages as functions: what `genmanip task`, `layout`, `collect`, `evaluate` do."""

from __future__ import annotations

import json
import os
from typing import Any, Callable, Iterable, Protocol, Union

import numpy as np

from . import _genmanip

Path = Union[str, "os.PathLike[str]"]


class Policy(Protocol):
    """What a policy of one's own has; a class with these methods is given to evaluate()."""

    def spec(self) -> dict[str, Any]:
        """What it needs and what its actions mean; what is left out is as of joint targets at 15 Hz.

        Keys: cameras, action, rate_hz, execute_steps (0 for the whole chunk), privileged.
        """

    def reset(self, start: dict[str, Any]) -> None:
        """Before each episode: instruction and seed."""

    def act(self, observation: dict[str, Any]) -> Any:
        """The next actions, one per row; or (actions, True) when the task is done once these are carried out."""


class _Adapted:
    """A policy as the native module calls it."""

    def __init__(self, policy: Policy) -> None:
        self.policy = policy

    def spec(self) -> str:
        return json.dumps(self.policy.spec())

    def reset(self, start: dict[str, Any]) -> None:
        self.policy.reset(start)

    def act(self, observation: dict[str, Any]) -> tuple[list[list[float]], bool]:
        answer = self.policy.act(observation)
        actions, finished = answer if isinstance(answer, tuple) else (answer, False)
        return np.atleast_2d(np.asarray(actions, dtype=np.float32)).tolist(), bool(finished)


def evaluate(
    suite: Path,
    policy: str | Callable[[], Policy] | Iterable[str | Callable[[], Policy]],
    *,
    out: Path | None = None,
    episodes_per_scenario: int = 1,
    keep_episodes: bool | None = None,
    workers: int | None = None,
    horizon_s: float | None = None,
    stop_on_success: bool | None = None,
) -> list[dict[str, Any]]:
    """Evaluates policies on a frozen suite, a run or scenarios: one report each, as `genmanip evaluate` makes them.

    A policy is a text as on the command line, or a class of one's own, which is made once per episode; its name is that
    of the class, or its attribute `name`. With `out`, results are kept in that folder and an evaluation that was
    interrupted goes on there. `horizon_s` is the longest simulated time instead of the scenarios' own;
    `stop_on_success` ends an episode once its goal has held for a second, for policies that never say they are finished.
    """
    several = policy if isinstance(policy, (list, tuple)) else [policy]
    named = [one if isinstance(one, str) else (_name(one), _maker(one)) for one in several]
    given = (out, episodes_per_scenario, keep_episodes, workers, horizon_s, stop_on_success)
    return json.loads(_genmanip.evaluate(suite, named, *given))


def _name(policy: Any) -> str:
    return str(getattr(policy, "name", None) or getattr(policy, "__name__", type(policy).__name__))


def _maker(policy: Callable[[], Policy]) -> Callable[[], _Adapted]:
    return lambda: _Adapted(policy())


def tasks(*paths: Path) -> list[dict[str, Any]]:
    """The tasks of files and folders, checked."""
    return json.loads(_genmanip.tasks(list(paths)))


def design(out: Path, *, count: int, kinds: Iterable[str] = (), seed: int = 0) -> list[dict[str, Any]]:
    """Designs tasks by rules into a folder, by default the six kinds in turn; a row each."""
    return json.loads(_genmanip.design(out, list(kinds), count, seed))


def layout(
    tasks: Iterable[Path],
    out: Path,
    *,
    count: int = 1,
    seed: int = 0,
    world: Path | None = None,
    robot: str | None = None,
    workers: int | None = None,
) -> list[dict[str, Any]]:
    """Lays tasks out into scenario files; a row each, with the file or why there is none."""
    return json.loads(_genmanip.layout(list(tasks), out, count, seed, world, robot, workers))


def collect(
    tasks: Iterable[Path],
    out: Path,
    *,
    episodes: int = 2,
    seed: int = 0,
    dataset: bool = True,
    keep_failed: bool = False,
    corrections: str | None = None,
    world: Path | None = None,
    robot: str | None = None,
    workers: int | None = None,
) -> list[dict[str, Any]]:
    """Collects verified demonstrations, and their LeRobot dataset; a row per task. Continues what was interrupted.

    With corrections, that policy acts first in each attempt, and the expert takes over where it fails.
    """
    given = (episodes, seed, dataset, keep_failed, corrections, world, robot, workers)
    return json.loads(_genmanip.collect(list(tasks), out, *given))


class Dataset:
    """A LeRobot dataset that was made by collect() or `genmanip export`: its contract and its actions."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        contract, rows = _genmanip.dataset(folder)
        #: What the numbers of an action mean, and their rate.
        self.contract: dict[str, Any] = json.loads(contract)
        keys = ("index", "scenario_id", "success", "first_row", "end_row")
        #: Its episodes.
        self.episodes: list[dict[str, Any]] = [dict(zip(keys, row)) for row in rows]

    def actions(self, episode: int) -> np.ndarray:
        """The actions of an episode, one per row."""
        return _genmanip.dataset_actions(self.folder, episode)
