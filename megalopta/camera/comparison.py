"""`megalopta spadcam compare`: recordings against the device model's simulation of the stimulus.

Stimuli are levels of uniform light, the moving plate of the motion bench, or a scene. The frames of
a scene's dataset are a cycle, in which a recording begins anywhere. Of shifts by a quarter of a
frame, the one with the highest correlation is chosen, over all frames and pixels, after the mean of
each pixel is subtracted.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.camera.motion_bench import (
    FRAME_RATE_HZ,
    PIXELS,
    TIME_CONSTANTS_S,
    UNITS,
    BenchLight,
    crossing_peaks,
    cut_passages,
    cut_rest,
    detector,
    fitted_light,
    pooled,
    record,
)
from megalopta.camera.recording import Beam, RecordingFrames
from megalopta.camera.stimuli import Cycle
from megalopta.config.model import load
from megalopta.core.arrays import Floats
from megalopta.core.bounded import ARRAY_BYTES, plain_array, read_bytes
from megalopta.core.errors import UserError, refused_as
from megalopta.dataset.store import open_sequence
from megalopta.sensor import AnalogCounter, Sensor, changed
from megalopta.sensor.calibrate.level import Level
from megalopta.sensor.compare.model import Model, level_of_codes
from megalopta.sensor.compare.quantities import scene_differences
from megalopta.sensor.compare.recordings import Comparison, compare_recordings
from megalopta.sensor.compare.two_sample import Difference, Quantity, difference
from megalopta.sensor.spad.device import draw_fixed_pattern
from megalopta.sensor.spad.measured import MapFile
from megalopta.stages.run import run_stage

_95 = 1.959964
_SHIFTS_PER_FRAME = 4
_TIE = 1e-9


def captured_frames(recorded: RecordingFrames, device: Sensor, light_hz: float) -> Level:
    """Return counts of a recording; from its codes, if it has any, by the device's own steps."""
    codes, exposure_s, times_s = recorded.codes, recorded.exposure_s, recorded.times_s
    if codes is None or not isinstance(device.counter, AnalogCounter):
        return Level(recorded.counts, exposure_s, light_hz, times_s=times_s)
    return level_of_codes(codes, device, exposure_s, light_hz, times_s)


@dataclass(frozen=True, eq=False)
class Compared:
    """Captured recordings, simulations of the same stimuli, and their differences."""

    captured: Sequence[Level]
    simulated: Sequence[Level]
    found: Comparison
    correlation: float = 0.0
    """Correlation of the frames of a scene with their aligned simulation"""


def compare_levels(
    captured: Sequence[Level], device: Sensor, beam: Beam, margin: float, seed: int
) -> Compared:
    """Compare levels of uniform light. Raises UserError for light of unknown wavelength."""
    rates = [_even_rate(level, device, beam) for level in captured]
    return _compared(captured, rates, device, margin, seed)


def _even_rate(level: Level, device: Sensor, beam: Beam) -> Floats:
    """Detection rates of a level (1, rows, columns), Hz, without dark counts."""
    shape = level.readings.shape[1], level.readings.shape[2]
    if level.is_dark:
        return np.zeros((1, *shape))
    if beam.wavelength_nm is None:
        raise UserError("compare: unknown wavelength of the light; give --wavelength-nm")
    own = changed(device, exposure_s=level.exposure_s)
    nominal = float(own.photon_detection_efficiency(np.array(beam.wavelength_nm)))
    factor = draw_fixed_pattern(own, shape).efficiency_factor
    return np.asarray(level.light_hz * nominal * factor[np.newaxis])


def _compared(
    captured: Sequence[Level],
    rates: Sequence[Floats],
    device: Sensor,
    margin: float,
    seed: int,
    stimulus: str = "",
) -> Compared:
    """Compare recordings with frames of the device's model at these rates (n or 1, …), Hz."""
    model = Model(device, rates)
    simulated = model.drawn(captured, seed, stimulus)
    errors = [
        _errors(device, rate) * like.exposure_s for like, rate in zip(captured, rates, strict=True)
    ]
    found = compare_recordings(
        captured, simulated, model, margin=margin, errors=errors, is_scene=bool(stimulus)
    )
    return Compared(captured, simulated, found)


def _errors(device: Sensor, rates: Floats) -> Floats:
    """Standard errors of mean rates (rows, columns) due to those of the device's maps, Hz."""
    maps = device.measured
    dark, efficiency = map_error(maps.dark_counts), map_error(maps.efficiency)
    factor = draw_fixed_pattern(device, (rates.shape[1], rates.shape[2])).efficiency_factor
    return np.asarray(np.hypot(dark, rates.mean(axis=0) * efficiency / np.maximum(factor, 1e-12)))


def map_error(file: MapFile | None) -> NDArray[np.float64] | float:
    """Return standard errors of a map, from the intervals next to it; 0 without intervals.

    NaN where the calibration does not know the pixel.
    """
    if file is None:
        return 0.0
    path = Path(file.path)
    ends = [path.with_name(f"{path.stem}_{end}.npy") for end in ("low", "high")]
    if not all(end.exists() for end in ends):
        return 0.0
    low, high = (_interval_end(end) for end in ends)
    return np.asarray((high - low) / (2 * _95))


def _interval_end(path: Path) -> NDArray[np.float64]:
    values = plain_array(read_bytes(path, ARRAY_BYTES))
    if values is None or values.ndim != 2:
        raise UserError(f"{path} is not a complete array of numbers; calibrate the device again")
    return values.astype(np.float64)


