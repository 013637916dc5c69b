import numpy as np
import pytest
from scipy.constants import e, k

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


@pytest.mark.parametrize("ideality", [1.5, 2.0])
@pytest.mark.parametrize("bias", [0.0, 1e-3, 0.03])
def test_drawn_dark_charge_has_the_variance_of_detailed_balance(ideality, bias):
    diode = Photodiode(saturation_current_a=2e-15, ideality=ideality)
    held = Pixel(diode, 1e-12, 3.3, 1e10, np.full(DRAWS, bias))
    rng = generator(2, "ideality", int(bias * 1e6))
    volts = draw_noise(rng, only(dark_shot=True), held, np.zeros(DRAWS), SECONDS)
    half = max(bias, 1e-9) * e / (2 * k * diode.temperature_k)
    net = 2e-15 * -np.expm1(-2 * half / ideality)
    expected = net / np.tanh(half) * SECONDS / e  # electrons²
    electrons = (volts * 1e-12 / e) ** 2
    # |z| < 5, false alarm 6e-7
    assert abs(electrons.mean() - expected) < 5 * electrons.std() / np.sqrt(DRAWS)


def test_reset_noise_of_10_pf_is_20_microvolts():
    big = Pixel(Photodiode(temperature_k=300), 10e-12, 3.3, 1e6, 0.0)
    deviation = np.sqrt(noise_variance(only(reset=True), big, np.zeros(1), SECONDS))
    assert deviation == pytest.approx(20.35e-6, rel=1e-3)


def test_everything_off_is_silent():
    light = np.full(DRAWS, 1e-15)
    assert not draw_noise(generator(0, "x"), OFF, pixel(), light, SECONDS).any()
    assert not noise_variance(OFF, pixel(), light, SECONDS).any()


def test_pixel_held_at_the_rail_has_no_shot_noise():
    shot = only(dark_shot=True, photon_shot=True)
    assert not draw_noise(generator(0, "x"), shot, pixel(-0.1), np.zeros(DRAWS), SECONDS).any()


def test_negative_read_noise_is_refused():
    with pytest.raises(ValueError, match="read_noise_v"):
        CtiaNoise(read_noise_v=-1e-6)
