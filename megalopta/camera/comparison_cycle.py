"""What a camera sees again and again, and where in it each captured frame is.

The frames of a dataset are a cycle. A recording begins anywhere in it, so captured frames are
aligned: of shifts by a quarter of a frame, that one under which counts follow the cycle best, by
the correlation over all frames and pixels of what remains of both without the means of pixels.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.camera.rendered import Rendered
from megalopta.config.model import load
from megalopta.core.arrays import Floats
from megalopta.core.errors import UserError
from megalopta.sensor import Sensor
from megalopta.sensor.compare.counted import CountedFrames
from megalopta.stages.pipeline import run_stage
from megalopta.stages.redo import open_dataset_whole

_SHIFTS_PER_FRAME = 4
_TIE = 1e-9


class Cycle(NamedTuple):
    """Detection rates that follow each other, then start anew."""

    rates_hz: Floats
    """(k, rows, columns)"""
    frame_rate_hz: float


class Aligned(NamedTuple):
    """Where captured frames are in a cycle."""

    frame: NDArray[np.int64]
    """(n,) frame of the cycle that each one saw as it began."""
    correlation: float
    """Of captured frames with these; 0 where nothing moves."""


def dataset_cycle(dataset: Path, lux: float | None, device: Sensor) -> Cycle:
    """Frames of a rendered dataset at a light level, by default its own."""
    trajectory = open_dataset_whole(dataset).configuration.trajectory
    rate_hz = trajectory.frame_rate_hz
    times_s = np.arange(trajectory.frames) / rate_hz
    return Cycle(Rendered(dataset, lux).rates_hz(times_s, device), rate_hz)


def rendered_dataset(scene: str, beside: Path) -> Path:
    """Folder of a dataset whose radiance is there; a configuration is rendered into `beside`.

    Raises
    ------
    UserError
        When there is neither a dataset nor a configuration of this name.
    """
    root = Path(scene)
    if not root.is_dir():
        root, configuration = beside, load(scene)
    else:
        configuration = open_dataset_whole(root).configuration
    run_stage(root, configuration, "render")
    return root


def align(frames: CountedFrames, cycle: Cycle) -> Aligned:
    """Find where in a cycle captured frames are. Raises UserError when sizes differ."""
    shape = frames.counts.shape[1:]
    if shape != cycle.rates_hz.shape[1:]:
        raise UserError(
            f"compare: frames of {shape} pixels, the scene has {cycle.rates_hz.shape[1:]}; "
            "capture all rows"
        )
    places = _places(frames, cycle)
    counts, rates = (
        (each - each.mean(axis=0)).reshape(len(each), -1)
        for each in (np.asarray(frames.counts, np.float64), cycle.rates_hz)
    )
    size = np.square(rates).sum(axis=1)
    if not size.max() > 0:
        return Aligned(places[0], 0.0)
    fit = (counts @ rates.T)[np.arange(len(counts)), places].sum(axis=1)
    norm = np.sqrt(np.square(counts).sum() * size[places].sum(axis=1))
    score = fit / np.maximum(norm, 1e-300)
    best = np.flatnonzero(score >= score.max() - _TIE)
    # in the middle of equal shifts, clocks that are not quite alike do least
    return Aligned(places[best[len(best) // 2]], float(score.max()))


def _places(frames: CountedFrames, cycle: Cycle) -> NDArray[np.int64]:
    """Frame of the cycle at each captured frame, for every shift, (shifts, n)."""
    times_s = frames.times_s
    if times_s is None:
        times_s = frames.exposure_s * np.arange(len(frames.counts), dtype=np.float64)
    length = len(cycle.rates_hz)
    shift = np.arange(_SHIFTS_PER_FRAME * length) / _SHIFTS_PER_FRAME
    at = (times_s - times_s[0]) * cycle.frame_rate_hz + shift[:, None]
    return np.asarray(np.floor(at + 1e-6).astype(np.int64) % length)
