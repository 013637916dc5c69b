"""The photon budget: what reaches a pixel in one exposure and what the sensor makes of it.

Readings are counts, or electrons of a sensor that integrates. Photons, detections and the
signal-to-noise ratio are of the frames that the report shows, mean readings and saturation of
everything that was stored.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.config.light_scale import light_scale
from megalopta.config.model import Configuration, LightLevel
from megalopta.core.errors import UserError
from megalopta.dataset.store import Dataset
from megalopta.report.footage import ReportFrames
from megalopta.report.records import Record
from megalopta.scenes.lighting.levels import illuminance_of
from megalopta.sensor import (
    ImageSensor,
    OpenedCounts,
    detected_photons,
    expectation,
)
from megalopta.stages.noise_warning import variances
from megalopta.stages.sense import open_exposure

# Pixels between these percentiles are drawn as the spread of the signal-to-noise ratio.
_SPREAD_PERCENT = (5, 50, 95)
_BRIGHTER = 0.01


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
    """Mean reading, what is read in the dark included"""
    signal_to_noise: tuple[float, float, float]
    """Of single pixels of the middle frame: 5th, 50th and 95th percentile"""
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
    """Return budget and pictures of every sensor at every level; `record` is that of the scene."""
    noise = record.get("monte_carlo") or {}
    return [_exposed(dataset, footage, each, noise) for each in dataset.configuration.exposures]


def _exposed(
    dataset: Dataset, footage: ReportFrames, exposure: tuple[ImageSensor, LightLevel], noise: Record
) -> ExposureSummary:
    opened, settings, level = open_exposure(dataset, *exposure), dataset.configuration, exposure[1]
    scale = light_scale(settings, level)
    light = footage.radiance * scale.astype(np.float32)
    frames = list(footage.selection.frames)
    try:
        budget = _budget(settings, light, opened, frames, level)
    except ValueError as problem:  # a measured map is gone
        raise UserError(f"sensor {opened.sensor.name!r}: {problem}") from None
    if "covariance" in noise:
        rendering, shot, _ = variances(noise, settings, opened.sensor, scale)
        relative = math.sqrt(max(rendering, 0.0) / shot) if shot else math.inf
        budget = replace(budget, rendering_noise=relative)
    counts, saturated = (
        footage.selection.pixels(opened[name][frames]) for name in ("counts", "saturated")
    )
    return ExposureSummary(budget, counts, saturated)


def _budget(
    settings: Configuration,
    light: NDArray[np.float32],
    opened: OpenedCounts,
    frames: list[int],
    level: LightLevel,
) -> Budget:
    sensor, bands = opened.sensor, settings.render.bands_nm
    detected = detected_photons(light, bands, sensor)
    middle = len(frames) // 2
    at: dict[str, Any] = {
        "first_frame": frames[middle],
        "frame_period_s": 1 / settings.trajectory.frame_rate_hz,
    }
    dark, seen, brighter = (
        expectation(np.float32(factor) * light[[middle]], bands, sensor, **at)
        for factor in (0.0, 1.0, 1 + _BRIGHTER)
    )
    ratio = seen.signal_to_noise(brighter, _BRIGHTER)
    low, median, high = np.percentile(ratio, _SPREAD_PERCENT)
    return Budget(
        sensor=sensor,
        level=level,
        illuminance_lux=illuminance_of(level),
        photons=float(opened["photons"][frames].mean()),
        detected=float(detected.mean()),
        dark=float(dark.mean_reading.mean()),
        expected=opened["mean_reading"].mean(),
        signal_to_noise=(float(low), float(median), float(high)),
        saturated_fraction=opened["saturated"].mean(),
        photons_per_frame=float(detected.sum(axis=(1, 2)).mean()),
    )
