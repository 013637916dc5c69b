"""The command-line parser: every verb that a file of this folder declares, and settings.

Settings, such as `--scene.trees 200`, are separated from a verb's own options.
"""

import argparse
from collections.abc import Callable, Collection, Sequence
from difflib import get_close_matches
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import TYPE_CHECKING

from megalopta import __version__
from megalopta.cli.command import VERBS, Command, HelpAll
from megalopta.core.errors import UserError

if TYPE_CHECKING:
    from megalopta.config.settings import Words

RENAMED = {"sweep": "benchmark photons"}
"""Verbs of former versions, and their present names"""
_SIMILAR = 0.8
"""Least similarity of a mistyped option to an option; no setting reaches it."""


def program() -> Command:
    """Return the parser with all verbs."""
    for found in iter_modules([str(Path(__file__).parent)]):
        import_module(f"megalopta.cli.{found.name}")
    parser = Command(
        prog="megalopta",
        description="Scenes with exactly known motion, photon counts, and benchmarks of motion "
        "detectors.",
    )
    parser.add_argument("--version", action="version", version=f"megalopta {__version__}")
    branches = {"": _branch(parser, "verb")}
    for name, verb in sorted(VERBS.items()):
        above, _, own = name.rpartition(" ")
        command = branches[above].add_parser(
            own,
            help=verb.purpose,
            description=verb.purpose[0].upper() + verb.purpose[1:] + ".",
            formatter_class=argparse.RawDescriptionHelpFormatter,
            allow_abbrev=False,
        )
        if verb.run is None:
            branches[name] = _branch(command, "sub_verb")
        for option, how in verb.options:
            command.add_argument(option, **how)
        command.set_defaults(run=verb.run)
        command.settings, command.often = verb.settings, verb.often
        command.example = verb.example
        if verb.often:
            command.add_argument("--help-all", action=HelpAll, nargs=0, help="list all settings")
    return parser


def _branch(command: Command, name: str) -> "argparse._SubParsersAction[Command]":
    branch = command.add_subparsers(dest=name, required=True, metavar="VERB")
    command.verbs = branch.choices
    return branch


def split_overrides(
    arguments: Sequence[str], options: Collection[str], takes: "Callable[[str], Words]"
) -> tuple[list[str], dict[str, str]]:
    """Separate a verb's own options and words from settings: path to a value in YAML.

    A setting of one value takes one word, a list all words up to the next option, a switch only
    "true" or "false", so that `render --scene.trees 200 my.yaml` renders my.yaml. Any "--path" that
    is no option starts a setting; `takes` returns how many words it takes. Raises UserError for a
    mistyped option, a setting without a value, or a duplicate setting.
    """
    own: list[str] = []
    found: dict[str, list[str]] = {}
    taker, words = "", "one"  # the setting that takes the next words, and how many
    for argument in arguments:
        name, equals, value = argument.partition("=")
        if value == "--":  # argparse would drop it silently
            raise UserError(f"{name}: '--' is not a value; give one")
        if argument.startswith("--") and name not in options:
            taker = _path_of(name, options)
            words = takes(taker)
            if taker in found:
                raise UserError(f"{name}: given twice; give all its values at once")
            found[taker] = [value] if equals else ["true"] if words == "switch" else []
            taker = "" if equals and words != "all" else taker
            continue
        is_no_value = words == "switch" and argument not in ("true", "false")
        if name in options or not taker or is_no_value:
            own.append(argument)
            taker = ""
        else:
            found[taker] = [argument] if words == "switch" else [*found[taker], argument]
            taker = taker if words == "all" else ""
    return own, {path: _as_yaml(path, values) for path, values in found.items()}


def _path_of(name: str, options: Collection[str]) -> str:
    path = name.removeprefix("--").replace("-", "_")
    if not path:
        raise UserError("--: not a setting; give its path, such as --camera.width")
    if near := get_close_matches(path, [each[2:] for each in options], 1, _SIMILAR):
        raise UserError(f"{name}: no such option; did you mean --{near[0]}?")
    return path


def _as_yaml(path: str, values: Sequence[str]) -> str:
    """YAML of the values of a setting; several make a list."""
    if not values:
        raise UserError(f"--{path}: missing value; give one")
    return values[0] if len(values) == 1 else f"[{', '.join(values)}]"
