"""Arguments, refused when they are given."""

from __future__ import annotations

import difflib
import math
import numbers
import os
from typing import Any, Iterable, Sequence

import numpy as np

from ._genmanip import Error


def refuse(what: str, hint: str) -> Error:
    return Error(f"{what}\nhint: {hint}")


def paths(name: str, given: Any) -> list[str]:
    """One path, or several."""
    if isinstance(given, (str, os.PathLike)):
        return [os.fspath(given)]
    try:
        return [os.fspath(path) for path in given]
    except TypeError as error:
        raise refuse(f"{name}={given!r} is not possible", "expected a path, or a list of paths") from error


def names(name: str, given: Any) -> list[str]:
    """A list of texts; a text alone is none, as it would be taken letter by letter."""
    if isinstance(given, str) or not all(isinstance(one, str) for one in given):
        raise refuse(f"{name}={given!r} is not possible", f'expected a list of texts, such as ["{given}"]')
    return list(given)


def choice(name: str, given: Any, known: Iterable[str]) -> str:
    known = list(known)
    if given not in known:
        near = difflib.get_close_matches(str(given), known, 1)
        hint = f"did you mean {near[0]!r}? " if near else ""
        raise refuse(f"unknown {name} {given!r}", f"{hint}expected {', '.join(known)}")
    return given


def options(given: dict[str, Any] | None, known: Sequence[str]) -> dict[str, Any]:
    """Options of a reset, none of them unknown."""
    for key in given or {}:
        choice("option of reset", key, known)
    return given or {}


def count(name: str, given: Any, least: int = 0, most: int | None = None) -> int:
    whole = isinstance(given, numbers.Integral) and not isinstance(given, bool)
    if not whole or given < least or (most is not None and given > most):
        bound = f"from {least} to {most}" if most is not None else f"from {least}"
        raise refuse(f"{name}={given!r} is not possible", f"expected a whole number {bound}")
    return int(given)


def count_or_none(name: str, given: Any) -> int | None:
    """A number above 0, or None for the default."""
    return None if given is None else count(name, given, 1)


def seconds(name: str, given: Any) -> float | None:
    if given is None:
        return None
    if not isinstance(given, numbers.Real) or not math.isfinite(given) or given <= 0:
        raise refuse(f"{name}={given!r} is not possible", "expected seconds above 0, or None for those of the suite")
    return float(given)


def rate(name: str, given: Any) -> float:
    if not isinstance(given, numbers.Real) or isinstance(given, bool) or not math.isfinite(given):
        raise refuse(f"{name}={given!r} is not possible", "expected actions per second, such as 10, 15, 20, 30 or 60")
    return float(given)


def flag(name: str, given: Any) -> bool:
    if not isinstance(given, (bool, np.bool_)):
        raise refuse(f"{name}={given!r} is not possible", "expected True or False")
    return bool(given)


def numbers_of_action(given: Any, dtype: Any, hint: str) -> np.ndarray:
    """The numbers of one action, or of several."""
    try:
        return np.asarray(given, dtype)
    except (TypeError, ValueError) as error:
        raise refuse(f"an action is {given!r}, which is no array of numbers", hint) from error


def action(given: Any) -> list[float]:
    """The numbers of one action."""
    numbers_given = numbers_of_action(given, np.float64, "expected a list of numbers")
    if numbers_given.ndim != 1:
        raise refuse(f"an action has {numbers_given.ndim} dimensions", "expected one row of numbers")
    return numbers_given.tolist()


def callback(name: str, given: Any) -> Any:
    if given is not None and not callable(given):
        raise refuse(f"{name}={given!r} is not possible", "expected a function of what is done, how many, and of how many")
    return given


def size(name: str, given: Any) -> list[int]:
    if not isinstance(given, (tuple, list)) or len(given) != 2:
        raise refuse(f"{name}={given!r} is not possible", "expected (width, height) in pixels")
    return [count(name, side, 1) for side in given]
