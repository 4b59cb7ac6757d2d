"""The stages as functions: what `genmanip task`, `layout`, `collect`, `evaluate` do."""

from __future__ import annotations

import json
import os
from typing import Any, Callable, Iterable, Protocol, Union

import numpy as np

from . import _arguments as arguments
from . import _genmanip, _policy
from .results import (
    Collected,
    DesignedTask,
    Evaluation,
    Evaluations,
    Exported,
    LaidOut,
    Plan,
    Rendered,
    Row,
    Rows,
    Trained,
)

#: Called with what is done, how many of it are finished, and how many there are; from any thread.
Progress = Callable[[str, int, int], Any]
Path = Union[str, "os.PathLike[str]"]


class Policy(Protocol):
    """What a policy of one's own has; a class with these methods is given to evaluate()."""

    def spec(self) -> dict[str, Any]:
        """What it needs and what its actions mean; what is left out is as of joint targets at 15 Hz.

        Keys: rate_hz, action (a name of ACTIONS or a contract), cameras ({"name", "size", "channels"} each),
        execute_steps (0 for the whole chunk), privileged; docs/guides/evaluate.md has all.
        """

    def reset(self, start: dict[str, Any]) -> None:
        """Before each episode: instruction (a text) and seed (an integer)."""

    def act(self, observation: dict[str, Any]) -> Any:
        """The next actions, one per row; or (actions, True) when the task is done once these are carried out."""


class _Adapted:
    """A policy as the native module calls it."""

    def __init__(self, policy: Callable[[], Policy]) -> None:
        self.policy = _policy.made(policy)

    def spec(self) -> str:
        return _policy.spec_of(self.policy)

    def reset(self, start: dict[str, Any]) -> None:
        _policy.reset(self.policy, start)

    def act(self, observation: dict[str, Any]) -> tuple[list[list[float]], bool]:
        rows, finished = _policy.actions_of(self.policy, observation)
        return rows.tolist(), finished


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
    stop_on_unreachable: bool = False,
    keep_going: bool = False,
    progress: Progress | None = None,
) -> Evaluations:
    """Evaluates policies on a frozen suite, a run or scenarios: one report each, as `genmanip evaluate` makes them.

    A policy is a text as on the command line, or a class of one's own, which is made once per episode; its name is that
    of the class, or its attribute `name`. With `out`, results are kept in that folder and an evaluation that was
    interrupted goes on there. `horizon_s` is the longest simulated time instead of the scenarios' own;
    `stop_on_success` ends an episode once its goal has held for a second, for policies that never say they are finished.
    An episode in which the policy makes a mistake is not run, see check_policy(); Error if that holds for all, or for
    three in a row unless `keep_going`. With `stop_on_unreachable`, an action that the arm cannot reach ends its episode.
    """
    several = list(policy) if isinstance(policy, Iterable) and not isinstance(policy, (str, type)) else [policy]
    if not several:
        raise arguments.refuse("policy is empty", 'expected a policy, or a list of them, such as ["expert"]')
    named = [one if isinstance(one, str) else (_name(one), _maker(one)) for one in several]
    ending = (arguments.seconds("horizon_s", horizon_s), stop_on_success, stop_on_unreachable)
    repeats = arguments.count("episodes_per_scenario", episodes_per_scenario, 1)
    threads, told = _running(workers, progress)
    given = (out, repeats, keep_episodes, threads, *ending, keep_going, told)
    return Evaluations(map(Evaluation.of, json.loads(_genmanip.evaluate(suite, named, *given))))


def _name(policy: Any) -> str:
    return str(getattr(policy, "name", None) or getattr(policy, "__name__", type(policy).__name__))


def _maker(policy: Callable[[], Policy]) -> Callable[[], _Adapted]:
    return lambda: _Adapted(policy)


def tasks(*several: Path) -> list[dict[str, Any]]:
    """The tasks of files and folders, checked."""
    return json.loads(_genmanip.tasks([os.fspath(path) for path in several]))


def design(
    out: Path, *, count: int, kinds: Iterable[str] = (), seed: int = 0, progress: Progress | None = None
) -> Rows[DesignedTask]:
    """Designs tasks by rules into a folder, by default the six kinds in turn."""
    given = (arguments.names("kinds", kinds), arguments.count("count", count, 1), arguments.count("seed", seed))
    return _rows(DesignedTask, _genmanip.design(out, *given, arguments.callback("progress", progress)))


def layout(
    tasks: Path | Iterable[Path],
    out: Path,
    *,
    count: int = 1,
    seed: int = 0,
    world: Path | None = None,
    robot: str | None = None,
    workers: int | None = None,
    progress: Progress | None = None,
) -> Rows[LaidOut]:
    """Lays tasks out into scenario files; a row each, with the file or why there is none."""
    numbers = (arguments.count("count", count, 1), arguments.count("seed", seed))
    given = (*numbers, world, robot, *_running(workers, progress))
    return _rows(LaidOut, _genmanip.layout(arguments.paths("tasks", tasks), out, *given))


