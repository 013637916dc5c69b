"""Corrected frames beside the readings, from the stages to Python; physics: tests/sensor/calibrate."""

import numpy as np
import pytest

import megalopta
from megalopta.config.model import load
from megalopta.sensor.calibrate.correction import correct, simulated_calibration

from ..small import made, small

SETTINGS = small(24, 20, 3, sensors="spadcam, ctia_si", levels="twilight") | {
    "render.bands_nm": "[[700, 800], [800, 900]]",
    "correct": "true",
    "calibration.frames": "100",
}


@pytest.fixture(scope="module")
def sequence(tmp_path_factory):
    dataset = made(tmp_path_factory.mktemp("corrected") / "data", load("grating", SETTINGS))
    return megalopta.open_dataset(dataset.root)[0]


def test_what_is_stored_is_the_readings_corrected_with_one_calibration(sequence):
    spad, settings = sequence.exposures[0], sequence.configuration
    calibration = simulated_calibration(
        settings.sensors[0],
        sequence.shape,
        frames=100,
        seed=settings.seed,
        hot_times=settings.calibration.hot_times,
    )
    expected = correct(sequence.counts(spad)[:], sequence.counts(spad, "saturated")[:], calibration)
    for name in ("detections", "variance", "filled", "ambiguous"):
        stored = sequence.corrected(spad, name)
        assert stored.shape == (3, 20, 24)
        # stored as float32
        np.testing.assert_allclose(stored[:], getattr(expected, name), rtol=1e-6)
