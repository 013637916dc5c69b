"""A bar on the terminal."""

from collections.abc import Callable, Iterator
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

_STEP_CHARACTERS = 40


class _TextColumn(ProgressColumn):
    def __init__(self, text: Callable[[Task], str]) -> None:
        super().__init__()
        self._text = text

    def render(self, task: Task) -> Text:
        """Return what there is to tell now."""
        return Text(self._text(task), no_wrap=True)


@contextmanager
def bar(
    description: str,
    total: int,
    unit: str,
    rate_text: Callable[[float, str], str],
    step: Callable[[], str],
) -> Iterator[Callable[[int], None]]:
    """Show a bar for `total` steps, which the yielded function counts."""

    def rate(task: Task) -> str:
        """How fast it goes lately, or went in all."""
        speed = task.finished_speed or task.speed
        return rate_text(speed, unit) if speed else ""

    columns = (
        TextColumn("{task.description:<34}"),
        BarColumn(bar_width=24),
        MofNCompleteColumn(),
        _TextColumn(rate),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        _TextColumn(lambda _: step()[:_STEP_CHARACTERS]),
    )
    with Progress(*columns, console=Console(stderr=True)) as bars:
        task = bars.add_task(description, total=total)
        yield lambda steps: bars.advance(task, steps)
