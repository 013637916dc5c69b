"""Recordings that cannot support a calibration are refused in one sentence."""

from dataclasses import replace

import numpy as np
import pytest

from megalopta.sensor.calibrate.device import calibrate_device

from .devices import adc_of, device, levels_of

SENSOR = device(seed=2)
ADC = adc_of(SENSOR)


@pytest.fixture(scope="module")
def recordings():
    return levels_of(SENSOR, frames=60, shape=(6, 6))


def dark(levels):
    return [level for level in levels if level.is_dark]


def drifting(level):
    """The output falls by 12 codes while the level is recorded."""
    way = np.linspace(0, 12, len(level.readings))[:, None, None]
    return replace(level, readings=(level.readings - way).astype(int))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            lambda levels: [replace(level, readings=level.readings[:20]) for level in levels],
            "20 frames",
        ),
        (
            lambda levels: [level for level in levels if not level.is_dark],
            "dark frames of 0 exposures",
        ),
        (
            lambda levels: [replace(level, readings=0 * level.readings + 80) for level in levels],
            "saturated",
        ),
        (
            lambda levels: [*dark(levels), replace(levels[0], light_hz=1e7)],
            "no brighter than the dark",
        ),
        (lambda levels: [drifting(levels[0]), *levels[1:]], "drifts"),
        (
            lambda levels: [*dark(levels), replace(levels[0], readings=levels[0].readings[:, :3])],
            "pixels",
        ),
    ],
    ids=["few frames", "no dark", "saturated", "no light", "drifting", "shapes"],
)
def test_refusals(recordings, change, words):
    with pytest.raises(ValueError, match=words):
        calibrate_device(change(recordings), ADC)
