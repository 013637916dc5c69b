"""One verb of the command line: its own options, its settings, and how it tells a mistake.

A verb is a file of this folder with a function `declare`, which adds one to the verbs. The parser
loads it with every command, `--help` and `--version` included: what is slow to import is imported
where it runs.
"""

import argparse
import math
import re
import signal
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from types import MappingProxyType
from typing import TYPE_CHECKING, NoReturn, TypeAlias

from megalopta.core.bounded import quoted
from megalopta.core.errors import UserError

if TYPE_CHECKING:
    from megalopta.config.settings import Settings, Words

_MOST_DIGITS = 18
"""Of a number that fits into 64 bits"""

Verbs: TypeAlias = "argparse._SubParsersAction[Command]"
Run: TypeAlias = Callable[[argparse.Namespace], None]


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


def add_group(verbs: Verbs, name: str, purpose: str) -> None:
    """Add a verb that has verbs of its own, one in each file `NAME_*.py` of this folder."""
    command = verbs.add_parser(
        name, help=purpose, description=purpose[0].upper() + purpose[1:] + ".", allow_abbrev=False
    )
    own = command.add_subparsers(dest="sub_verb", required=True, metavar="VERB")
    command.verbs = own.choices
    for found in iter_modules([str(Path(__file__).parent)]):
        if found.name.startswith(f"{name}_"):
            import_module(f"megalopta.cli.{found.name}").declare(own)


def add_verb(verbs: Verbs, name: str, purpose: str, run: Run) -> Command:
    """Add a verb: its name, one line of help, and the function that does it."""
    command = verbs.add_parser(
        name,
        help=purpose,
        description=purpose[0].upper() + purpose[1:] + ".",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    command.set_defaults(run=run)
    return command


def add_dataset(command: Command) -> None:
    """Add the dataset that it reads."""
    command.add_argument("dataset", type=Path, help="dataset folder")


def add_out(command: Command, default: str, what: str = "folder") -> None:
    """Add the folder that it writes to."""
    text = f"{what} (default: {default})"
    command.add_argument("--out", type=Path, default=Path(default), help=text)


def add_workers(command: Command) -> None:
    """Add how many threads work, or which cluster, and where they find rendered panoramas."""
    command.add_argument(
        "--workers", type=at_least(1), metavar="N", help="threads (default: one for each core)"
    )
    _add_scheduler(command)
    command.add_argument(
        "--cache", type=Path, help="folder of rendered panoramas (default: the user's)"
    )


def add_cluster(command: Command) -> None:
    """Add processes that work, here or of a Dask cluster."""
    text = "processes that work side by side on this machine (default: all in this one)"
    command.add_argument("--workers", type=at_least(1), metavar="N", help=text)
    _add_scheduler(command)


def _add_scheduler(command: Command) -> None:
    text = "Dask cluster to work on, such as tcp://host:8786; its workers must see the same files"
    command.add_argument("--scheduler", metavar="ADDRESS", help=text)


def at_least(least: int) -> Callable[[str], int]:
    """Type of an option that is a whole number, so much or more."""

    def number(text: str) -> int:
        is_whole = text.isascii() and text.isdecimal() and len(text) <= _MOST_DIGITS
        if not is_whole or int(text) < least:
            raise argparse.ArgumentTypeError(f"{text!r}; give a whole number, {least} or more")
        return int(text)

    return number


def finite(text: str) -> float:
    """Type of an option that is a finite number."""
    with suppress(ValueError):
        if math.isfinite(value := float(text)):
            return value
    raise argparse.ArgumentTypeError(f"{quoted(text)!r}; give a finite number")


def whole(text: str) -> int:
    """Type of an option that is a whole number of at most 18 digits."""
    if re.fullmatch(r"[+-]?[0-9]{1,18}", text):
        return int(text)
    raise argparse.ArgumentTypeError(f"{quoted(text)!r}; give a whole number of at most 18 digits")


def positive(text: str) -> float:
    """Type of an option that is a finite number above 0."""
    if (number := finite(text)) > 0:
        return number
    raise argparse.ArgumentTypeError(f"{quoted(text)!r}; give a number above 0")


def stopped_by_signals() -> threading.Event:
    """Return an event that an interruption, or a request to end, sets."""
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    return stop
