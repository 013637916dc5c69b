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


class _RateColumn(ProgressColumn):
    def __init__(self, rate_text: Callable[[float, str], str]) -> None:
        super().__init__()
        self._rate_text = rate_text

    def render(self, task: Task) -> Text:
        """How fast it goes lately, or went in all."""
        speed = task.finished_speed or task.speed
        return Text(self._rate_text(speed, task.fields["unit"]) if speed else "")


class _StepColumn(ProgressColumn):
    def __init__(self, step: Callable[[], str]) -> None:
        super().__init__()
        self._step = step

    def render(self, task: Task) -> Text:
        """What is being done."""
        return Text(self._step()[:_STEP_CHARACTERS], no_wrap=True)


@contextmanager
def bar(
    description: str,
    total: int,
    unit: str,
    rate_text: Callable[[float, str], str],
    step: Callable[[], str],
) -> Iterator[Callable[[int], None]]:
    """Show a bar for `total` steps, which the yielded function counts."""
    columns = (
        TextColumn("{task.description:<34}"),
        BarColumn(bar_width=24),
        MofNCompleteColumn(),
        _RateColumn(rate_text),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        _StepColumn(step),
    )
    with Progress(*columns, console=Console(stderr=True)) as bars:
        task = bars.add_task(description, total=total, unit=unit)

        def advance(steps: int) -> None:
            bars.advance(task, steps)

        yield advance
