"""A captured scene beside what the device's model makes of the same frames of it.

The frames of a dataset are a cycle. A recording begins anywhere in it, so captured frames are
aligned: of shifts by a quarter of a frame, that one under which counts follow the cycle best, by
the correlation over all frames and pixels of what remains of both without the means of pixels.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.camera.comparison_levels import map_error
from megalopta.camera.stimuli import Rendered
from megalopta.config.model import load
from megalopta.core.arrays import Floats
from megalopta.core.errors import UserError
from megalopta.sensor import Sensor, changed, expose_rate
from megalopta.sensor.compare.quantities import CountedFrames, scene_differences
from megalopta.sensor.compare.recordings import Comparison, compare_recordings
from megalopta.sensor.spad.device import draw_fixed_pattern
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
    """Places of captured frames in a cycle."""

    frame: NDArray[np.int64]
    """(n,) frame of the cycle that each one saw as it began."""
    correlation: float
    """Of captured frames with these; 0 where nothing moves."""


def dataset_cycle(dataset: Path, lux: float | None, device: Sensor) -> Cycle:
    """Return frames of a rendered dataset at a light level, by default its own."""
    trajectory = open_dataset_whole(dataset).configuration.trajectory
    rate_hz = trajectory.frame_rate_hz
    times_s = np.arange(trajectory.frames) / rate_hz
    return Cycle(Rendered(dataset, lux).rates_hz(times_s, device), rate_hz)


def rendered_dataset(scene: str, beside: Path) -> Path:
    """Return the folder of a rendered dataset; a configuration is rendered into `beside`.

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


@dataclass(frozen=True, eq=False)
class SceneComparison:
    """Differences of a captured scene from a simulated one, frame by frame of the same sight."""

    captured: CountedFrames
    simulated: CountedFrames
    aligned: Aligned
    found: Comparison


def compare_scene(
    captured: CountedFrames, cycle: Cycle, device: Sensor, margin: float, seed: int
) -> SceneComparison:
    """Align captured frames with a scene, and simulate these of its frames.

    Raises
    ------
    ValueError
        When there are too few frames or pixels do not fit.
    """
    aligned = align(captured, cycle)
    rates = cycle.rates_hz[aligned.frame]
    simulated = _exposed(captured, rates, device, seed)
    errors_hz = _errors(device, rates)
    found = compare_recordings(
        [captured],
        [simulated],
        kind=device.dead_time.kind,
        margin=margin,
        errors=[errors_hz * captured.exposure_s],
    )
    differences = scene_differences(captured, simulated, rates, margin, errors_hz)
    return SceneComparison(captured, simulated, aligned, replace(found, differences=differences))


def _exposed(like: CountedFrames, rates_hz: Floats, device: Sensor, seed: int) -> CountedFrames:
    """Frames of a device at these rates, with the exposure of others."""
    own = changed(device, exposure_s=like.exposure_s)
    name = f"comparison, scene, {like.exposure_s:g} s, light {like.light_hz:g}"
    exposure = expose_rate(rates_hz, own, seed=seed, sequence=name)
    saturated = None if like.saturated is None else exposure.saturated
    return replace(like, counts=exposure.counts, saturated=saturated)


def _errors(device: Sensor, rates: Floats) -> Floats:
    """Standard errors of mean rates that those of the device's maps make, Hz."""
    maps = device.measured
    dark, efficiency = map_error(maps.dark_counts), map_error(maps.efficiency)
    factor = draw_fixed_pattern(device, (rates.shape[1], rates.shape[2])).efficiency_factor
    return np.asarray(np.hypot(dark, rates.mean(axis=0) * efficiency / np.maximum(factor, 1e-12)))
