"""A bar on the terminal."""

from collections.abc import Iterator
from contextlib import contextmanager

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

from megalopta.progress import Advance, rate_text


class _RateColumn(ProgressColumn):
    def render(self, task: Task) -> Text:
        """How fast it goes lately, or went in all."""
        speed = task.finished_speed or task.speed
        return Text(rate_text(speed, task.fields["unit"]) if speed else "")


@contextmanager
def bar(description: str, total: int, unit: str) -> Iterator[Advance]:
    """Show a bar for `total` steps, which the yielded function counts."""
    columns = (
        TextColumn("{task.description:<34}"),
        BarColumn(bar_width=24),
        MofNCompleteColumn(),
        _RateColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True)) as bars:
        task = bars.add_task(description, total=total, unit=unit)
        yield lambda steps=1: bars.advance(task, steps)
