"""The whole command line: every file of this folder that declares a verb."""

from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

from megalopta import __version__
from megalopta.cli.command import Command


def program() -> tuple[Command, Mapping[str, Command]]:
    """The parser, and its verbs by name."""
    parser = Command(
        prog="megalopta",
        description="Scenes with exactly known motion, photon counts, and how well motion can be "
        "read from them.",
    )
    parser.add_argument("--version", action="version", version=f"megalopta {__version__}")
    verbs = parser.add_subparsers(dest="verb", required=True, metavar="VERB")
    for found in iter_modules([str(Path(__file__).parent)]):
        module = import_module(f"megalopta.cli.{found.name}")
        if hasattr(module, "declare"):
            module.declare(verbs)
    return parser, verbs.choices
