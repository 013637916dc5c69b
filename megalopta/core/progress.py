"""Progress of long work: stage, share done, time left.

A terminal shows it on its last line, with a bar; elsewhere it is a line every ten seconds, the
first after two. Time left never grows: it says "over 4:00" where steps turn out to be slower.
"""

import math
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

from megalopta.core.bounded import sentence

INTERVAL_S, FIRST_S = 10.0, 2.0
"""Interval of lines without a terminal, and time of the first; shorter work prints none (s)."""
STATUS_S = 0.5
"""Interval of updates on a terminal (s)."""
clock = time.monotonic

# What this process works on, the outermost first; the innermost is shown.
_speakers: list[object] = []
_silences: list[object] = []
_steps: list[str] = []
_shares: list[object] = []
_between = "loading"  # what is said outside every step
_told_s = -math.inf  # when the last line was printed


class Pace:
    """Share and time left of counted steps, such as "34 % of 300 frames · 1:24 left"."""

    def __init__(self, total: int, unit: str) -> None:
        self.share, self._total, self._unit = 0.0, total, f"{unit}{'s' * (total != 1)}"
        self._start_s = clock()
        self._counted = deque([(self._start_s, 0)])  # times, and steps done by then
        self._least_s = math.inf

    def count(self, steps: int = 1) -> None:
        """Count steps as done."""
        done = self._counted[-1][1] + steps
        self.share = done / max(self._total, 1)
        self._counted.append((clock(), done))
        middle_s = (self._start_s + clock()) / 2
        while len(self._counted) > 2 and self._counted[1][0] <= middle_s:
            self._counted.popleft()

    def __str__(self) -> str:
        """Return share and time left, at the pace of the last half of the time.

        Steps that were kept from an earlier run take no time, and say nothing of those to come. A
        step that takes longer than the others does not lengthen the time left.
        """
        text = f"{math.floor(100 * self.share)} % of {self._total} {self._unit} · "
        (before_s, before), (last_s, done) = self._counted[0], self._counted[-1]
        since_s, elapsed_s = clock() - last_s, clock() - self._start_s
        if done == before or last_s - self._start_s <= since_s / 2:
            return f"{text}{clock_time(elapsed_s)} so far"
        step_s = (last_s - before_s) / (done - before)
        left_s = max(step_s * (self._total - done) - min(since_s, step_s), 0.0)
        self._least_s = min(self._least_s, left_s)
        if left_s <= 1.2 * self._least_s + 1:
            return f"{text}{clock_time(self._least_s)} left"
        return f"{text}{clock_time(elapsed_s)} so far, over {clock_time(self._least_s)} left"


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
    global _between
    _steps.append(name)
    try:
        yield
    finally:
        _steps.remove(name)
        _between = f"after {name}"


@contextmanager
def progress(description: str, total: int, unit: str) -> Iterator[Callable[..., None]]:
    """Show the share of `total` steps that the yielded function counted; at the end, the time."""
    pace, start_s = Pace(total, unit), clock()
    if _silences:
        _shares.append(pace)
        try:
            yield pace.count
        finally:
            _shares.remove(pace)
        return
    with working(description, pace.__str__, pace):
        yield pace.count
    if clock() >= start_s + FIRST_S:
        say(f"{description}: {total} {unit}{'s' * (total != 1)} in {clock() - start_s:.1f} s")


@contextmanager
def working(
    description: str, state: Callable[[], str] | None = None, pace: Pace | None = None
) -> Iterator[None]:
    """Show at intervals that work continues, and its step, while nothing inside shows progress.

    Its state is by default the time since it began. Outside every step, the last one is named.
    """
    global _told_s, _between
    if _silences:
        yield
        return
    _told_s = _told_s if _speakers else -math.inf
    is_terminal, over, start_s = sys.stderr.isatty(), threading.Event(), clock()

    def speak() -> None:
        global _told_s
        while not over.wait(STATUS_S):
            is_early = clock() < max(start_s + FIRST_S, _told_s + INTERVAL_S)
            if _speakers[-1] is not over or (is_early and not is_terminal):
                continue
            # another thread may remove the last of these
            done = state() if state else f"at work for {duration(clock() - start_s)}"
            steps = _steps[-1:] or ([] if state else [_between])
            now = ", ".join((*steps, *map(str, _shares[-1:])))
            line = f"{description}: {done}; {now}".removesuffix("; ")
            if not is_terminal:
                _told_s = clock()
                print(line, file=sys.stderr, flush=True)
            else:
                bar, task = _bar()
                bar.start()
                share = pace.share if pace else 0.0
                bar.update(task, description=line, completed=share, refresh=True)
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
        _between = f"after {description}"


def clock_time(seconds: float) -> str:
    """Format a time as minutes and seconds, such as "9:36"; long ones as `duration`."""
    minutes, rest_s = divmod(round(seconds), 60)
    return f"{minutes}:{rest_s:02}" if minutes < 120 else duration(seconds)


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
