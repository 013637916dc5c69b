"""Entry point of the command line, and its exit codes.

0: done. 2: a user's mistake, reported in one sentence. 130: interrupted. A traceback is a bug of
megalopta.
"""

import atexit
import gc
import os
import sys
from argparse import Namespace
from collections.abc import Sequence
from io import TextIOWrapper
from typing import NoReturn

from megalopta.cli.parser import RENAMED, program, split_overrides
from megalopta.core.bounded import sentence
from megalopta.core.errors import UserError, machine_problem, missing_extra
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
    _collect_seldom()
    _print_anything()
    try:
        _check_address_space()
        _check_letters(words)
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
        say("megalopta: interrupted; every file is complete, and the same command continues")
        sys.stdout.flush()
        os._exit(130)  # does not wait for threads that still compute


def _collect_seldom() -> None:
    """Collect garbage rarely, and not at exit: saves half a second of a large command."""
    gc.set_threshold(50_000, 20, 20)
    atexit.register(gc.freeze)


def _print_anything() -> None:
    """Escape characters that the terminal's locale cannot encode."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _check_address_space() -> None:
    """Refuse a limit (ulimit -v) under which OpenBLAS hangs while starting threads."""
    if resource is None:
        return
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    needed = _LEAST_BYTES + _BYTES_PER_CORE * (os.cpu_count() or 1)
    if limit != resource.RLIM_INFINITY and limit < needed:
        raise UserError(
            f"the address space is limited to {limit / 1e9:.2g} GB, this machine needs "
            f"{needed / 1e9:.2g} GB; raise it: ulimit -v {needed // 1024}"
        )


def _refuse(message: str) -> NoReturn:
    print(f"megalopta: {sentence(message)}", file=sys.stderr)
    sys.exit(2)


def _check_letters(arguments: Sequence[str]) -> None:
    """Refuse arguments that are not UTF-8: the image libraries cannot write to such names."""
    for argument in arguments:
        if any("\ud800" <= each <= "\udfff" for each in argument):
            raise UserError(f"{argument}: not UTF-8; rename the file or folder")


def _run(arguments: Sequence[str]) -> None:
    if arguments and arguments[0] in RENAMED:
        raise UserError(f"{arguments[0]}: renamed; use {RENAMED[arguments[0]]}")
    parser = program()
    command = parser
    for argument in arguments:
        command = command.below(argument)
    own, overrides = split_overrides(arguments, {*parser.options, *command.options}, command.takes)
    options = parser.parse_args(own, Namespace(overrides=overrides))
    with working(options.verb):
        options.run(options)
