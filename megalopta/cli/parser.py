"""The whole command line: every file of this folder that declares a verb."""

from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

from megalopta import __version__
from megalopta.cli.command import Command

RENAMED = {"sweep": "benchmark photons"}
"""Verbs of former versions, and what they are now"""


def program() -> Command:
    """The parser, with all verbs."""
    parser = Command(
        prog="megalopta",
        description="Scenes with exactly known motion, photon counts, and how well motion can be "
        "read from them.",
    )
    parser.add_argument("--version", action="version", version=f"megalopta {__version__}")
    verbs = parser.add_subparsers(dest="verb", required=True, metavar="VERB")
    parser.verbs = verbs.choices
    for found in iter_modules([str(Path(__file__).parent)]):
        if "_" in found.name:  # of a verb that has verbs of its own, or no verb
            continue
        module = import_module(f"megalopta.cli.{found.name}")
        if hasattr(module, "declare"):
            module.declare(verbs)
    return parser
