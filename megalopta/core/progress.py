"""Progress of long work: share done, time left, current step.

A terminal shows it on its last line. Elsewhere it is a line every ten seconds, also while a single
step takes longer, so that a log shows that work continues, and which step.
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
"""Interval of lines without a terminal (s)."""
STATUS_S = 1.0
"""Interval of updates on a terminal (s)."""

_speakers: list[object] = []
"""Work in progress, the outermost first; only the innermost prints."""
_silences: list[object] = []
"""Work that prints nothing."""
_steps: list[str] = []
"""Steps in progress, the outermost first; the innermost is shown."""
_shares: list[Callable[[], str]] = []
"""Progress of silent work, the outermost first; whoever speaks for it shows the innermost."""
_stages: list[str] = []
"""Stage in progress, as the beginning of a line, of work with several."""
_status_stands = threading.Event()
"""Set while a terminal's last line shows progress."""
_clocks: list[dict[str, "Spent"]] = []
"""Clocks that count the time of steps."""


@dataclass
class Spent:
    """Total time of all runs of a step."""

    seconds: float = 0.0
    cpu_seconds: float = 0.0


class Advance(Protocol):
    """Counts finished steps."""

    def __call__(self, steps: int = 1) -> None:
        """Count `steps` more as finished."""


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
    """Print no lines and no progress of the work inside, which is a step of something larger."""
    with _held(_silences, object()):
        yield


@contextmanager
def step(name: str) -> Iterator[None]:
    """Name the work inside, for lines of progress and clocks of steps."""
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
def numbered_stage(number: int, total: int) -> Iterator[None]:
    """Begin lines of progress of the work inside with its number, if there are several stages."""
    with _held(_stages, f"stage {number} of {total} · " if total > 1 else ""):
        yield


@contextmanager
def times_of_steps() -> Iterator[dict[str, Spent]]:
    """Count the time of all steps inside, by name."""
    clock: dict[str, Spent] = {}
    with _held(_clocks, clock):
        yield clock


@contextmanager
def elsewhere(share: Callable[[], str]) -> Iterator[None]:
    """Show the progress of work that goes on in other processes, as `share` returns it."""
    with _held(_shares, share):
        yield


@contextmanager
def progress(description: str, total: int, unit: str) -> Iterator[Advance]:
    """Show the share of `total` steps that the yielded function counted; at the end, the time.

    The progress of silent work is shown with the step that it is part of.
    """
    done, start = 0, time.monotonic()
    last = start

    def count(steps: int = 1) -> None:
        nonlocal done, last
        done, last = done + steps, time.monotonic()

    def share() -> str:
        now = time.monotonic()
        return progress_line(done, total, unit, last - start, now - last)

    if _silences:
        with _held(_shares, share):
            yield count
        return
    with speaking(lambda: f"{description}: {share()}{_now()}", is_of_steps=False):
        yield count
    elapsed = time.monotonic() - start
    print(f"{description}: {total} {unit}s in {elapsed:.1f} s", file=sys.stderr)


@contextmanager
def working(description: str) -> Iterator[None]:
    """Show that work continues, and which step, while nothing inside shows progress."""
    start = time.monotonic()
    with speaking(
        lambda: f"{description}: at work for {duration(time.monotonic() - start)}{_now()}"
    ):
        yield


def progress_line(done: int, total: int, unit: str, elapsed_s: float, since_s: float = 0.0) -> str:
    """Return share done and time left, such as "34 % of 300 frames · 1:24 left".

    The last steps were done after `elapsed_s`, and `since_s` ago. A step that takes longer than the
    others does not lengthen the time left.
    """
    text = f"{100 * done // max(total, 1)} % of {total} {unit}s"
    if not done or not elapsed_s:
        return f"{text} · {_clock(elapsed_s + since_s)} so far"
    step_s = elapsed_s / done
    left_s = step_s * (total - done) - min(since_s, step_s)
    return f"{text} · {_clock(max(left_s, 0.0))} left"


def _clock(seconds: float) -> str:
    """Format minutes and seconds, or a longer time as `duration`."""
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes}:{rest:02}" if minutes < 120 else duration(seconds)


def duration(seconds: float) -> str:
    """Format a time, such as "40 s", "9 min", "3 hours" or "12 days"."""
    for unit, length, least in (("days", 86400, 2), ("hours", 3600, 2), ("min", 60, 2)):
        if seconds >= least * length:
            return f"{seconds / length:.0f} {unit}"
    return f"{seconds:.0f} s"


def _stage() -> str:
    """Number of the current stage, to begin a line."""
    return "".join(_stages[-1:])


def current_step() -> str:
    """Return the current step and the progress of silent work in it; empty without any."""
    # another thread may remove the last
    return ", ".join((*_steps[-1:], *(share() for share in _shares[-1:])))


def _now() -> str:
    """Current step, to append to a line."""
    return f"; {now}" if (now := current_step()) else ""


def _clear_status() -> None:
    if _status_stands.is_set():
        _status_stands.clear()
        print("\r\x1b[K", end="", file=sys.stderr, flush=True)


@contextmanager
def speaking(state: Callable[[], str], is_of_steps: bool = True) -> Iterator[None]:
    """Print a state at intervals, from a thread of its own, while this is the innermost work.

    A terminal shows it on its last line; if it `is_of_steps`, only during a step. Elsewhere each
    state is a line.
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
                line = (_stage() + state())[: shutil.get_terminal_size().columns - 1]
                print(f"\r{line}\x1b[K", end="", file=sys.stderr, flush=True)
            else:
                print(_stage() + state(), file=sys.stderr, flush=True)

    thread = threading.Thread(target=speak, daemon=True)
    with _held(_speakers, over):
        thread.start()
        try:
            yield
        finally:
            over.set()
            thread.join()
            _clear_status()
