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

from megalopta.core.arrays import Floats
from megalopta.sensor import changed
from megalopta.sensor.counters import AnalogCounter
from megalopta.sensor.effects import Afterpulsing, Bias, Crosstalk, DeadTime
from megalopta.sensor.sampling import generator
from megalopta.sensor.selfcheck.comparison import Row, exact_row
from megalopta.sensor.spad import (
    MapFile,
    MeasuredMaps,
    Sensor,
    detection_rate,
    draw_fixed_pattern,
    expose,
    preset,
    without,
)

_PIXELS, _FRAMES = (6, 8), 400
_MAPS = (
    *("dark_counts", "efficiency", "dead_time", "afterpulsing", "crosstalk"),
    *("step", "leak", "offset"),
)
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


def check_windows() -> Iterator[Row]:
    """Every map, larger than the image: what pixels in the corner and in the middle of it have."""
    rng = generator(12, "windows")
    large = {name: rng.uniform(0.01, 0.1, (11, 15)) for name in _MAPS}
    plain = changed(
        _plain_spadcam(),
        counter=AnalogCounter(step_v=0.05),
        dead_time=DeadTime(kind="nonparalyzable", dead_time_s=1e-7),
        afterpulsing=Afterpulsing(mean_carriers=0.1),
        crosstalk=Crosstalk(mean_fired_neighbors=0.1),
    )
    with TemporaryDirectory() as folder:
        files = {name: _saved(Path(folder, f"{name}.npy"), each) for name, each in large.items()}
        for fit, top, left in (("top_left", 0, 0), ("center", 2, 3)):
            maps = MeasuredMaps.model_validate(files | {"fit": fit})
            pattern = draw_fixed_pattern(changed(plain, measured=maps), _PIXELS)
            assert pattern.counters is not None and pattern.avalanches is not None
            found = {
                "dark_counts": pattern.dark_counts_hz,
                "efficiency": pattern.efficiency_factor,
                "step": pattern.counters.step_v,
                "leak": pattern.counters.leaked_v / plain.exposure_s,
                "offset": pattern.counters.offset_v,
                **pattern.avalanches._asdict(),
            }
            for name, values in found.items():
                window = large[name][top : top + _PIXELS[0], left : left + _PIXELS[1]]
                off = float(np.abs(values / window - 1).max())
                quantity = f"{name}, largest error"
                yield exact_row(f"measured maps, {fit}", quantity, 0.0, off, 1e-12)


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
