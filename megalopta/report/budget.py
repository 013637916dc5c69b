"""The photon budget: what reaches a pixel in one exposure and what the sensor makes of it.

Readings are counts, or electrons of a sensor that integrates. Photons, detections and the
signal-to-noise ratio are computed from the radiance of the frames that the report shows, expected
readings and saturation from everything that was stored.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from megalopta.config import Configuration, LightLevel
from megalopta.dataset import Dataset
from megalopta.errors import UserError
from megalopta.report.footage import ReportFrames
from megalopta.report.records import Record
from megalopta.scenes.lighting import illuminance_of
from megalopta.scenes.spectra import Bands
from megalopta.sensor import (
    ImageSensor,
    StoredCounts,
    detected_photons,
    expected_reading,
    incident_photons,
    reading_signal_to_noise,
)
from megalopta.stages import exposures, light_scale, read_exposure, variances

# Pixels between these percentiles are drawn as the spread of the signal-to-noise ratio.
_SPREAD_PERCENT = (5, 50, 95)


@dataclass(frozen=True)
class Budget:
    """One sensor at one light level; means over pixels and frames unless said otherwise."""

    sensor: ImageSensor
    level: LightLevel
    illuminance_lux: float
    photons: float
    """That fall on a pixel, per exposure"""
    detected: float
    """Of these, without dead time"""
    dark: float
    """Reading of a pixel in the dark"""
    expected: float
    """Of the noise-free twin, what is read in the dark included; of counts before saturation"""
    signal_to_noise: tuple[float, float, float]
    """Of single pixels: 5th, 50th and 95th percentile"""
    saturated_fraction: float
    """Readings of full pixels"""
    photons_per_frame: float
    """Detected photons summed over the frame"""
    rendering_noise: float | None = None
    """Of a pixel, over its shot noise (standard deviations); None where it was not measured"""


def by_sensor(budgets: Iterable[Budget]) -> dict[str, list[Budget]]:
    """Budgets by the name of their sensor, in their order."""
    found: dict[str, list[Budget]] = {}
    for each in budgets:
        found.setdefault(each.sensor.name, []).append(each)
    return found


@dataclass(frozen=True, eq=False)
class ExposureSummary:
    """A budget and the counts (n, h, w) that are shown of it."""

    budget: Budget
    counts: NDArray[np.generic]
    saturated: NDArray[np.bool_]


def exposed(dataset: Dataset, footage: ReportFrames, record: Record) -> list[ExposureSummary]:
    """Budget and pictures of every sensor at every light level; `record` is that of the scene."""
    noise = record.get("monte_carlo") or {}
    return [
        _exposed(dataset.configuration, footage, read_exposure(dataset, *each), each[1], noise)
        for each in exposures(dataset)
    ]


def _exposed(
    settings: Configuration,
    footage: ReportFrames,
    stored: StoredCounts,
    level: LightLevel,
    noise: Record,
) -> ExposureSummary:
    frames = list(footage.selection.frames)
    scale = light_scale(settings, level)
    light = footage.radiance * scale.astype(np.float32)
    try:
        budget = _budget(light, settings.render.bands_nm, stored, level)
    except ValueError as problem:  # a measured map is gone
        raise UserError(f"sensor {stored.sensor.name!r}: {problem}") from None
    if "covariance" in noise:
        rendering, shot, _ = variances(noise, settings, stored.sensor, scale)
        relative = math.sqrt(max(rendering, 0.0) / shot) if shot else math.inf
        budget = replace(budget, rendering_noise=relative)
    counts, saturated = (
        footage.selection.pixels(each[frames])
        for each in (stored.exposure.counts, stored.exposure.saturated)
    )
    return ExposureSummary(budget, counts, saturated)


def _budget(
    light: NDArray[np.float32], bands: Bands, stored: StoredCounts, level: LightLevel
) -> Budget:
    sensor = stored.sensor
    detected = detected_photons(light, bands, sensor)
    ratio = reading_signal_to_noise(light, bands, sensor)
    low, median, high = np.percentile(ratio, _SPREAD_PERCENT)
    return Budget(
        sensor=sensor,
        level=level,
        illuminance_lux=illuminance_of(level),
        photons=float(incident_photons(light, bands, sensor).mean()),
        detected=float(detected.mean()),
        dark=float(expected_reading(0 * light[:1], bands, sensor).mean()),
        expected=float(stored.exposure.expected.mean()),
        signal_to_noise=(float(low), float(median), float(high)),
        saturated_fraction=float(stored.exposure.saturated.mean()),
        photons_per_frame=float(detected.sum(axis=(1, 2)).mean()),
    )
