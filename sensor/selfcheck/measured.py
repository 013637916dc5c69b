"""Devices with measured maps: every pixel counts what its maps say, at any bias.

The maps are those of one device at the reference bias, so they hold its mismatch already. At
another bias a pixel of breakdown δ above nominal moves by f(V − δ)/f(V_ref − δ) in efficiency,
f(V) = 1 − exp(−(V − onset)/scale), and by exp((V − V_ref)/e-fold) in dark counts.
"""

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.stats import chi2, norm

from megalopta.arrays import Floats
from megalopta.sensor import changed
from megalopta.sensor.effects import Bias
from megalopta.sensor.sampling import generator
from megalopta.sensor.selfcheck.comparison import Row
from megalopta.sensor.spad import (
    MapFile,
    MeasuredMaps,
    Sensor,
    detection_rate,
    expose,
    preset,
    without,
)

_PIXELS, _FRAMES = (6, 8), 400
_BANDS_NM = [(440.0, 460.0)]
_BIAS = Bias(efficiency_scale_v=0.3, dark_efold_v=0.1, breakdown_sigma_v=0.05)


def check_measured_maps() -> Iterator[Row]:
    """Totals of all pixels over many frames, at the bias of the maps and above it."""
    rng = generator(11, "maps")
    dark_hz = rng.uniform(50, 500, _PIXELS)
    efficiency = rng.uniform(0.5, 1.0, _PIXELS)
    offset_v = rng.normal(0, 0.05, _PIXELS)
    radiance = np.full((_FRAMES, *_PIXELS, 1), 1e-7)
    with TemporaryDirectory() as folder:
        maps = MeasuredMaps(
            dark_counts=_saved(Path(folder, "dark.npy"), dark_hz),
            efficiency=_saved(Path(folder, "efficiency.npy"), efficiency),
            breakdown=_saved(Path(folder, "breakdown.npy"), offset_v),
        )
        for excess_v in (1.0, 1.1):
            sensor = changed(
                _plain_spadcam(), measured=maps, bias=changed(_BIAS, excess_v=excess_v)
            )
            counts = expose(radiance, _BANDS_NM, sensor, seed=12, sequence=f"{excess_v} V").counts
            light_hz = detection_rate(radiance[:1], _BANDS_NM, _plain_spadcam())[0]
            rate_hz = light_hz * efficiency * _trigger(excess_v - offset_v)
            rate_hz /= _trigger(1.0 - offset_v)
            rate_hz += dark_hz * np.exp((excess_v - 1.0) / 0.1)
            expected = _FRAMES * sensor.exposure_s * rate_hz
            z = _poisson_z(expected, counts.sum(0, dtype=np.int64))
            yield Row("measured maps", f"all pixels at {excess_v:g} V, as z", 0.0, z, z)


def _saved(path: Path, values: Floats) -> MapFile:
    np.save(path, values)
    return MapFile(path=str(path))


def _plain_spadcam() -> Sensor:
    sensor = preset("spadcam")
    for effect in ("bias", "dark_counts", "dead_time", "counter"):
        sensor = without(sensor, effect)
    return sensor


def _trigger(excess_v: Floats) -> Floats:
    return np.asarray(1 - np.exp(-excess_v / 0.3))


def _poisson_z(expected: Floats, counts: Floats) -> float:
    """Pearson's test of independent Poisson counts, as the z of the same probability."""
    statistic = float(((counts - expected) ** 2 / expected).sum())
    return float(norm.isf(max(chi2.sf(statistic, counts.size), 1e-300)))
