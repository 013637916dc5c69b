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
from typing import NoReturn

from megalopta.cli.overrides import split_overrides
from megalopta.cli.parser import program
from megalopta.errors import UserError, machine_problem
from megalopta.progress import say, working


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit."""
    words = sys.argv[1:] if arguments is None else arguments
    _collect_seldom()
    try:
        _run(words)
    except UserError as error:
        _refuse(str(error))
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


def _refuse(sentence: str) -> NoReturn:
    print(f"megalopta: {' '.join(sentence.split())}", file=sys.stderr)
    sys.exit(2)


def _run(words: Sequence[str]) -> None:
    parser = program()
    command = parser
    for word in words:
        command = command.verbs.get(word, command)
    own, overrides = split_overrides(words, {*parser.options, *command.options}, command.takes)
    options = parser.parse_args(own, Namespace(overrides=overrides))
    with working(options.verb):
        options.run(options)
