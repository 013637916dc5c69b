import numpy as np
import pytest

from megalopta.sensor.ctia.integration import Pixel
from megalopta.sensor.ctia.noise import CtiaNoise, draw_noise, noise_variance
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


@pytest.mark.parametrize(
    "noise",
    [
        only(photon_shot=True),
        only(dark_shot=True),
        only(reset=True),
        only(read_noise_v=50e-6),
        CtiaNoise(read_noise_v=10e-6),
    ],
)
@pytest.mark.parametrize("bias", [0.0, 1e-3, 0.1])
def test_draws_have_mean_zero_and_the_variance_stated(noise, bias):
    light = np.full(DRAWS, 1e-15)
    values = draw_noise(generator(1, "noise", int(bias * 1e6)), noise, pixel(bias), light, SECONDS)
    variance = noise_variance(noise, pixel(bias), light, SECONDS)[0]
    squares = values**2
    # |z| < 5 each, false alarm 6e-7
    assert abs(values.mean()) < 5 * np.sqrt(variance / DRAWS)
    assert abs(squares.mean() - variance) < 5 * squares.std() / np.sqrt(DRAWS)


def test_reset_noise_of_10_pf_is_20_microvolts():
    big = Pixel(Photodiode(temperature_k=300), 10e-12, 3.3, 1e6, 0.0)
    deviation = np.sqrt(noise_variance(only(reset=True), big, np.zeros(1), SECONDS))
    assert deviation == pytest.approx(20.35e-6, rel=1e-3)


def test_pixel_held_at_the_rail_has_no_shot_noise():
    shot = only(dark_shot=True, photon_shot=True)
    assert not draw_noise(generator(0, "x"), shot, pixel(-0.1), np.zeros(DRAWS), SECONDS).any()
