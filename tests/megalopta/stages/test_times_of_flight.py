"""Histograms of a rendered sequence whose source is at the camera."""

import numpy as np
import pytest

from megalopta import open_dataset
from megalopta.config.model import load

from ..small import TINY, made, small

SENSOR = (
    "{preset: ideal, name: flight, exposure_s: 0.001, jitter: {sigma_s: 8.0e-11}, tcspc: "
    "{bins: 1000, period_s: 1.0e-7, pulse_sigma_s: 5.0e-11, from_camera: true}}"
)
OWN = TINY | small(16, 16, 2, sensors=SENSOR, levels="full_moon")
OWN |= {"products": "[counts, histograms_npy]"}


@pytest.mark.slow
def test_the_mean_time_of_a_pixel_is_that_of_light_to_its_surface_and_back(tmp_path):
    made(tmp_path / "lit", load("grating", OWN))
    counts = np.load(tmp_path / "lit/counts/grating/flight-full_moon.histograms.npy")
    sequence = open_dataset(tmp_path / "lit")[0]
    camera = sequence.configuration.camera
    distance_m = np.array([sequence.depth[k] for k in (0, 1)]) / camera.depth(np.ones((16, 16)))
    times_s = 1e-7 * (np.arange(1000) + 0.5) / 1000
    mean_s = (counts * times_s).sum(axis=-1) / counts.sum(axis=-1)
    # pulse, jitter and bins of 99 ps are 14.8 mm, over the root of the photons: 5.5 standard errors;
    # pile-up at a tenth of a photon per pulse moves the mean by a twentieth of 99 ps, 0.8 mm
    off_m = np.abs(299792458 / 2 * mean_s - distance_m)
    assert np.all(off_m < 5.5 * 14.8e-3 / np.sqrt(counts.sum(axis=-1)) + 0.8e-3)
    assert np.ptp(distance_m) > 1
