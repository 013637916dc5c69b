"""Commands within limits of time."""

import signal

import pytest

from megalopta.cli import main as cli

CPU_S, WALL_S = 10, 120
"""Longest a case may compute; and wait, which depends on what else the machine does."""


class _TooSlowError(BaseException):
    """Not to be caught by the program."""


def within_limits(do):
    """Return what a function gives; fails where it takes too long."""

    def stop(*_):
        raise _TooSlowError

    limits = (
        (signal.SIGPROF, signal.ITIMER_PROF, CPU_S),
        (signal.SIGALRM, signal.ITIMER_REAL, WALL_S),
    )
    for number, timer, seconds in limits:
        signal.signal(number, stop)
        signal.setitimer(timer, seconds)
    try:
        return do()
    finally:
        for _, timer, _ in limits:
            signal.setitimer(timer, 0)


@pytest.fixture
def limited():
    return within_limits


@pytest.fixture
def run():
    """Runs a command and returns its exit code; fails where it takes too long."""

    def run(words):
        try:
            within_limits(lambda: cli.main(words))
        except SystemExit as stopped:
            return stopped.code or 0
        return 0

    return run
