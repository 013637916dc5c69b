"""Progress of long work: share done, time left, current step.

A terminal shows it on its last line, with a bar; elsewhere it is a line every ten seconds.
"""

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

from megalopta.core.bounded import sentence

INTERVAL_S = 10.0
"""Interval of lines without a terminal (s)."""
STATUS_S = 1.0
"""Interval of updates on a terminal (s)."""

# What this process works on, the outermost first; the innermost is shown.
_speakers: list[object] = []
_silences: list[object] = []
_steps: list[str] = []
_shares: list[Callable[[], str]] = []


def say(text: str) -> None:
    """Print one line on standard error."""
    if not _silences:
        print(sentence(text, sys.maxsize), file=sys.stderr, flush=True)


@contextmanager
def silent() -> Iterator[None]:
    """Print nothing of the work inside; its progress is shown by the work around it."""
    _silences.append(silent)
    try:
        yield
    finally:
        _silences.pop()


@contextmanager
def step(name: str) -> Iterator[None]:
    """Name the work inside, for lines of progress."""
    _steps.append(name)
    try:
        yield
    finally:
        _steps.remove(name)


@contextmanager
def progress(description: str, total: int, unit: str) -> Iterator[Callable[..., None]]:
    """Show the share of `total` steps that the yielded function counted; at the end, the time."""
    done, start = 0, time.monotonic()
    last = start

    def count(steps: int = 1) -> None:
        nonlocal done, last
        done, last = done + steps, time.monotonic()

    def share() -> str:
        now = time.monotonic()
        return progress_line(done, total, unit, last - start, now - last)

    if _silences:
        _shares.append(share)
        try:
            yield count
        finally:
            _shares.remove(share)
        return
    with working(description, share, lambda: done / max(total, 1)):
        yield count
    say(f"{description}: {total} {unit}s in {time.monotonic() - start:.1f} s")


@contextmanager
def working(
    description: str,
    state: Callable[[], str] | None = None,
    share: Callable[[], float | None] = lambda: None,
) -> Iterator[None]:
    """Show at intervals that work continues, and its step, while nothing inside shows progress.

    Its state is by default the time since it began. Without a `share` of it that is done, a
    terminal shows it only during a step.
    """
    if _silences:
        yield
        return
    is_terminal, over, start = sys.stderr.isatty(), threading.Event(), time.monotonic()

    def speak() -> None:
        while not over.wait(STATUS_S if is_terminal else INTERVAL_S):
            if _speakers[-1] is not over:
                continue
            # another thread may remove the last of these
            now = ", ".join((*_steps[-1:], *(inner() for inner in _shares[-1:])))
            done = state() if state else f"at work for {duration(time.monotonic() - start)}"
            line = f"{description}: {done}; {now}".removesuffix("; ")
            if not is_terminal:
                print(line, file=sys.stderr, flush=True)
            elif now or share() is not None:
                bar, task = _bar()
                bar.start()
                bar.update(task, description=line, completed=share() or 0, refresh=True)
        if is_terminal:
            _bar()[0].stop()

    thread = threading.Thread(target=speak, daemon=True)
    _speakers.append(over)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
        _speakers.remove(over)


def progress_line(done: int, total: int, unit: str, elapsed_s: float, since_s: float = 0.0) -> str:
    """Return share done and time left, such as "34 % of 300 frames · 1:24 left".

    The last steps were done after `elapsed_s`, and `since_s` ago. A step that takes longer than the
    others does not lengthen the time left.
    """
    text = f"{100 * done // max(total, 1)} % of {total} {unit}s"
    seconds, meaning = elapsed_s + since_s, "so far"
    if done and elapsed_s:
        step_s = elapsed_s / done
        seconds, meaning = step_s * (total - done) - min(since_s, step_s), "left"
    minutes, seconds_left = divmod(max(round(seconds), 0), 60)
    clock = f"{minutes}:{seconds_left:02}" if minutes < 120 else duration(seconds)
    return f"{text} · {clock} {meaning}"


def duration(seconds: float) -> str:
    """Format a time, such as "40 s", "9 min", "3 hours" or "12 days"."""
    for unit, length in (("days", 86400), ("hours", 3600), ("min", 60)):
        if seconds >= 2 * length:
            return f"{seconds / length:.0f} {unit}"
    return f"{seconds:.0f} s"


@cache
def _bar() -> tuple[Any, Any]:
    """Return rich's bar on a terminal, and its only task."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn
    from rich.table import Column

    words = TextColumn("{task.description}", markup=False, table_column=Column(no_wrap=True))
    bar = Progress(words, BarColumn(20), console=Console(stderr=True), auto_refresh=False,
                   transient=True, redirect_stdout=False)  # fmt: skip
    return bar, bar.add_task("", total=1.0)
