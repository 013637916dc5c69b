"""Values that differ from sequence to sequence, in the place of a value in YAML.

{uniform: [1, 5]}         a number from 1 to 5, any as likely as another
{log_uniform: [1, 100]}   a number whose logarithm is
{integer: [0, 9]}         a whole number from 0 to 9, both included
{one_of: [a, b, c]}       one of these, which may be mappings with ranges of their own
"""

import math
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

from megalopta.sensor import generator

Stream: TypeAlias = Callable[[str], float]
"""Number in [0, 1) of the value at a path, such as "scenes.0.scene.trees"."""

_KINDS = ("uniform", "log_uniform", "integer", "one_of")
_DIGITS = 5


def stream(seed: int, index: int) -> Stream:
    """Numbers of a sequence: each is a function of seed, index and path alone."""
    return lambda path: float(generator(seed, "plan", index, path).random())


def draw(value: Any, at: Stream, path: str = "") -> Any:
    """Put one value in the place of every range, also inside mappings and lists."""
    if kind := _kind(value):
        return _drawn(kind, value[kind], at, path)
    if isinstance(value, Mapping):
        return {key: draw(each, at, f"{path}.{key}") for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [draw(each, at, f"{path}.{index}") for index, each in enumerate(value)]
    return value


def choose(values: list[Any], at: Stream, path: str) -> tuple[int, Any]:
    """Number of one of some values, and the value itself, as it stands."""
    index = min(int(at(path) * len(values)), len(values) - 1)
    return index, values[index]


def check_ranges(value: Any, path: str) -> None:
    """Refuse, with ValueError, a range that is none."""
    if kind := _kind(value):
        _check(kind, value[kind], path)
        value = value[kind] if kind == "one_of" else None
    if isinstance(value, Mapping):
        for key, each in value.items():
            if key in _KINDS:
                raise ValueError(f"{path}: {key} stands alone; take the other keys out")
            check_ranges(each, f"{path}.{key}".strip("."))
    elif isinstance(value, list | tuple):
        for index, each in enumerate(value):
            check_ranges(each, f"{path}.{index}")


def _kind(value: Any) -> str | None:
    if isinstance(value, Mapping) and len(value) == 1:
        (name,) = value
        return name if name in _KINDS else None
    return None


def _drawn(kind: str, limits: Any, at: Stream, path: str) -> Any:
    if kind == "one_of":
        index, chosen = choose(list(limits), at, path)
        return draw(chosen, at, f"{path}.{index}")
    low, high = limits
    place = at(path)
    if kind == "integer":
        return min(low + int(place * (high - low + 1)), high)
    is_log = kind == "log_uniform"
    value = low * (high / low) ** place if is_log else low + place * (high - low)
    # so many digits as a person reads in a file's name
    return min(max(float(f"{value:.{_DIGITS}g}"), float(low)), float(high))


def _check(kind: str, limits: Any, path: str) -> None:
    if not isinstance(limits, list | tuple) or not limits:
        raise ValueError(f"{path}: {kind} {limits!r}: give a list")
    if kind == "one_of":
        return
    wanted = int if kind == "integer" else (int, float)
    if len(limits) != 2 or not all(
        isinstance(each, wanted) and not isinstance(each, bool) and math.isfinite(each)
        for each in limits
    ):
        numbers = "whole numbers" if kind == "integer" else "numbers"
        raise ValueError(f"{path}: {kind} {limits!r}: give two {numbers}, the lower first")
    if limits[0] > limits[1]:
        raise ValueError(f"{path}: {kind} {limits!r}: give the lower number first")
    if kind == "log_uniform" and limits[0] <= 0:
        raise ValueError(f"{path}: {kind} {limits!r}: give numbers above 0")
