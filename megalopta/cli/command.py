"""Verbs of the command line: what each takes and does, and how it tells a mistake.

A verb is a function below `verb` in any file of this folder. The parser loads these with every
command, `--help` and `--version` included: what is slow to import is imported where it runs.
"""

import argparse
import math
import re
import signal
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn, TypeAlias

from megalopta.core.bounded import quoted
from megalopta.core.errors import UserError

if TYPE_CHECKING:
    from megalopta.config.settings import Settings, Words

Run: TypeAlias = Callable[[argparse.Namespace], None]
Option: TypeAlias = tuple[str, Mapping[str, Any]]
"""What `argparse.ArgumentParser.add_argument` takes."""


class Verb(NamedTuple):
    """A verb: a line of help, what it does, its options, and what can be set beside them."""

    purpose: str
    run: Run | None = None
    """None of a verb that has verbs of its own"""
    options: tuple[Option, ...] = ()
    settings: "Callable[[], Settings] | None" = None


VERBS: dict[str, Verb] = {}
"""By name, such as "dataset make"."""


class Command(argparse.ArgumentParser):
    """Tells a mistake as one sentence, without the usage, which fills a screen."""

    settings: "Callable[[], Settings] | None" = None
    """What can be set beside its own options, loaded when it is asked for."""
    verbs: "Mapping[str, Command]" = MappingProxyType({})
    """Its own verbs, where it has any."""

    @property
    def options(self) -> tuple[str, ...]:
        """Its own, such as "--out"."""
        return tuple(self._option_string_actions)

    def takes(self, path: str) -> "Words":
        """How many words a setting takes. Raises UserError where nothing can be set."""
        if self.settings is None:
            self.error(f"no setting --{path}")
        return self.settings().takes(path)

    def format_help(self) -> str:
        """Settings follow the options."""
        if self.settings:
            self.epilog = self.settings().help()
        return super().format_help()

    def error(self, message: str) -> NoReturn:
        """Refuse what was typed."""
        verb = self.prog.removeprefix("megalopta").strip()
        raise UserError(f"{verb}: {message}; see {self.prog} --help".removeprefix(": "))


def verb(
    name: str,
    purpose: str,
    *options: Option,
    settings: "Callable[[], Settings] | None" = None,
) -> Callable[[Run], Run]:
    """Declare that a function does a verb."""

    def declared(run: Run) -> Run:
        VERBS[name] = Verb(purpose, run, options, settings)
        return run

    return declared


def option(name: str, text: str, **how: Any) -> Option:
    """Return an option or an argument with its help, described as argparse takes it."""
    return name, {"help": text, **how}


def switch(name: str, text: str) -> Option:
    """Return an option without a value, with its help."""
    return option(name, text, action="store_true")


def out(default: str, what: str = "folder") -> Option:
    """Return the option of what a verb writes to."""
    return option("--out", f"{what} (default: {default})", type=Path, default=Path(default))


def settings_of(module: str, model: str) -> "Callable[[], Settings]":
    """Return what loads the settings that a model of a module has by default."""

    def loaded() -> "Settings":
        from megalopta.config.settings import Settings

        return Settings(getattr(import_module(f"megalopta.{module}"), model))

    return loaded


def whole(text: str, least: int | None = None) -> int:
    """Type of an option that is a whole number of at most 18 digits, so much or more."""
    if re.fullmatch(r"[+-]?[0-9]{1,18}", text) and (least is None or int(text) >= least):
        return int(text)
    limit = " of at most 18 digits" if least is None else f", {least} or more"
    raise argparse.ArgumentTypeError(f"{quoted(text)!r}; give a whole number{limit}")


def at_least(least: int) -> Callable[[str], int]:
    """Type of an option that is a whole number, so much or more."""
    return partial(whole, least=least)


def finite(text: str, above: float = -math.inf) -> float:
    """Type of an option that is a finite number."""
    with suppress(ValueError):
        if above < (value := float(text)) < math.inf:
            return value
    what = "a finite number" if above == -math.inf else f"a finite number above {above:g}"
    raise argparse.ArgumentTypeError(f"{quoted(text)!r}; give {what}")


def positive(text: str) -> float:
    """Type of an option that is a finite number above 0."""
    return finite(text, 0)


def numbers(text: str) -> tuple[float, ...]:
    """Type of an option that is one number or several, above 0 and up to a billion."""
    try:
        found = tuple(float(word) for word in text.split(","))
    except ValueError:
        found = ()
    if not found or not all(0 < number <= 1e9 for number in found):
        raise argparse.ArgumentTypeError(
            f"{quoted(text)!r}; give numbers above 0 and commas, such as 1,3,10"
        )
    return found


DATASET = option("dataset", "dataset folder", type=Path)
FRAME_KINDS = ("npy", "spad512", "swissspad2", "swissspad2_whole", "spc3", "tiff")
"""Formats of frames, as `megalopta.sensor.formats.reading` knows them."""
_SCHEDULER = option(
    "--scheduler",
    "Dask cluster to work on, such as tcp://host:8786; its workers must see the same files",
    metavar="ADDRESS",
)
CLUSTER = (
    option(
        "--workers",
        "processes that work side by side on this machine (default: all in this one)",
        type=at_least(1),
        metavar="N",
    ),
    _SCHEDULER,
)
"""Processes that work, here or of a Dask cluster."""
THREADS = (
    option("--workers", "threads (default: one for each core)", type=at_least(1), metavar="N"),
    _SCHEDULER,
    option("--cache", "folder of rendered panoramas (default: the user's)", type=Path),
)
"""How many threads work, or which cluster, and where they find rendered panoramas."""


def stopped_by_signals() -> threading.Event:
    """Return an event that an interruption, or a request to end, sets."""
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    return stop
