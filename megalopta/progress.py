"""Progress on the terminal: how far, how fast, how long still."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.text import Text

console = Console(stderr=True)


class Advance(Protocol):
    """Moves a bar on."""

    def __call__(self, steps: int = 1) -> None:
        """Count `steps` more as done."""


class _RateColumn(ProgressColumn):
    def render(self, task: Task) -> Text:
        """Steps per second, or seconds per step where that reads better."""
        speed = task.finished_speed or task.speed
        unit = task.fields["unit"]
        if not speed:
            return Text("")
        return Text(f"{speed:.1f} {unit}s/s" if speed >= 1 else f"{1 / speed:.1f} s/{unit}")


def say(text: str) -> None:
    """Print one line on standard error."""
    console.print(text, highlight=False, markup=False, soft_wrap=True)


@contextmanager
def progress(description: str, total: int, unit: str) -> Iterator[Advance]:
    """Show a bar for `total` steps, which the yielded function counts.

    Without a terminal one line is printed at the end.
    """
    columns = (
        TextColumn("{task.description:<34}"),
        BarColumn(bar_width=24),
        MofNCompleteColumn(),
        _RateColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, disable=not console.is_terminal) as bars:
        task = bars.add_task(description, total=total, unit=unit)
        yield lambda steps=1: bars.advance(task, steps)
        elapsed = bars.tasks[0].elapsed or 0.0
    if not console.is_terminal:
        print(f"{description}: {total} {unit}s in {elapsed:.1f} s", file=sys.stderr)
