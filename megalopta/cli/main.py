"""Entry point of the command line; exit codes: 0 done, 2 a user's mistake, 130 interrupted."""

import atexit
import gc
import logging
import os
import re
import sys
from argparse import Namespace
from collections.abc import Callable, Collection, Iterator, Sequence
from difflib import get_close_matches
from io import TextIOWrapper
from typing import NoReturn

from megalopta import __version__
from megalopta.cli import benchmark, reports, spadcam, stages  # noqa: F401 - their verbs
from megalopta.cli.command import VERBS, Command
from megalopta.cli.settings import Words
from megalopta.core.bounded import quoted, sentence
from megalopta.core.errors import UserError, machine_problem, missing_extra, nearest
from megalopta.core.progress import say, working

try:
    import resource
except ImportError:  # Windows has no such limits
    resource = None  # type: ignore[assignment]

_LEAST_BYTES, _BYTES_PER_CORE = 10**9, 10**8
"""Address space that the libraries reserve, and per core for threads; measured: 0.76 GB on two
cores."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit."""
    words = sys.argv[1:] if arguments is None else arguments
    gc.set_threshold(50_000, 20, 20)  # saves half a second of a large command
    atexit.register(gc.freeze)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):  # the locale may not encode all characters
            stream.reconfigure(errors="backslashreplace")
    logging.getLogger().addHandler(logging.NullHandler())  # libraries log what we say in a sentence
    try:
        # OpenBLAS hangs while it starts threads under such a limit
        limit = resource.getrlimit(resource.RLIMIT_AS)[0] if resource else -1
        needed = _LEAST_BYTES + _BYTES_PER_CORE * (os.cpu_count() or 1)
        if 0 <= limit < needed:
            raise UserError(
                f"the address space is limited to {limit / 1e9:.2g} GB, this machine needs "
                f"{needed / 1e9:.2g} GB; raise it: ulimit -v {needed // 1024}"
            )
        _run(words)
    except UserError as error:
        _refuse(str(error))
    except ModuleNotFoundError as error:
        if (problem := missing_extra(error)) is None:
            raise
        _refuse(problem)
    except MemoryError as error:
        _refuse(f"out of memory ({error}); ask for less, or free some".replace(" ()", ""))
    except BrokenPipeError:
        os._exit(141)  # as if killed by SIGPIPE
    except OSError as error:
        if (problem := machine_problem(error)) is None:
            raise
        _refuse(problem)
    except KeyboardInterrupt:
        say("megalopta: interrupted; every file there is complete; run the same command again")
        sys.stdout.flush()
        os._exit(130)  # does not wait for threads that still compute


def _refuse(message: str) -> NoReturn:
    print(f"megalopta: {sentence(message)}", file=sys.stderr)
    sys.exit(2)


def _run(arguments: Sequence[str]) -> None:
    parser = program()
    command = parser
    for argument in arguments:
        if any("\ud800" <= letter <= "\udfff" for letter in argument):
            # the image libraries cannot write to such names
            raise UserError(f"{argument}: not UTF-8; rename the file or folder")
        verbs = command.verbs
        if not verbs or argument.startswith("-"):
            continue
        if argument not in verbs:
            deeper = [f"{name} {argument}" for name in verbs if argument in verbs[name].verbs]
            remedy = f"did you mean {deeper[0]!r}?" if deeper else nearest(argument, verbs)
            verb = f"{command.prog} {quoted(argument)}".removeprefix("megalopta ")
            raise UserError(f"{verb}: no such verb; {remedy}")
        command = verbs[argument]
    if command.verbs and not any(word.startswith("-") for word in arguments):
        arguments = [*arguments, "--help"]
    words, overrides = split_overrides(arguments, parser.named | command.named, command.takes)
    words = joined(words, command.lists)
    options = parser.parse_args(words, Namespace(overrides=overrides))
    with working(command.prog.removeprefix("megalopta ")):
        made = options.run(options)
        for line in made if isinstance(made, list | tuple | Iterator) else [made]:
            if line is not None:
                print(line)


def program() -> Command:
    """Return the parser with all verbs."""
    parser = Command(
        prog="megalopta",
        description="Scenes with exactly known motion, photon counts, and benchmarks of motion "
        "detectors.",
    )
    parser.add_argument("--version", action="version", version=f"megalopta {__version__}")
    commands = {"": parser}
    for name, verb in sorted(VERBS.items()):
        above, _, word = name.rpartition(" ")
        commands[name] = commands[above].branch.add_parser(
            word,
            help=verb.purpose,
            description=verb.purpose[0].upper() + verb.purpose[1:] + ".",
            verb=verb,
        )
    return parser


def joined(arguments: Sequence[str], lists: Collection[str]) -> list[str]:
    """Join by commas what follows an option of a list, up to an option or a path that exists."""
    kept, is_list = list[str](), False  # whether the last is of a list
    for word in arguments:
        is_path = os.path.exists(word) and not word.endswith(".onnx")  # noqa: PTH110 # of any length
        if is_list and not word.startswith("-") and not is_path:
            kept[-1] += f",{word}"
        else:
            is_list = kept[-1:] != [] and kept[-1] in lists
            kept.append(word)
    return kept


def split_overrides(
    arguments: Sequence[str], options: Collection[str], takes: Callable[[str], Words]
) -> tuple[list[str], dict[str, str]]:
    """Separate a verb's own options and words from settings: path to a value in YAML.

    A setting of one value takes one word, a list all words up to the next option, a switch only
    "true" or "false", so that `render --scene.trees 200 my.yaml` renders my.yaml. Words of a list
    may be joined by commas. Any "--path" that is no option starts a setting; `takes` returns how
    many words it takes. Raises UserError for a mistyped option, a setting without a value, or a
    duplicate setting.
    """
    kept: list[str] = []
    settings: dict[str, list[str]] = {}
    taker, words = "", "one"  # the setting that takes the next words, and how many
    for argument in arguments:
        name, equals, value = argument.partition("=")
        if value == "--":  # argparse would drop it silently
            raise UserError(f"{name}: '--' is not a value; give one")
        if argument.startswith("--") and name not in options:
            taker = name.removeprefix("--").replace("-", "_")
            if not taker:
                raise UserError("--: not a setting; give its path, such as --camera.width")
            # no setting is as similar to an option
            if near := get_close_matches(taker, [option[2:] for option in options], 1, cutoff=0.8):
                raise UserError(f"{name}: no such option; did you mean --{near[0]}?")
            words = takes(taker)
            if taker in settings:
                raise UserError(f"{name}: given twice; give all its values at once")
            settings[taker] = [value] if equals else ["true"] if words == "switch" else []
            taker = "" if equals and words != "all" else taker
            continue
        is_no_value = words == "switch" and argument not in ("true", "false")
        if name in options or not taker or is_no_value:
            kept.append(argument)
            taker = ""
        else:
            settings[taker] = [argument] if words == "switch" else [*settings[taker], argument]
            taker = taker if words == "all" else ""
    yaml = dict[str, str]()
    for path, values in settings.items():
        if not values:
            raise UserError(f"--{path}: missing value; give one")
        text = ", ".join(values)
        has_commas = re.fullmatch(r"[^\s\[{'\"]\S*,\S+", text) and takes(path) == "all"
        yaml[path] = f"[{text}]" if len(values) > 1 or has_commas else text
    return kept, yaml
