"""Recordings that cannot support a calibration are refused in one sentence."""

from dataclasses import replace

import numpy as np
import pytest

from megalopta.sensor.calibrate import calibrate_device

from .devices import adc_of, device, levels_of

SENSOR = device(seed=2)
ADC = adc_of(SENSOR)
LEVELS = levels_of(SENSOR, frames=60, shape=(6, 6))
DARK = [level for level in LEVELS if level.is_dark]


def drifting(level):
    """The output falls by 12 codes while the level is recorded."""
    way = np.linspace(0, 12, len(level.codes))[:, None, None]
    return replace(level, codes=(level.codes - way).astype(int))


@pytest.mark.parametrize(
    ("levels", "words"),
    [
        ([replace(level, codes=level.codes[:20]) for level in LEVELS], "20 frames"),
        ([level for level in LEVELS if not level.is_dark], "dark frames of 0 exposures"),
        ([replace(level, codes=0 * level.codes + 80) for level in LEVELS], "saturated"),
        ([*DARK, replace(DARK[0], light_hz=1e7)], "no brighter than the dark"),
        ([drifting(LEVELS[0]), *LEVELS[1:]], "drifts"),
        ([*DARK, replace(DARK[0], codes=DARK[0].codes[:, :3])], "pixels"),
    ],
    ids=["few frames", "no dark", "saturated", "no light", "drifting", "shapes"],
)
def test_refusals(levels, words):
    with pytest.raises(ValueError, match=words):
        calibrate_device(levels, ADC)
