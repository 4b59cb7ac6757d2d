"""Results of stages: dataclasses that print as tables and turn into pandas."""

from __future__ import annotations

import dataclasses
from typing import Any, Generic, Iterable, Mapping, TypeVar

Row = TypeVar("Row", bound="Record")


@dataclasses.dataclass
class Record:
    """A row; its fields are attributes, and also items by their names."""

    @classmethod
    def of(cls, given: Mapping[str, Any]):
        return cls(**{field.name: given.get(field.name) for field in dataclasses.fields(cls)})

    def __getitem__(self, name: str) -> Any:
        return getattr(self, name)


class Rows(list[Row], Generic[Row]):
    """Rows of one kind."""

    def __str__(self) -> str:
        return table([dataclasses.asdict(row) for row in self])

    def pandas(self) -> Any:
        """A pandas DataFrame, a column per field."""
        return frame(dataclasses.asdict(row) for row in self)


@dataclasses.dataclass
class DesignedTask(Record):
    """A task that was designed."""

    #: Id of the task.
    task: str
    kind: str
    #: The instruction, and the file, if there is a task.
    instruction: str | None
    file: str | None
    #: Why there is none.
    refused: str | None


@dataclasses.dataclass
class LaidOut(Record):
    """A layout of a task."""

    #: Id of the task.
    task: str
    #: File of the scenario, if there is one.
    scenario: str | None
    #: Why there is none.
    refused: str | None


@dataclasses.dataclass
class Collected(Record):
    """Demonstrations of a task."""

    task: str
    kind: str
    #: Finished attempts.
    attempts: int
    #: Those with a verified demonstration.
    verified: int
    #: Failure causes of the others.
    failures: list[str]
    #: Wall-clock time, s.
    seconds: float


@dataclasses.dataclass
class Exported(Record):
    """A dataset that was exported."""

    dataset: str
    depth_dataset: str | None
    episodes: int
    frames: int
    #: Damaged episodes that were left out, with the reason.
    left_out: list[tuple[str, str]]


@dataclasses.dataclass
class Trained(Record):
    """A policy that was trained."""

    #: Folder of the policy.
    policy: str
    preset: str
    #: True if the policy reads simulator truth; true if it was trained with labels of the simulator.
    privileged: bool
    labels: bool
    demonstrations: int
    #: Control steps of all demonstrations.
    rows: int
    #: Optimiser steps, and the samples that they took.
    steps: int
    samples: int
    #: Numbers that were trained.
    parameters: int
    #: Mean L1 error of normalised actions after the last step, on training samples.
    final_l1: float
    #: Steps that an earlier call had finished, if there was one.
    resumed_from: int | None
    #: Wall-clock time, s.
    seconds: float


@dataclasses.dataclass
class Rendered(Record):
    """Images of an episode or scenario."""

    id: str
    folder: str
    #: Images of each camera and channel.
    frames: int


@dataclasses.dataclass
class Plan(Record):
    """A motion of the arm, or why there is none."""

    scenario: str
    goal: str
    solved: bool
    failure: str | None
    path_length_rad: float
    duration_s: float
    #: Corners of the path, joint positions in rad.
    waypoints: list[list[float]] = dataclasses.field(repr=False)
    #: Time between two rows of the trajectory, s.
    dt_s: float
    #: Joint positions, rad.
    trajectory: list[list[float]] = dataclasses.field(repr=False)


