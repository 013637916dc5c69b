"""Display of a running capture: the newest frame on a terminal, else a line now and then."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from megalopta.camera.capturing import State
from megalopta.camera.recording import RecordingSettings
from megalopta.core.progress import speaking

_NO_CLOCK_S = 1.0
"""Mean error of times that no line holds back: only of a clock beyond what a quartz may be off."""
_SATURATED = "on rgb(220,60,40)"


def status_line(state: State) -> str:
    """Return the state of a capture in one line."""
    record = state.record
    parts = [
        f"{state.frames} frames",
        f"{state.rate_hz:.1f} frames/s",
        f"{record.gaps} gaps ({record.missing_frames} frames missing)",
        f"{record.damaged_packets} packets damaged",
    ]
    if state.saturated is not None:
        parts.append(f"{int(state.saturated.sum())} pixels saturated")
    if not state.is_plugged:
        parts.append("unplugged, waiting for it")
    return ", ".join(parts)


def recorded_line(path: Path, record: RecordingSettings) -> str:
    """Return a summary of a recording in one line."""
    return (
        f"{path}: {record.frames} frames of {record.serial_number}, {record.gaps} gaps between "
        f"the first and the last ({record.missing_frames} frames missing), "
        f"{record.damaged_packets} packets damaged{_how_sure_times_are(record)}"
    )


def _how_sure_times_are(record: RecordingSettings) -> str:
    if record.recovered and any(each.error_s is None for each in record.connections):
        return ", times by the camera's clock alone"
    error_s = record.connections[-1].error_s if record.connections else None
    if not error_s:
        return ""
    if error_s > _NO_CLOCK_S:
        return ", times by the camera's clock alone: it goes otherwise than this machine's"
    return f", times to {error_s * 1e3:.2g} ms"


@contextmanager
def viewing() -> Iterator[Callable[[State], None]]:
    """Yield what shows a state: a picture on a terminal, elsewhere a line every ten seconds."""
    if sys.stderr.isatty():
        with _picture() as show:
            yield show
        return
    last: list[State] = []
    with speaking(lambda: f"capture: {status_line(last[0]) if last else 'no frames yet'}"):
        yield lambda state: last.__setitem__(slice(None), [state])


@contextmanager
def _picture() -> Iterator[Callable[[State], None]]:
    from rich.console import Console, Group
    from rich.live import Live
    from rich.text import Text

    blocks = Text("")
    with Live(console=Console(stderr=True), refresh_per_second=10, transient=True) as live:

        def show(state: State) -> None:
            nonlocal blocks
            if state.counts is not None and state.saturated is not None:
                blocks = Text()
                for style in _styles(state.counts, state.saturated):
                    blocks.append("  " if style else "\n", style or None)
            live.update(Group(blocks, Text(status_line(state) + "; Ctrl-C stops")))

        yield show


def _styles(counts: NDArray[np.uint16], saturated: NDArray[np.bool_]) -> Iterator[str]:
    """Background of each pixel, gray by its share of the brightest; "" at the end of a row."""
    brightest = max(int(counts[~saturated].max(initial=1)), 1)
    for row, full in zip(counts, saturated, strict=True):
        for count, is_full in zip(row, full, strict=True):
            gray = min(int(255 * (int(count) / brightest) ** 0.5), 255)
            yield _SATURATED if is_full else f"on rgb({gray},{gray},{gray})"
        yield ""
