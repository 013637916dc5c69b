"""The bound against closed forms, and against an estimator that should reach it."""

import numpy as np
import pytest

from megalopta.assets_gen import generator
from megalopta.flow.detectors.blocks import block_grid
from megalopta.flow.metrics.translation_bound import (
    cramer_rao_covariance,
    fisher_information,
    median_endpoint_error,
    texture_spectrum,
    unknown_texture_information,
    unknown_texture_photons,
)

GRID = block_grid((72, 72), 24)
PERIOD = 24.0


def texture(dx=0.0, dy=0.0, mean=400.0):
    """Mean counts and their gradient of crossed waves displaced by (dx, dy), block (1, 1)."""
    y, x = np.mgrid[24:48, 24:48].astype(float)
    a, b = 2 * np.pi * (x - dx + y - dy) / PERIOD, 2 * np.pi * (x - dx - 2 * (y - dy)) / PERIOD
    slope = 2 * np.pi / PERIOD * mean
    value = mean * (1 + 0.3 * np.sin(a) + 0.5 * np.sin(b))
    along_x = slope * (0.3 * np.cos(a) + 0.5 * np.cos(b))
    along_y = slope * (0.3 * np.cos(a) - 1.0 * np.cos(b))
    return value, np.stack((along_x, along_y))


def test_information_of_a_sine_has_its_closed_form():
    # The mean of C²cos²/(1 + C·sin) over a period is 1 − √(1 − C²).
    contrast, mean = 0.8, 5.0
    wave = 1 + contrast * np.sin(2 * np.pi * np.arange(72) / PERIOD)
    information = fisher_information(mean * np.tile(wave, (72, 1)), GRID)[1, 1]
    per_pixel = mean * (2 * np.pi / PERIOD) ** 2 * (1 - np.sqrt(1 - contrast**2))
    # a cubic spline's slope is off by (2π/24)⁴/180 = 3e-5 of itself
    assert information[0, 0] == pytest.approx(24**2 * per_pixel, rel=1e-3)
    assert np.abs(information[[0, 1, 1], [1, 0, 1]]).max() < 1e-9 * information[0, 0]


@pytest.mark.slow
def test_maximum_likelihood_with_known_texture_reaches_the_bound():
    y, x = np.mgrid[:72, :72].astype(float)
    full = 400 * (
        1
        + 0.3 * np.sin(2 * np.pi * (x + y) / PERIOD)
        + 0.5 * np.sin(2 * np.pi * (x - 2 * y) / PERIOD)
    )
    bound = cramer_rao_covariance(fisher_information(full, GRID)[1, 1])
    rng = np.random.default_rng(5)
    draws = 800
    places = np.zeros((draws, 2, 2))
    for place in places.reshape(-1, 2):
        counts = rng.poisson(texture()[0])
        for _ in range(3):  # Fisher scoring; the third step is below 1e-6 px
            value, slope = texture(*place)
            score = -(slope * (counts / value - 1)).sum(axis=(1, 2))
            place += np.linalg.solve(np.einsum("iyx,jyx->ij", slope, slope / value), score)
    velocities = places[:, 1] - places[:, 0]
    measured = np.cov(velocities.T)
    # A variance from 800 draws is off by √(2/800) = 5 %: 5.5 of those. A bound of one noisy
    # frame would be off by a factor of 2.
    np.testing.assert_allclose(np.diag(measured), np.diag(bound), rtol=0.275)
    correlation = bound[0, 1] / np.sqrt(bound[0, 0] * bound[1, 1])
    assert measured[0, 1] / np.sqrt(measured[0, 0] * measured[1, 1]) == pytest.approx(
        correlation, abs=0.2
    )


@pytest.mark.parametrize("frames", [2, 3, 8])
def test_more_frames_tell_a_velocity_as_a_line_through_their_displacements(frames):
    information = np.array([[3.0, 1.0], [1.0, 2.0]])
    design = np.vander(np.arange(frames), 2)
    slope_variance = np.linalg.inv(design.T @ design)[0, 0]
    np.testing.assert_allclose(
        cramer_rao_covariance(information, frames), slope_variance * np.linalg.inv(information)
    )


def test_stripes_have_no_bound_and_darkness_no_information():
    stripes = np.tile(1 + 0.5 * np.sin(np.arange(72) / 3), (72, 1))
    assert np.all(np.isinf(cramer_rao_covariance(fisher_information(stripes, GRID))))
    assert np.all(fisher_information(np.zeros((72, 72)), GRID) == 0)


def test_median_length_of_normal_errors_has_its_closed_forms():
    assert median_endpoint_error(np.eye(2) * 9) == pytest.approx(3 * np.sqrt(2 * np.log(2)))
    # along a line it is 0.6745 σ; 64 directions give that within 1 %
    assert median_endpoint_error(np.diag([4.0, 0.0])) == pytest.approx(2 * 0.6745, rel=0.01)


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
