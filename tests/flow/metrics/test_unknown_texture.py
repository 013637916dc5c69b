"""The bound with unknown texture against dense covariances, its limits, and a known flux."""

import numpy as np
import pytest

from megalopta.assets_gen import generator
from megalopta.flow.metrics.unknown_texture import (
    texture_spectrum,
    unknown_texture_information,
    unknown_texture_photons,
)

ROWS, COLUMNS = 5, 7  # odd: no wave at half the sampling rate, whose shift is not defined


def spectrum_of_a_texture():
    """Random powers, the same for a frequency and its opposite."""
    power = generator(1, "spectrum").uniform(0.1, 9, (ROWS, COLUMNS))
    return (power + np.roll(power[::-1, ::-1], (1, 1), (0, 1))) / 2


def covariance(spectrum, noise, frames, velocity):
    """Covariance of all pixels of all frames of a periodic Gaussian texture that drifts."""
    y, x = (place.ravel() for place in np.mgrid[:ROWS, :COLUMNS])
    time = np.repeat(np.arange(frames), y.size)
    x, y = np.tile(x, frames) - velocity[0] * time, np.tile(y, frames) - velocity[1] * time
    fx, fy = np.meshgrid(np.fft.fftfreq(COLUMNS), np.fft.fftfreq(ROWS))
    waves = np.exp(2j * np.pi * (np.outer(x, fx.ravel()) + np.outer(y, fy.ravel())))
    texture = (waves * spectrum.ravel()) @ waves.conj().T / spectrum.size
    return texture.real + noise * np.eye(len(x))


@pytest.mark.parametrize("frames", [2, 3])
def test_information_is_that_of_the_dense_covariance(frames):
    # ½·tr(R⁻¹·∂R·R⁻¹·∂R) of zero-mean normal data; central differences err by 1e-7
    spectrum, noise, at, step = spectrum_of_a_texture(), 2.0, np.array([0.3, -0.7]), 1e-4
    inverse = np.linalg.inv(covariance(spectrum, noise, frames, at))
    slopes = [
        (
            covariance(spectrum, noise, frames, at + step * axis)
            - covariance(spectrum, noise, frames, at - step * axis)
        )
        / (2 * step)
        for axis in np.eye(2)
    ]
    dense = [[np.trace(inverse @ a @ inverse @ b) / 2 for a in slopes] for b in slopes]
    found = unknown_texture_information(spectrum, noise, ROWS * COLUMNS, frames)
    np.testing.assert_allclose(found, dense, rtol=1e-5, atol=1e-5 * np.abs(dense).max())


def test_bright_texture_costs_nothing_to_learn():
    spectrum, noise = spectrum_of_a_texture(), 1e-9
    fx, fy = np.meshgrid(np.fft.fftfreq(COLUMNS), np.fft.fftfreq(ROWS))
    waves = 2 * np.pi * np.stack((fx, fy)).reshape(2, -1)
    known = (waves * spectrum.ravel() / noise) @ waves.T * 10 / spectrum.size
    found = unknown_texture_information(spectrum, noise, 10, 8)
    np.testing.assert_allclose(found, known * 42, rtol=1e-6)


def test_spectrum_of_white_noise_is_its_variance():
    noise = generator(2, "white").normal(0, 3, (400, 16, 20))
    spectrum = texture_spectrum(noise)
    # 4 · 10⁵ draws, some three quarters of them lost to the window: 0.5 % of 9, five times
    assert spectrum.mean() == pytest.approx(9, rel=0.025)
    # each frequency over 400 images: 5 %, or 7 % of real ones, six times
    np.testing.assert_allclose(spectrum[1:, 1:], 9, rtol=0.45)


def test_photons_give_the_error_asked_for():
    spectrum, noise, speed = spectrum_of_a_texture() / 1e3, 0.5, 2.0
    flux = unknown_texture_photons(spectrum, noise, 100, 4, speed, 0.25)
    least = np.linalg.inv(unknown_texture_information(spectrum * flux**2, noise * flux, 100, 4))
    draws = generator(3, "errors").multivariate_normal((0, 0), least, 200_000)
    # the share of 2e5 draws has a standard error of 0.11 %
    share = np.mean(np.hypot(*draws.T) < 0.25 * speed)
    assert share == pytest.approx(0.5, abs=0.006)


def test_waves_of_one_direction_need_infinitely_many_photons():
    spectrum = np.zeros((ROWS, COLUMNS))
    spectrum[0, 1] = spectrum[0, -1] = 1.0
    assert unknown_texture_photons(spectrum, 1.0, 100, 2, 1.0, 0.25) == np.inf


def test_noise_of_nothing_is_refused():
    with pytest.raises(ValueError, match=r"noise 0: give the variance"):
        unknown_texture_information(np.ones((4, 4)), 0.0, 16)
