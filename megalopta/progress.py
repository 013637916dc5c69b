"""Progress: how far, how fast, how long still.

A bar on the terminal. Without one a line every ten seconds, also while a single step takes longer,
so that a log tells that something is going on.
"""

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Protocol

from megalopta.bounded import sentence

INTERVAL_S = 10.0
"""Longest silence without a terminal (s)."""

_speakers: list[object] = []
"""Work under way, the outermost first; only the innermost speaks."""
_silences: list[object] = []
"""Work that says nothing."""


class Advance(Protocol):
    """Moves a bar on."""

    def __call__(self, steps: int = 1) -> None:
        """Count `steps` more as done."""


def say(text: str) -> None:
    """Print one line on standard error."""
    if not _silences:
        print(sentence(text, sys.maxsize), file=sys.stderr, flush=True)


@contextmanager
def silent() -> Iterator[None]:
    """Say nothing of the work inside, and show no progress: it is a step of something larger."""
    silence = object()
    _silences.append(silence)
    try:
        yield
    finally:
        _silences.remove(silence)


@contextmanager
def progress(description: str, total: int, unit: str) -> Iterator[Advance]:
    """Show a bar for `total` steps, which the yielded function counts.

    Without a terminal a line is printed every ten seconds, and one at the end.
    """
    if _silences:
        yield lambda steps=1: None
        return
    if sys.stderr.isatty():
        from megalopta.progress_bar import bar  # what it is drawn with is slow to import

        with bar(description, total, unit, rate_text) as advance:
            yield lambda steps=1: advance(steps)
        return
    done, start = 0, time.monotonic()

    def count(steps: int = 1) -> None:
        nonlocal done
        done += steps

    with speaking(
        lambda: f"{description}: {progress_line(done, total, unit, time.monotonic() - start)}"
    ):
        yield count
    elapsed = time.monotonic() - start
    print(f"{description}: {total} {unit}s in {elapsed:.1f} s", file=sys.stderr)


@contextmanager
def working(description: str) -> Iterator[None]:
    """Without a terminal, print a line every ten seconds while nothing inside does."""
    start = time.monotonic()
    with speaking(lambda: f"{description}: at work for {duration(time.monotonic() - start)}"):
        yield


def progress_line(done: int, total: int, unit: str, elapsed_s: float) -> str:
    """How much is done, how fast, and how long the rest will take."""
    text = f"{done} of {total} {unit}s"
    if not done or not elapsed_s:
        return f"{text} in {duration(elapsed_s)}"
    left_s = elapsed_s * (total - done) / done
    return f"{text}, {rate_text(done / elapsed_s, unit)}, {duration(left_s)} to go"


def rate_text(per_s: float, unit: str) -> str:
    """Steps per second, or seconds per step where that reads better."""
    return f"{per_s:.1f} {unit}s/s" if per_s >= 1 else f"{1 / per_s:.1f} s/{unit}"


def duration(seconds: float) -> str:
    """A time for a person, such as "40 s", "9 min", "3 hours" or "12 days"."""
    for unit, length, least in (("days", 86400, 2), ("hours", 3600, 2), ("min", 60, 2)):
        if seconds >= least * length:
            return f"{seconds / length:.0f} {unit}"
    return f"{seconds:.0f} s"


@contextmanager
def speaking(state: Callable[[], str]) -> Iterator[None]:
    """Print a state at intervals from a thread of its own, unless there is a terminal."""
    if sys.stderr.isatty() or _silences:
        yield
        return
    over = threading.Event()

    def speak() -> None:
        while not over.wait(INTERVAL_S):
            if _speakers[-1] is over:
                print(state(), file=sys.stderr, flush=True)

    _speakers.append(over)
    thread = threading.Thread(target=speak, daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
        _speakers.remove(over)
