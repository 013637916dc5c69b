import numpy as np
import pytest

from megalopta.sensor.ctia.integration import Pixel
from megalopta.sensor.ctia.model import CtiaNoise, draw_noise, noise_variance
from megalopta.sensor.ctia.photodiode import Photodiode
from megalopta.sensor.sampling.streams import generator

OFF = CtiaNoise(photon_shot=False, dark_shot=False, reset=False)
DIODE = Photodiode(saturation_current_a=2e-15, shunt_ohm=5e12)
SECONDS = 0.05
DRAWS = 40_000


def pixel(bias=1e-3):
    return Pixel(DIODE, 1e-12, 3.3, 1e6, np.full(DRAWS, bias))


def only(**term):
    return OFF.model_copy(update=term)


def test_reset_noise_of_10_pf_is_20_microvolts():
    big = Pixel(Photodiode(temperature_k=300), 10e-12, 3.3, 1e6, 0.0)
    deviation = np.sqrt(noise_variance(only(reset=True), big, np.zeros(1), SECONDS))
    assert deviation == pytest.approx(20.35e-6, rel=1e-3)


def test_pixel_held_at_the_rail_has_no_shot_noise():
    shot = only(dark_shot=True, photon_shot=True)
    assert not draw_noise(generator(0, "x"), shot, pixel(-0.1), np.zeros(DRAWS), SECONDS).any()
