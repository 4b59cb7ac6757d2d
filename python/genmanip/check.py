"""One episode of a policy, with every mistake named."""

from __future__ import annotations

import dataclasses
import json
import statistics
import time
from typing import Any, Callable

from . import _genmanip, _policy
from ._genmanip import Error
from .environment import Env
from .functions import Path, Policy


@dataclasses.dataclass
class PolicyCheck:
    """What check_policy() found."""

    #: Mistakes with their place and remedy; an evaluation does not run an episode with one.
    mistakes: list[str] = dataclasses.field(default_factory=list)
    #: Settings that are no mistake, but rarely meant.
    notes: list[str] = dataclasses.field(default_factory=list)
    #: Calls of act().
    turns: int = 0
    #: Actions that were carried out or held.
    actions: int = 0
    #: Actions that were held because the arm cannot reach their pose.
    unreachable: int = 0
    #: Simulated time, s.
    simulated_s: float = 0.0
    #: Median time of a call of act(), s.
    act_s: float = 0.0

    @property
    def ok(self) -> bool:
        """Whether there is no mistake."""
        return not self.mistakes

    def __str__(self) -> str:
        told = [f"mistake: {one}" for one in self.mistakes] + [f"note: {one}" for one in self.notes]
        numbers = f"{self.turns} calls of act(), {self.act_s * 1e3:.1f} ms each; {self.actions} actions"
        ran = f"{numbers}, {self.unreachable} out of reach; {self.simulated_s:.1f} s simulated"
        return "\n".join([*told, ran, "the policy can be evaluated" if self.ok else "the policy cannot be evaluated"])


def check_policy(
    policy: Callable[[], Policy], suite: Path | None = None, *, index: int = 0, seconds: float = 10.0
) -> PolicyCheck:
    """Runs one episode of a policy, at most so many simulated seconds, and names each mistake.

    suite: a suite, run or scenario file; by default the built-in task `place`. A class that passes is served by
    evaluate() and by `genmanip evaluate --policy python:MODULE:CLASS`.
    """
    found = PolicyCheck()
    try:
        _episode(policy, suite, index, seconds, found)
    except _policy.Mistake as mistake:
        found.mistakes.append(str(mistake))
    except Error as error:
        found.mistakes.append(str(error))
    return found


def _episode(policy: Any, suite: Path | None, index: int, seconds: float, found: PolicyCheck) -> None:
    one = _policy.made(policy)
    text = _policy.spec_of(one)
    wrong = _genmanip.spec_mistakes(text)
    if wrong is not None:
        found.mistakes += wrong.splitlines()
        return
    spec = json.loads(text)
    given = {key: spec[key] for key in ("action", "rate_hz", "cameras", "privileged") if key in spec}
    scenes = _genmanip.Scenes.suite(suite) if suite is not None else _genmanip.Scenes.tasks(["place"])
    env = Env(scenes, horizon_s=seconds, **given)
    seen, times = env.reset(index), []
    _policy.reset(one, {"instruction": env.instruction, "seed": 0})
    finished = over = False
    while not (finished or over):
        begun = time.perf_counter()
        rows, finished = _policy.actions_of(one, seen)
        times.append(time.perf_counter() - begun)
        found.turns, found.act_s = len(times), statistics.median(times)
        for row in rows[: spec.get("execute_steps") or len(rows)] if rows.size else ():
            step = env.step(row)
            found.actions += 1
            found.unreachable += step.refused is not None
            over = step.terminated or step.truncated
            if over:
                break
        seen = env.observe()
        found.simulated_s = seen["time_s"]
    if found.actions and found.unreachable == found.actions:
        found.notes.append("no action was within reach: see the frame, unit and rotation of the action contract")
    if not found.actions:
        found.notes.append("the policy finished without an action")
