"""Captured levels of darkness and light as counts, and the same levels from a device's model."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from megalopta.camera.device_calibration import Beam
from megalopta.camera.recorded import Recorded
from megalopta.core.arrays import plain_array
from megalopta.core.bounded import ARRAY_BYTES, read_bytes
from megalopta.core.errors import UserError
from megalopta.sensor import AnalogCounter, Sensor, changed, expose_rate
from megalopta.sensor.compare.quantities import CountedFrames
from megalopta.sensor.spad.conversion import counts_of_codes
from megalopta.sensor.spad.device import draw_fixed_pattern
from megalopta.sensor.spad.measured import MapFile

_FULL = 0.98
_95 = 1.959964


def captured_frames(recorded: Recorded, device: Sensor, light_hz: float) -> CountedFrames:
    """Return counts of a recording: of its codes, by the device's own steps, where it has codes."""
    counter, codes = device.counter, recorded.codes
    own = changed(device, exposure_s=recorded.exposure_s)
    if codes is None or not isinstance(counter, AnalogCounter):
        return CountedFrames(
            recorded.counts, recorded.exposure_s, light_hz, times_s=recorded.times_s
        )
    known = draw_fixed_pattern(own, (codes.shape[1], codes.shape[2])).counters
    assert known is not None
    counts, _ = counts_of_codes(codes, counter, known)
    full = _FULL * (counter.swing_v - known.leaked_v) / known.step_v
    return CountedFrames(
        counts, recorded.exposure_s, light_hz, counts >= full, times_s=recorded.times_s
    )


def simulated_frames(
    like: Sequence[CountedFrames], device: Sensor, beam: Beam, seed: int
) -> list[CountedFrames]:
    """Return as many frames of each level, from the device's model.

    Raises
    ------
    UserError
        When there is light of no known wavelength.
    """
    return [_simulated(level, device, beam, seed) for level in like]


def calibration_errors(
    like: Sequence[CountedFrames], device: Sensor, beam: Beam
) -> list[NDArray[np.float64]]:
    """Return standard errors of the mean counts of each level that those of the device's maps make.

    The intervals of a map lie beside it; a map without makes no error.
    """
    dark = map_error(device.measured.dark_counts)
    efficiency = map_error(device.measured.efficiency)
    nominal = _nominal(device, beam)
    return [
        np.hypot(dark, level.light_hz * nominal * efficiency)
        * np.full(level.counts.shape[1:], level.exposure_s)
        for level in like
    ]


def map_error(file: MapFile | None) -> NDArray[np.float64] | float:
    """Return standard errors of a map, from the intervals that lie beside it; 0 where none do."""
    if file is None:
        return 0.0
    path = Path(file.path)
    ends = [path.with_name(f"{path.stem}_{end}.npy") for end in ("low", "high")]
    if not all(end.exists() for end in ends):
        return 0.0
    low, high = (_interval_end(end) for end in ends)
    return np.asarray(np.nan_to_num((high - low) / (2 * _95), nan=np.nanmax(high - low)))


def _interval_end(path: Path) -> NDArray[np.float64]:
    values = plain_array(read_bytes(path, ARRAY_BYTES))
    if values is None or values.ndim != 2:
        raise UserError(f"{path} is no whole array of numbers; calibrate the device again")
    return values.astype(np.float64)


def _nominal(device: Sensor, beam: Beam) -> float:
    """Return the detected share of photons on a pixel; 0 for light of unknown wavelength."""
    if beam.wavelength_nm is None:
        return 0.0
    return float(device.photon_detection_efficiency(np.array(beam.wavelength_nm)))


def _simulated(level: CountedFrames, device: Sensor, beam: Beam, seed: int) -> CountedFrames:
    own = changed(device, exposure_s=level.exposure_s)
    shape = level.counts.shape[1], level.counts.shape[2]
    rate = np.zeros(shape)
    if not level.is_dark:
        if beam.wavelength_nm is None:
            raise UserError("compare: light of what wavelength? give --wavelength-nm")
        rate = (
            level.light_hz * _nominal(own, beam) * draw_fixed_pattern(own, shape).efficiency_factor
        )
    name = f"comparison, {level.exposure_s:g} s, light {level.light_hz:g}"
    rates = np.broadcast_to(rate, level.counts.shape)
    exposure = expose_rate(rates, own, seed=seed, sequence=name)
    # where a capture does not tell what is full, full counts are compared as such
    saturated = None if level.saturated is None else exposure.saturated
    return CountedFrames(exposure.counts, level.exposure_s, level.light_hz, saturated)