class SpeedResponse(NamedTuple):
    """Peak responses of one detector at one speed, captured and simulated, per crossing."""

    name: str
    speed_mm_s: float
    captured: Floats
    """(crossings,), mean over rows and detectors of the array."""
    simulated: Floats
    difference: Difference


def plate_responses(
    captured: Mapping[float, Level],
    device: Sensor,
    margin: float,
    seed: int = 0,
    *,
    own_light: bool = False,
) -> list[SpeedResponse]:
    """Compare responses to a plate at each speed (mm/s), over complete passages.

    Passages are found by their edges, so that the plate may rest at its ends. Raises UserError if a
    recording is not of 16 × 16 pixels at 10 frames/s, or has fewer than two complete passages
    without a gap.
    """
    found = []
    for speed, frames in sorted(captured.items()):
        counts = passages_at(speed, frames)
        own = changed(device, exposure_s=1 / FRAME_RATE_HZ)
        light = light_at(speed, counts, own) if own_light else None
        simulated = record(speed, own, light, seed).counts
        for name in TIME_CONSTANTS_S:
            a, b = (
                crossing_peaks(detector(name), pooled(each)).mean(axis=(1, 2))
                for each in (counts, simulated)
            )
            title = f"{name} response at {speed:g} mm/s"
            apart = difference(Quantity(title, UNITS[name]), a, b, margin)
            found.append(SpeedResponse(name, speed, a, b, apart))
    return found


def passages_at(speed_mm_s: float, frames: Level) -> NDArray[Any]:
    """Cut passages from a recording of a plate, or frames of one at rest. Raises UserError."""
    if frames.readings.shape[1:] != (PIXELS, PIXELS):
        raise UserError(
            f"plate at {speed_mm_s:g} mm/s: frames of {frames.readings.shape[1:]} pixels; capture "
            "all rows"
        )
    times_s = frames.times_s
    numbers = None if times_s is None else np.rint((times_s - times_s[:1]) * FRAME_RATE_HZ)
    with refused_as(f"plate at {speed_mm_s:g} mm/s"):
        return cut_passages(frames.readings, numbers) if speed_mm_s else cut_rest(frames.readings)


def light_at(speed_mm_s: float, counts: NDArray[Any], device: Sensor) -> BenchLight:
    """Estimate the light from passages of a plate. Raises UserError."""
    if speed_mm_s == 0:
        raise UserError("a plate at rest does not show the light; omit it or --own-light")
    with refused_as(f"plate at {speed_mm_s:g} mm/s"):
        return fitted_light(counts, device)


class Aligned(NamedTuple):
    """Places of captured frames in a cycle."""

    frame: NDArray[np.int64]
    """(n,) frame of the cycle at the start of each captured frame."""
    correlation: float
    """Correlation of captured frames with these; 0 without motion."""


def rendered_dataset(scene: str, beside: Path) -> Path:
    """Return the folder of a rendered dataset; a configuration is rendered into `beside`.

    Raises UserError if there is neither a dataset nor a configuration of this name.
    """
    root = Path(scene)
    if not root.is_dir():
        root, configuration = beside, load(scene)
    else:
        configuration = open_sequence(root).configuration
    run_stage(root, configuration, "render")
    return root


def align(frames: Level, cycle: Cycle) -> Aligned:
    """Align captured frames with a cycle. Raises UserError if sizes differ."""
    shape = frames.readings.shape[1:]
    if shape != cycle.rates_hz.shape[1:]:
        raise UserError(
            f"compare: frames of {shape} pixels, the scene has {cycle.rates_hz.shape[1:]}; "
            "capture all rows"
        )
    places = _places(frames, cycle)
    counts, rates = (
        (each - each.mean(axis=0)).reshape(len(each), -1)
        for each in (np.asarray(frames.readings, np.float64), cycle.rates_hz)
    )
    size = np.square(rates).sum(axis=1)
    if not size.max() > 0:
        return Aligned(places[0], 0.0)
    fit = (counts @ rates.T)[np.arange(len(counts)), places].sum(axis=1)
    norm = np.sqrt(np.square(counts).sum() * size[places].sum(axis=1))
    score = fit / np.maximum(norm, 1e-300)
    best = np.flatnonzero(score >= score.max() - _TIE)
    # the middle of equal shifts is the least sensitive to clock differences
    return Aligned(places[best[len(best) // 2]], float(score.max()))


def _places(frames: Level, cycle: Cycle) -> NDArray[np.int64]:
    """Frame of the cycle at each captured frame, for every shift, (shifts, n)."""
    times_s = frames.times_s
    if times_s is None:
        times_s = frames.exposure_s * np.arange(len(frames.readings), dtype=np.float64)
    length = len(cycle.rates_hz)
    shift = np.arange(_SHIFTS_PER_FRAME * length) / _SHIFTS_PER_FRAME
    at = (times_s - times_s[0]) * cycle.frame_rate_hz + shift[:, None]
    return np.asarray(np.floor(at + 1e-6).astype(np.int64) % length)


def compare_scene(
    captured: Level, cycle: Cycle, device: Sensor, margin: float, seed: int
) -> Compared:
    """Align captured frames with a scene, and simulate the matching frames.

    Raises ValueError if there are too few frames or pixels do not match.
    """
    aligned = align(captured, cycle)
    rates = cycle.rates_hz[aligned.frame]
    compared = _compared([captured], [rates], device, margin, seed, "scene, ")
    (simulated,) = compared.simulated
    differences = scene_differences(captured, simulated, rates, margin, _errors(device, rates))
    found = replace(compared.found, differences=differences)
    return replace(compared, found=found, correlation=aligned.correlation)
