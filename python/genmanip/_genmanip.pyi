"""The native module; programs use the package around it."""

import os
from typing import Any, Callable, Optional, Sequence, Union

_Path = Union[str, os.PathLike[str]]
# Reward, score, success, terminated, truncated, and why the action was refused.
_Told = tuple[float, float, bool, bool, bool, Optional[str]]
# Name of the episode, kind of its task, instruction.
_About = tuple[str, str, str]

__version__: str

class Error(ValueError):
    """What could not be done, why, and what helps."""

class Scenes:
    """Where episodes start; environments share one."""

    @staticmethod
    def suite(path: _Path, keep: int = 16) -> Scenes:
        """Of a frozen suite, a run, or scenario files."""
    @staticmethod
    def tasks(paths: _Path | Sequence[_Path], world: _Path | None = None, keep: int = 16) -> Scenes:
        """Of task files, which are laid out anew for each seed; "reach", "lift" and "place" are built-in tasks."""
    def __len__(self) -> int: ...
    def ids(self) -> list[str]:
        """Ids by index."""
    def most_objects(self) -> int:
        """Most objects that any of them has."""
    def most_joints(self) -> int:
        """Most joints that any object has."""
    def robot(self) -> list[tuple[str, float, float, float]]:
        """Name, lower and upper limit (rad) and speed (rad/s) of the arm's joints, then of the fingers' opening (m)."""

class Saved:
    """A moment to go back to."""

class Env:
    def __new__(cls, scenes: Scenes, settings: str) -> Env: ...
    def reset(self, index: int = 0, seed: int | None = None) -> None: ...
    def step(self, action: Sequence[float]) -> _Told: ...
    def observe(self) -> dict[str, Any]: ...
    def glance(self) -> dict[str, Any]: ...
    def picture(self, camera: str, size: tuple[int, int] | None = None) -> dict[str, Any]: ...
    def verdict(self) -> str: ...
    def scenario(self) -> str | None: ...
    def about(self) -> _About | None: ...
    def control_steps(self) -> int: ...
    def finish(self, policy: str) -> str: ...
    def save(self) -> Saved: ...
    def restore(self, saved: Saved) -> None: ...

class Pool:
    def __new__(cls, scenes: Scenes, settings: str, count: int, threads: int) -> Pool: ...
    def step(
        self, actions: Sequence[Sequence[float]], resets: Sequence[tuple[int, int | None] | None]
    ) -> tuple[list[_Told | None], list[dict[str, Any]]]: ...
    def about(self) -> list[_About | None]: ...
    def scenarios(self) -> list[str | None]: ...

class Projection:
    """A camera at its place in the world; rows in, rows out."""

    def __new__(
        cls,
        k: Sequence[Sequence[float]],
        size: Sequence[int],
        world_from_camera: Sequence[Sequence[float]],
        distortion: Sequence[float] | None,
    ) -> Projection: ...
    def pixels(self, points: Sequence[Sequence[float]]) -> Any:
        """Rows u, v, depth of points of the world."""
    def points(self, pixels: Sequence[Sequence[float]]) -> Any:
        """Points of the world of rows u, v, depth."""
    def rays(self, pixels: Sequence[Sequence[float]]) -> Any: ...
    def to_camera(self, points: Sequence[Sequence[float]]) -> Any: ...
    def to_world(self, points: Sequence[Sequence[float]]) -> Any: ...
    def world_from_camera(self) -> Any: ...

def engine() -> str:
    """Version of the simulator that was loaded, as it says itself."""

def policies() -> list[tuple[str, str]]:
    """Names of the built-in policies, with what they are."""

_Progress = Optional[Callable[[str, int, int], Any]]

def evaluate(
    suite: _Path,
    policies: Sequence[Any],
    out: _Path | None,
    episodes_per_scenario: int,
    keep_episodes: bool | None,
    workers: int | None,
    horizon_s: float | None,
    stop_on_success: bool | None,
    stop_on_unreachable: bool,
    keep_going: bool,
    progress: _Progress,
) -> str: ...
def success_interval(successes: int, episodes: int) -> tuple[float, float]:
    """Ends of the 95 % interval (Wilson) of a success rate."""
def spec_mistakes(spec: str) -> str | None:
    """Mistakes of a policy's specification (JSON), one per line."""
def tasks(paths: Sequence[_Path]) -> str: ...
def design(out: _Path, kinds: Sequence[str], count: int, seed: int, progress: _Progress) -> str: ...
def layout(
    tasks: Sequence[_Path],
    out: _Path,
    count: int,
    seed: int,
    world: _Path | None,
    robot: str | None,
    workers: int | None,
    progress: _Progress,
) -> str: ...
def collect(
    tasks: Sequence[_Path],
    out: _Path,
    episodes: int,
    seed: int,
    dataset: bool,
    keep_failed: bool,
    corrections: str | None,
    world: _Path | None,
    robot: str | None,
    workers: int | None,
    progress: _Progress,
) -> str: ...
def export(
    run: _Path,
    format: str,
    action: str,
    rotation: str,
    rate: int,
    cameras: Sequence[str],
    depth: bool,
    keep_failed: bool,
    out: _Path | None,
    workers: int | None,
    progress: _Progress,
) -> str: ...
def train(
    run: _Path,
    out: _Path,
    preset: str,
    head: str,
    steps: int | None,
    budget_s: int | None,
    seed: int,
    labels: bool,
    workers: int | None,
    progress: _Progress,
) -> str: ...
def render(
    source: _Path,
    out: _Path,
    cameras: Sequence[str],
    size: Sequence[int] | None,
    depth: bool,
    fps: int,
    workers: int | None,
    progress: _Progress,
) -> str: ...
def plan(
    scenario: _Path | None,
    object: str | None,
    position: Sequence[float] | None,
    yaw_rad: float,
    joints: Sequence[float] | None,
    start: Sequence[float] | None,
    width_m: float,
    robot: str | None,
    seed: int,
) -> str: ...
def dataset(folder: _Path) -> tuple[str, list[tuple[int, str, bool, int, int]]]: ...
def dataset_actions(folder: _Path, episode: int) -> Any: ...
