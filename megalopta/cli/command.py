"""Verbs of the command line: functions decorated with `verb`.

Their files are loaded even for `--help`: import slow modules where they run.
"""

import argparse
import math
import re
import signal
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import fields
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, NoReturn, TypeAlias, TypeVar

from megalopta.cli.settings import VerbSettings, Words
from megalopta.core.bounded import quoted
from megalopta.core.errors import UserError

Chosen = TypeVar("Chosen", bound=Any)
Run: TypeAlias = Callable[[argparse.Namespace], object]
"""Action of a verb; it returns, or yields, what is printed: text and the paths of what it wrote."""
Option: TypeAlias = tuple[str, Mapping[str, Any]]
"""Arguments of `argparse.ArgumentParser.add_argument`."""


class Verb(NamedTuple):
    """A verb: its line of help, action, options and settings."""

    purpose: str
    run: Run | None = None
    """None if the verb has verbs of its own"""
    options: tuple[Option, ...] = ()
    settings: VerbSettings | None = None
    often: tuple[str, ...] = ()
    """Settings that people change; the help lists these, `--help-all` all"""
    example: str = ""


VERBS: dict[str, Verb] = {}
"""Verbs by name, such as "dataset make"."""


class Command(argparse.ArgumentParser):
    """Parser of a verb; it reports an error as one sentence, without the usage."""

    verbs: "Mapping[str, Command]" = MappingProxyType({})
    """Verbs below this one."""

    def __init__(self, verb: Verb | None = None, **how: Any) -> None:
        verb, layout = verb or Verb(""), argparse.RawDescriptionHelpFormatter
        super().__init__(formatter_class=layout, allow_abbrev=False, add_help=False, **how)
        self.settings, self.often, self.example = verb.settings, verb.often, verb.example
        of_all = "list all settings" if verb.often else argparse.SUPPRESS
        self.add_argument("-h", "--help", action="help", help="show this help and exit")
        self.add_argument("--help-all", action=HelpAll, nargs=0, help=of_all)
        for option, arguments in verb.options:
            self.add_argument(option, **arguments)
        self.set_defaults(run=verb.run)
        if verb.run is None:
            self.branch = self.add_subparsers(dest=how["prog"], required=True, metavar="VERB")
            self.verbs = self.branch.choices

    @property
    def named(self) -> set[str]:
        """Option strings, such as "--out"."""
        return set(self._option_string_actions)

    @property
    def lists(self) -> set[str]:
        """Option strings of comma-separated values."""
        actions = self._option_string_actions.items()
        return {name for name, action in actions if "," in str(action.metavar)}

    def takes(self, path: str) -> Words:
        """Number of words that a setting takes. Raises UserError if there is none."""
        if self.settings is None:
            self.error(f"no setting --{path}")
        return self.settings.takes(path)

    def format_help(self) -> str:
        """Return the help, with an example and the settings after the options."""
        example = f"example:\n  {self.example}" if self.example else ""
        settings = self.settings.help(self.often) if self.settings else ""
        self.epilog = "\n\n".join(filter(None, (example, settings)))
        return super().format_help()

    def error(self, message: str) -> NoReturn:
        """Refuse the arguments."""
        verb = self.prog.removeprefix("megalopta").strip()
        raise UserError(f"{verb}: {message}; see {self.prog} --help".removeprefix(": "))


