"""Plug-ins of other packages, found by their entry points."""

from collections.abc import Callable, Iterable
from importlib.metadata import entry_points
from typing import Any, TypeVar

from megalopta.core.progress import say

Named = TypeVar("Named", bound=Any)


def plug_ins(group: str, made: Callable[[Any], Named], taken: Iterable[str]) -> dict[str, Named]:
    """Return the objects at the entry points of a group, such as "megalopta.detectors", by name.

    `made` converts an object, or refuses it with an error; names in `taken` are refused.
    """
    named: dict[str, Named] = {}
    for entry in sorted(
        entry_points(group=group), key=lambda plug_in: (plug_in.name, plug_in.value)
    ):
        try:
            loaded = entry.load()
            listed = loaded if isinstance(loaded, list | tuple) else [loaded]
            for plug_in in map(made, listed):
                if plug_in.name in {*taken, *named}:
                    raise ValueError(f"the name {plug_in.name!r} is taken; choose another")
                named[plug_in.name] = plug_in
        except Exception as problem:  # foreign code can raise any exception
            reason = " ".join(str(problem).split())
            say(f"megalopta: {group}: skipped plug-in {entry.name} ({entry.value}): {reason}")
    return named
