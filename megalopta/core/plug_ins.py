"""What other packages add, found by their entry points.

A package adds a detector by two lines in its pyproject.toml; the object may also be a list of them:

    [project.entry-points."megalopta.detectors"]
    mine = "my_package.my_module:MyDetector"

Whatever is wrong with one is told in a sentence, and the rest goes on without it.
"""

from collections.abc import Callable, Iterable
from importlib.metadata import entry_points
from typing import Any, Protocol, TypeVar

from megalopta.core.progress import say


class _Named(Protocol):
    @property
    def name(self) -> str: ...


AnyNamed = TypeVar("AnyNamed", bound=_Named)


def plug_ins(
    group: str, made: Callable[[Any], AnyNamed], taken: Iterable[str]
) -> dict[str, AnyNamed]:
    """Return what the entry points of a group, such as "megalopta.detectors", hold, by name.

    `made` makes of what an entry point holds what is wanted, and refuses what it cannot use; no
    plug-in may have one of the names that are `taken`.
    """
    found: dict[str, AnyNamed] = {}
    for entry in sorted(entry_points(group=group), key=lambda each: (each.name, each.value)):
        try:
            loaded = entry.load()
            listed = loaded if isinstance(loaded, list | tuple) else [loaded]
            for each in map(made, listed):
                if each.name in {*taken, *found}:
                    raise ValueError(f"the name {each.name!r} is taken, choose another")
                found[each.name] = each
        except Exception as problem:  # somebody else's code can raise anything
            told = " ".join(str(problem).split())
            say(f"megalopta: {group}: plug-in {entry.name} ({entry.value}) is left out: {told}")
    return found
