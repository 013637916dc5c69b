"""Progress: how far, how fast, how long still.

A terminal shows it on its last line. Elsewhere it is a line every ten seconds, also while a single
step takes longer, so that a log tells that something is going on, and which step it is.
"""

import shutil
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Protocol

from megalopta.core.bounded import sentence

INTERVAL_S = 10.0
"""Longest silence without a terminal (s)."""
STATUS_S = 1.0
"""Time between two states on a terminal (s)."""

_speakers: list[object] = []
"""Work under way, the outermost first; only the innermost speaks."""
_silences: list[object] = []
"""Work that says nothing."""
_steps: list[str] = []
"""Steps under way, the outermost first; the innermost is told."""
_status_stands = threading.Event()
"""Set where a terminal's last line tells a state."""
_clocks: list[dict[str, "Spent"]] = []
"""Who counts the time of steps."""


@dataclass
class Spent:
    """Time that a step took, all its runs together."""

    seconds: float = 0.0
    cpu_seconds: float = 0.0


class Advance(Protocol):
    """Counts what is done."""

    def __call__(self, steps: int = 1) -> None:
        """Count `steps` more as done."""


@contextmanager
def _held(stack: list[Any], each: object) -> Iterator[None]:
    stack.append(each)
    try:
        yield
    finally:
        stack.remove(each)


def say(text: str) -> None:
    """Print one line on standard error."""
    if not _silences:
        _clear_status()
        print(sentence(text, sys.maxsize), file=sys.stderr, flush=True)


@contextmanager
def silent() -> Iterator[None]:
    """Say nothing of the work inside, and show no progress: it is a step of something larger."""
    with _held(_silences, object()):
        yield


@contextmanager
def step(name: str) -> Iterator[None]:
    """Name what is done inside, for lines of progress and for who counts the time of steps."""
    wall, cpu = time.monotonic(), time.process_time()
    try:
        with _held(_steps, name):
            yield
    finally:
        for clock in _clocks:
            spent = clock.setdefault(name, Spent())
            spent.seconds += time.monotonic() - wall
            spent.cpu_seconds += time.process_time() - cpu


@contextmanager
def times_of_steps() -> Iterator[dict[str, Spent]]:
    """Count the time of all steps inside, by their names."""
    clock: dict[str, Spent] = {}
    with _held(_clocks, clock):
        yield clock


@contextmanager
def progress(description: str, total: int, unit: str) -> Iterator[Advance]:
    """Show how many of `total` steps are done, which the yielded function counts; then the time."""
    if _silences:
        yield lambda steps=1: None
        return
    done, start = 0, time.monotonic()

    def count(steps: int = 1) -> None:
        nonlocal done
        done += steps

    with speaking(
        lambda: (
            f"{description}: {progress_line(done, total, unit, time.monotonic() - start)}{_step()}"
        ),
        is_of_steps=False,
    ):
        yield count
    elapsed = time.monotonic() - start
    print(f"{description}: {total} {unit}s in {elapsed:.1f} s", file=sys.stderr)


@contextmanager
def working(description: str) -> Iterator[None]:
    """Tell that something is going on, and which step it is, while nothing inside does."""
    start = time.monotonic()
    with speaking(
        lambda: f"{description}: at work for {duration(time.monotonic() - start)}{_step()}"
    ):
        yield


def progress_line(done: int, total: int, unit: str, elapsed_s: float) -> str:
    """How much is done, how fast, and how long the rest will take."""
    text = f"{done} of {total} {unit}s"
    if not done or not elapsed_s:
        return f"{text} in {duration(elapsed_s)}"
    left_s = elapsed_s * (total - done) / done
    return f"{text}, {_rate(done / elapsed_s, unit)}, {duration(left_s)} to go"


def _rate(per_s: float, unit: str) -> str:
    """Steps per second, or seconds per step where that reads better."""
    return f"{per_s:.1f} {unit}s/s" if per_s >= 1 else f"{1 / per_s:.1f} s/{unit}"


def duration(seconds: float) -> str:
    """A time for a person, such as "40 s", "9 min", "3 hours" or "12 days"."""
    for unit, length, least in (("days", 86400, 2), ("hours", 3600, 2), ("min", 60, 2)):
        if seconds >= least * length:
            return f"{seconds / length:.0f} {unit}"
    return f"{seconds:.0f} s"


def _step() -> str:
    """What is being done, to go on a line with."""
    return "".join(f"; {name}" for name in _steps[-1:])  # another thread may take the last away


def _clear_status() -> None:
    if _status_stands.is_set():
        _status_stands.clear()
        print("\r\x1b[K", end="", file=sys.stderr, flush=True)


@contextmanager
def speaking(state: Callable[[], str], is_of_steps: bool = True) -> Iterator[None]:
    """Tell a state at intervals, from a thread of its own, while this is the innermost work.

    A terminal shows it on its last line; what tells of steps, while one is under way. Elsewhere it
    is a line each time.
    """
    if _silences:
        yield
        return
    is_terminal, over = sys.stderr.isatty(), threading.Event()

    def speak() -> None:
        while not over.wait(STATUS_S if is_terminal else INTERVAL_S):
            if _speakers[-1] is not over or (is_terminal and is_of_steps and not _steps):
                continue
            if is_terminal:
                _status_stands.set()
                line = state()[: shutil.get_terminal_size().columns - 1]
                print(f"\r{line}\x1b[K", end="", file=sys.stderr, flush=True)
            else:
                print(state(), file=sys.stderr, flush=True)

    thread = threading.Thread(target=speak, daemon=True)
    with _held(_speakers, over):
        thread.start()
        try:
            yield
        finally:
            over.set()
            thread.join()
            _clear_status()
