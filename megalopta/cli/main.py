"""Parse, run, and how it ends.

Exit codes: 0 done, 2 the user's mistake told in one sentence, 130 interrupted. A traceback means
that the mistake is ours.
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
except ImportError:  # Windows, which has no such limits
    resource = None  # type: ignore[assignment]

_LEAST_BYTES, _BYTES_PER_CORE = 10**9, 10**8
"""Of address space that the libraries take before anything is computed, and for the threads of each
core; measured: 0.76 GB with two cores."""


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
        _refuse(f"the memory is too small ({error}); ask for less, or free some".replace(" ()", ""))
    except BrokenPipeError:
        os._exit(141)  # as if killed by the pipe that nobody reads any more
    except OSError as error:
        if (problem := machine_problem(error)) is None:
            raise
        _refuse(problem)
    except KeyboardInterrupt:
        say("megalopta: interrupted; every file is whole, and the same command goes on from there")
        sys.stdout.flush()
        os._exit(130)  # threads that still compute are not waited for


def _collect_seldom() -> None:
    """Look for garbage seldom, and not at the end: half a second of a command that loads much."""
    gc.set_threshold(50_000, 20, 20)
    atexit.register(gc.freeze)


def _print_anything() -> None:
    """Spell out characters that the terminal's locale or a file's name has no letters for."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _check_address_space() -> None:
    """Refuse a limit (ulimit -v) under which OpenBLAS waits for ever for threads to start."""
    if resource is None:
        return
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    needed = _LEAST_BYTES + _BYTES_PER_CORE * (os.cpu_count() or 1)
    if limit != resource.RLIM_INFINITY and limit < needed:
        raise UserError(
            f"the address space is limited to {limit / 1e9:.2g} GB, {needed / 1e9:.2g} GB are "
            f"needed on this machine; raise it: ulimit -v {needed // 1024}"
        )


def _refuse(message: str) -> NoReturn:
    print(f"megalopta: {sentence(message)}", file=sys.stderr)
    sys.exit(2)


def _check_letters(words: Sequence[str]) -> None:
    """Refuse what is no UTF-8: the libraries that write pictures cannot write to such a name."""
    for word in words:
        if any("\ud800" <= each <= "\udfff" for each in word):
            raise UserError(f"{word}: not in UTF-8; rename the file or folder, or give another")


def _run(words: Sequence[str]) -> None:
    if words and words[0] in RENAMED:
        raise UserError(f"{words[0]}: this verb is now {RENAMED[words[0]]}; give that")
    parser = program()
    command = parser
    for word in words:
        command = command.verbs.get(word, command)
    own, overrides = split_overrides(words, {*parser.options, *command.options}, command.takes)
    options = parser.parse_args(own, Namespace(overrides=overrides))
    with working(options.verb):
        options.run(options)