def collect(
    tasks: Path | Iterable[Path],
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
    progress: Progress | None = None,
) -> Rows[Collected]:
    """Collects verified demonstrations, and their LeRobot dataset; a row per task. Continues what was interrupted.

    With corrections, that policy acts first in each attempt, and the expert takes over where it fails.
    """
    numbers = (arguments.count("episodes", episodes, 1), arguments.count("seed", seed))
    given = (*numbers, dataset, keep_failed, corrections, world, robot, *_running(workers, progress))
    return _rows(Collected, _genmanip.collect(arguments.paths("tasks", tasks), out, *given))


def export(
    run: Path,
    *,
    format: str = "lerobot",
    action: str = "joint",
    rotation: str = "6d",
    rate: int = 15,
    cameras: Iterable[str] = ("static", "wrist"),
    depth: bool = True,
    keep_failed: bool = False,
    out: Path | None = None,
    workers: int | None = None,
    progress: Progress | None = None,
) -> Exported | None:
    """Writes a dataset of a run of collect(), by default into its exports/; None if it was stopped."""
    rows = (action, rotation, arguments.count("rate", rate, 1), arguments.names("cameras", cameras), depth)
    given = (format, *rows, keep_failed, out, *_running(workers, progress))
    exported = json.loads(_genmanip.export(run, *given))
    return None if exported is None else Exported.of(exported)


def train(
    run: Path,
    out: Path,
    *,
    preset: str,
    head: str = "l1",
    steps: int | None = None,
    budget_s: int | None = None,
    seed: int = 0,
    labels: bool = True,
    workers: int | None = None,
    progress: Progress | None = None,
) -> Trained | None:
    """Trains a policy on the verified demonstrations of a run of collect(); None if it was stopped.

    preset: "state" sees true object poses, "tiny" sees two cameras and reads the instruction; with labels it also
    learns to predict where the goal's objects are. "act" is ACT with the inputs of "tiny", without labels. head: "l1" predicts the median of the demonstrations' actions,
    "flow" samples from their distribution. Its length is that many optimiser steps, or that much wall-clock
    time. A stopped training continues from its checkpoint. evaluate() takes the policy as f"learned:{out}".
    """
    length = (arguments.count_or_none("steps", steps), arguments.count_or_none("budget_s", budget_s))
    given = (*length, arguments.count("seed", seed), labels, *_running(workers, progress))
    trained = json.loads(_genmanip.train(run, out, preset, head, *given))
    return None if trained is None else Trained.of(trained)


def render(
    source: Path,
    out: Path,
    *,
    cameras: Iterable[str] = (),
    size: tuple[int, int] | None = None,
    depth: bool = False,
    fps: int = 15,
    workers: int | None = None,
    progress: Progress | None = None,
) -> Rows[Rendered]:
    """Renders the episodes of a run, or a scenario file, into a folder; by default with all cameras."""
    pixels = None if size is None else arguments.size("size", size)
    images = (arguments.names("cameras", cameras), pixels, depth, arguments.count("fps", fps, 1))
    given = (*images, *_running(workers, progress))
    return _rows(Rendered, _genmanip.render(source, out, *given))


def plan(
    scenario: Path | None = None,
    *,
    object: str | None = None,
    position: Iterable[float] | None = None,
    yaw_rad: float = 0.0,
    joints: Iterable[float] | None = None,
    start: Iterable[float] | None = None,
    width_m: float = 0.08,
    robot: str | None = None,
    seed: int = 0,
) -> Plan:
    """Plans a motion of the arm in a scenario, or in an empty world: to a grasp of an object, to a position [m] with
    the tool pointing down, or to joint positions [rad]."""

    def numbers(given: Iterable[float] | None) -> list[float] | None:
        return None if given is None else [float(number) for number in given]

    point = numbers(position)
    if point is not None and len(point) != 3:
        raise arguments.refuse(f"position={point} is not possible", "expected x, y, z in metres")
    given = (object, point, yaw_rad, numbers(joints), numbers(start), width_m, robot, seed)
    return Plan.of(json.loads(_genmanip.plan(scenario, *given)))


def _running(workers: int | None, progress: Progress | None) -> tuple[int | None, Progress | None]:
    return arguments.count_or_none("workers", workers), arguments.callback("progress", progress)


def _rows(kind: type[Row], text: str) -> Rows[Row]:
    return Rows(kind.of(row) for row in json.loads(text))


class Dataset:
    """A LeRobot dataset that was made by collect() or `genmanip export`: its contract and its actions."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        contract, rows = _genmanip.dataset(folder)
        #: Meaning of the numbers of an action, and their rate.
        self.contract: dict[str, Any] = json.loads(contract)
        keys = ("index", "scenario_id", "success", "first_row", "end_row")
        #: Its episodes.
        self.episodes: list[dict[str, Any]] = [dict(zip(keys, row)) for row in rows]

    def actions(self, episode: int) -> np.ndarray:
        """The actions of an episode, one per row."""
        return _genmanip.dataset_actions(self.folder, episode)