@dataclasses.dataclass
class Evaluation(Record):
    """Results of a policy on a suite."""

    label: str
    suite: str
    #: Success at the end of an episode, with the ends of its 95 % interval.
    success: float
    low: float
    high: float
    #: Mean share of true conditions.
    score: float
    episodes: int
    #: Episodes whose policy could not be reached or made a mistake.
    not_run: list[dict[str, Any]]
    #: True if the policy read simulator truth.
    oracle: bool
    #: A dictionary per episode, as in the file of the evaluation.
    results: list[dict[str, Any]] = dataclasses.field(repr=False)
    #: The whole report, as its file has it.
    report: dict[str, Any] = dataclasses.field(repr=False)

    @classmethod
    def of(cls, given: Mapping[str, Any]) -> "Evaluation":
        summary = given["summary"]
        success = summary["success"]
        return cls(
            label=given["label"],
            suite=given["suite"],
            success=success["value"],
            low=success["low"],
            high=success["high"],
            score=summary["score"]["value"],
            episodes=success["trials"],
            not_run=given["not_run"],
            oracle=given["oracle"],
            results=given["results"],
            report=dict(given),
        )

    def __getitem__(self, name: str) -> Any:
        """A part of the report by its key."""
        return self.report[name]

    def __str__(self) -> str:
        rate = _rate(self.success, self.low, self.high)
        if any(left.get("mistake") for left in self.not_run):
            rate = "no rate, a mistake of the policy left episodes out"
        left = f", {len(self.not_run)} not run" if self.not_run else ""
        return f"{self.label}: {rate} of {self.episodes} episodes, score {self.score:.3f}{left}"

    def pandas(self) -> Any:
        """A pandas DataFrame, a row per episode."""
        return _episodes(self.results)


@dataclasses.dataclass
class EnvironmentEvaluation(Record):
    """Results of a policy in the environment of Gymnasium that it was trained in."""

    label: str
    #: Success at the end of an episode, with the ends of its 95 % interval (Wilson).
    success: float
    low: float
    high: float
    episodes: int
    #: A dictionary per episode; except for "reach" and "lift" as in the file of an evaluation.
    results: list[dict[str, Any]] = dataclasses.field(repr=False)

    def __str__(self) -> str:
        rate = _rate(self.success, self.low, self.high)
        return f"{self.label}: {rate} of {self.episodes} episodes"

    def pandas(self) -> Any:
        """A pandas DataFrame, a row per episode."""
        return _episodes(self.results)


class Evaluations(list[Evaluation]):
    """Results of several policies on the same suite."""

    def __str__(self) -> str:
        return "\n".join(map(str, self))

    def pandas(self) -> Any:
        """A pandas DataFrame, a row per policy."""
        keys = ("label", "success", "low", "high", "score", "episodes", "oracle")
        return frame({key: getattr(one, key) for key in keys} | {"not_run": len(one.not_run)} for one in self)


def _rate(value: float, low: float, high: float) -> str:
    """A rate with the ends of its interval, such as `50.0 % (20.0 to 80.0 %)`."""
    return f"{100 * value:.1f} % ({100 * low:.1f} to {100 * high:.1f} %)"


def _episodes(rows: Iterable[Mapping[str, Any]]) -> Any:
    """A pandas DataFrame of results, with the first cause of failure of each."""
    keys = ("id", "scenario_id", "success", "ending", "duration_s", "tcp_path_m", "max_stray_contact_n")

    def flat(row: Mapping[str, Any]) -> dict[str, Any]:
        failure = (row.get("failures") or [{}])[0]
        score = row["verdict"]["score"] if "verdict" in row else row["score"]
        return {key: row.get(key) for key in keys} | {key: failure.get(key) for key in ("cause", "evidence")} | {"score": score}

    return frame(map(flat, rows))


def frame(rows: Iterable[Mapping[str, Any]]) -> Any:
    try:
        import pandas
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError("pandas() needs pandas\nhint: pip install pandas") from error
    return pandas.DataFrame(list(rows))


def table(rows: list[dict[str, Any]]) -> str:
    """Rows as aligned text, under the names of their fields."""
    if not rows:
        return "(no rows)"
    lines = [list(rows[0]), *([_shown(value) for value in row.values()] for row in rows)]
    widths = [max(len(line[column]) for line in lines) for column in range(len(lines[0]))]
    return "\n".join("  ".join(cell.ljust(width) for cell, width in zip(line, widths)).rstrip() for line in lines)


def _shown(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.3g}"
    if isinstance(value, list):
        return ", ".join(map(str, value)) or "–"
    return "–" if value is None else str(value)
