"""A captured rendered scene beside what the device's model makes of the same frames of it."""

from dataclasses import dataclass, replace

import numpy as np

from megalopta.camera.comparison_cycle import Aligned, Cycle, align
from megalopta.camera.comparison_levels import map_error
from megalopta.core.arrays import Floats
from megalopta.sensor import Sensor, changed, expose_rate
from megalopta.sensor.compare.counted import CountedFrames
from megalopta.sensor.compare.recordings import Comparison, compare_recordings
from megalopta.sensor.compare.scene import scene_differences
from megalopta.sensor.spad.fixed_pattern import draw_fixed_pattern


@dataclass(frozen=True, eq=False)
class SceneComparison:
    """How a captured scene differs from a simulated one, frame by frame of the same sight."""

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
    simulated = exposed(captured, rates, device, seed)
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


def exposed(like: CountedFrames, rates_hz: Floats, device: Sensor, seed: int) -> CountedFrames:
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
