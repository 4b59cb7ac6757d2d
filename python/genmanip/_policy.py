"""The methods of a policy's class, called and checked.

Used by the package, and by the program that runs a class in a process of its own, which has NumPy but no GenManip.
A mistake is raised as Mistake, whose text has the place and, on a line that starts with "hint:", the remedy.
"""

import json
import os
import traceback

import numpy as np

SIGNATURES = {"spec": "spec(self)", "reset": "reset(self, start)", "act": "act(self, observation)"}
ROWS = "return the next actions, one per row, or (actions, True) when the task is done once they are carried out"


class Mistake(Exception):
    """A mistake of a policy's program."""


def made(policy):
    """An instance of a policy's class."""
    name = getattr(policy, "__name__", type(policy).__name__)
    if not callable(policy):
        raise Mistake(f"{name} is not callable\nhint: give the class of the policy, not an instance of it")
    one = _called(f"{name}()", policy)
    for method, signature in SIGNATURES.items():
        if not callable(getattr(one, method, None)):
            raise Mistake(f"{name} has no method {method}\nhint: a policy has {', '.join(SIGNATURES.values())}")
    return one


def spec_of(policy):
    """The specification as JSON, NumPy's numbers and arrays included."""
    spec = _called("spec()", policy.spec)
    if not isinstance(spec, dict):
        raise Mistake(f'spec() returned {_kind(spec)}\nhint: expected a dictionary such as {{"rate_hz": 15}}')
    try:
        return json.dumps(spec, default=_plain)
    except (TypeError, ValueError) as error:
        raise Mistake(f"spec() returned something that is no JSON: {error}\nhint: use numbers, texts, lists") from error


def reset(policy, start):
    """Begins an episode."""
    _called("reset()", policy.reset, start)


def actions_of(policy, observation):
    """The next actions as float32 rows, and whether the task is done after them."""
    answer = _called("act()", policy.act, observation)
    actions, finished = answer, False
    if isinstance(answer, tuple):
        if len(answer) != 2 or not isinstance(answer[1], (bool, np.bool_)):
            raise Mistake(f"act() returned a tuple of {', '.join(map(_kind, answer)) or 'nothing'}\nhint: {ROWS}")
        actions, finished = answer
    if actions is None or isinstance(actions, (str, bytes, dict, set)):
        raise Mistake(f"act() returned {_kind(actions)}\nhint: {ROWS}")
    try:
        rows = np.asarray(actions)
    except Exception as error:
        hint = "a tensor on a GPU needs .cpu().numpy()" if hasattr(actions, "cpu") else "every row has the same length"
        raise Mistake(f"act() returned {_kind(actions)}, which is no array: {error}\nhint: {hint}") from error
    if rows.dtype.kind not in "fiu":
        hint = f"expected numbers; {ROWS}" if rows.dtype.kind != "O" else f"every row has the same length; {ROWS}"
        raise Mistake(f"act() returned an array of {rows.dtype}\nhint: {hint}")
    if rows.ndim == 1 and rows.size > 0:
        rows = rows[np.newaxis]
    if rows.size == 0:
        if not finished:
            raise Mistake(f"act() returned no action\nhint: {ROWS}")
        rows = rows.reshape(0, 1)
    if rows.ndim != 2:
        shape = " x ".join(map(str, rows.shape)) or "a single number"
        raise Mistake(f"act() returned an array of shape {shape}\nhint: expected (actions, numbers per action); {ROWS}")
    with np.errstate(over="ignore"):
        rows = np.ascontiguousarray(rows, dtype=np.float32)
    for row, column in np.argwhere(~np.isfinite(rows))[:1]:
        value = rows[row, column]
        raise Mistake(f"act() returned {value} as number {column} of action {row}\nhint: expected finite numbers")
    return rows, bool(finished)


def _called(name, method, *given):
    try:
        return method(*given)
    except (KeyboardInterrupt, GeneratorExit):
        raise
    except BaseException as error:
        raise Mistake(described(name, error, given)) from error


def described(name, error, given=()):
    """An exception with its place and a remedy."""
    place = _place(error)
    hint = "correct it there, then give the same command again"
    if isinstance(error, SystemExit):
        hint = "return (actions, True) to finish an episode; raise an exception if it cannot go on"
    elif isinstance(error, EOFError):
        hint = "a policy has no standard input: give settings as attributes of the class or in the environment"
    elif isinstance(error, KeyError) and given and isinstance(given[0], dict):
        hint = f"{name} gets {', '.join(given[0])}; images need cameras in the spec"
    elif isinstance(error, ModuleNotFoundError):
        hint = f"install {error.name} for this Python, or put its folder on PYTHONPATH"
    elif isinstance(error, TypeError) and "positional argument" in str(error):
        hint = f"a policy has {', '.join(SIGNATURES.values())}"
    return f"{name} raised {type(error).__name__}: {error}{place}\nhint: {hint}"


def _place(error):
    own = os.path.dirname(os.path.abspath(np.__file__))
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if frame.name not in ("_called", "answered")]
    outside = [frame for frame in frames if not frame.filename.startswith((own, "<string>"))]
    if not outside:
        return ""
    frame = outside[-1]
    return f", {frame.filename}:{frame.lineno}, in {frame.name}: {frame.line}"


def _kind(value):
    return "None" if value is None else f"{type(value).__name__}"


def _plain(value):
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    raise TypeError(f"{_kind(value)} {value!r}")