class HelpAll(argparse.Action):
    """Print the help with all settings, and exit."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        """Print it and exit."""
        assert isinstance(parser, Command)
        parser.often = ()
        parser.print_help()
        parser.exit()


def verb(
    name: str,
    purpose: str,
    *options: Option,
    settings: VerbSettings | None = None,
    often: tuple[str, ...] = (),
    example: str = "",
) -> Callable[[Run], Run]:
    """Declare a function as the action of a verb; its help lists settings changed `often`."""

    def declared(run: Run) -> Run:
        VERBS[name] = Verb(purpose, run, options, settings, often, example)
        return run

    return declared


def option(
    name: str,
    text: str,
    kind: "Callable[[str], object] | None" = None,
    default: Any = None,
    **how: Any,
) -> Option:
    """Return an option or argument with its help, which states the default.

    A word after its name stands for its value in the help, as in "--pairs N"; `kind` parses the
    value, and `how` goes to argparse.
    """
    name, _, metavar = name.partition(" ")
    shown = f"{default:g}" if isinstance(default, float) else default
    stated = "" if default is None or "default:" in text else f" (default: {shown})"
    arguments = {"type": kind, "default": default, "metavar": metavar or None, **how}
    chosen = {key: value for key, value in arguments.items() if value is not None}
    return name, {"help": f"{text}{stated}", **chosen}


def switch(name: str, text: str, **how: Any) -> Option:
    """Return an option without a value."""
    return option(name, text, action="store_true", **how)


def chosen(options: argparse.Namespace, kind: type[Chosen]) -> Chosen:
    """Return the dataclass whose fields are options that were given."""
    values = {field.name: getattr(options, field.name, None) for field in fields(kind)}
    record: Chosen = kind(**{name: value for name, value in values.items() if value is not None})
    return record


def out(default: str, what: str = "folder") -> Option:
    """Return the option for a verb's output path."""
    return option("--out", what, Path, Path(default))


def out_file(default: str, what: str) -> Option:
    """Return the option for the file that a verb writes."""

    def file(text: str) -> Path:
        if Path(text).is_dir():
            problem = f"{quoted(text)!r} is a folder; give the name of a file"
            raise argparse.ArgumentTypeError(problem)
        return Path(text)

    return option("--out", what, file, Path(default))


def at_least(least: int) -> Callable[[str], int]:
    """Return a parser of whole numbers of at most 18 digits, from `least` up."""

    def whole(text: str) -> int:
        if re.fullmatch(r"[+-]?[0-9]{1,18}", text) and int(text) >= least:
            return int(text)
        raise argparse.ArgumentTypeError(f"{quoted(text)!r}; give a whole number, {least} or more")

    return whole


def finite(
    text: str, above: float = -math.inf, least: float = -math.inf, most: float = math.inf
) -> float:
    """Parse a finite number, above one bound, or from `least` to `most`."""
    with suppress(ValueError):
        value = float(text)
        if above < value < math.inf and least <= value <= most:
            return value
    limits = f" above {above:g}" if above > -math.inf else ""
    limits += f" from {least:g} to {most:g}" if most < math.inf else ""
    raise argparse.ArgumentTypeError(f"{quoted(text)!r}; give a finite number{limits}")


positive = partial(finite, above=0)
"""Parser of finite numbers above 0"""


def within(least: float, most: float) -> Callable[[str], float]:
    """Return a parser of numbers between two others."""
    return partial(finite, least=least, most=most)


def numbers(text: str) -> tuple[float, ...]:
    """Parse one or more comma-separated numbers above 0, at most 1e9."""
    try:
        values = tuple(float(word) for word in text.split(","))
    except ValueError:
        values = ()
    if not values or not all(0 < number <= 1e9 for number in values):
        raise argparse.ArgumentTypeError(
            f"{quoted(text)!r}; give comma-separated numbers above 0, such as 1,3,10"
        )
    return values


DATASET = option("dataset", "dataset folder", Path)
FRAME_KINDS = (
    *("npy", "packed_npy", "spad512", "swissspad2", "swissspad2_whole", "swissspad2_counts"),
    *("spc3", "tiff", "png", "mat", "hdf5", "raw"),
)
"""Formats of frames, as `megalopta.sensor.formats.reading` knows them."""
SCHEDULER = option(
    "--scheduler ADDRESS",
    "Dask cluster, such as tcp://host:8786; its workers must see the same files",
)
CLUSTER = (
    option(
        "--workers N", "parallel processes on this machine (default: this one alone)", at_least(1)
    ),
    SCHEDULER,
)
"""Options for parallel processes, here or on a Dask cluster."""
THREADS = option("--workers N", "threads (default: one for each core)", at_least(1))


def stopped_by_signals() -> threading.Event:
    """Return an event that SIGINT or SIGTERM sets."""
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    return stop
