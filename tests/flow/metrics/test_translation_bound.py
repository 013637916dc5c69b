"""The bound against closed forms, and against an estimator that should reach it."""

import numpy as np
import pytest
from scipy.special import ndtri

from megalopta.assets_gen import generator
from megalopta.flow.detectors.blocks import block_grid
from megalopta.flow.detectors.registry import METHODS
from megalopta.flow.metrics.translation_bound import (
    bound_photons,
    confined_velocities,
    cramer_rao_covariance,
    fisher_information,
    median_endpoint_error,
    photons_for_half,
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


def test_median_length_pools_blocks_as_draws_of_all_of_them_do():
    roots = (
        np.random.default_rng(2).normal(size=(5, 2, 2))
        * np.array([0.1, 0.5, 1, 2, 5])[:, np.newaxis, np.newaxis]
    )
    draws = np.random.default_rng(3).normal(size=(200_000, 5, 2))
    lengths = np.linalg.norm(np.einsum("kij,nkj->nki", roots, draws), axis=-1)
    # the median of 1e6 lengths: 0.5/√1e6 in probability, five of those are below 1 % in length
    assert median_endpoint_error(roots @ roots.transpose(0, 2, 1)) == pytest.approx(
        np.median(lengths), rel=0.01
    )


def test_negative_means_are_refused():
    with pytest.raises(ValueError, match="negative or non-finite"):
        fisher_information(np.full((72, 72), -1.0), GRID)


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


def test_noise_of_nothing_is_refused():
    with pytest.raises(ValueError, match=r"noise 0: give the variance"):
        unknown_texture_information(np.ones((4, 4)), 0.0, 16)


VELOCITY = [
    pytest.param(detector, id=name)
    for name, detector in METHODS.items()
    if detector.gives == "velocity"
]
GRID = block_grid((72, 72), 24)


@pytest.mark.parametrize("detector", VELOCITY)
def test_nothing_outside_of_a_block_and_its_margin_is_seen(detector):
    rng = np.random.default_rng(0)
    counts = rng.poisson(4, (8, 72, 72)).astype(np.uint16)
    elsewhere = rng.poisson(40, counts.shape).astype(np.uint16)
    elsewhere[:, 17:55, 17:55] = counts[:, 17:55, 17:55]
    velocities = [confined_velocities(detector, each, GRID, 7) for each in (counts, elsewhere)]
    assert velocities[0].shape == (1, 1, 2)
    np.testing.assert_array_equal(*velocities)


def test_search_reaches_to_the_end_of_the_margin_and_no_further():
    image = np.random.default_rng(1).poisson(50, (72, 90)).astype(np.uint16)
    for step, found in ((7, True), (8, False)):
        frames = np.stack([image[:, 10 : 10 + 72], image[:, 10 - step : 10 - step + 72]])
        velocity = confined_velocities(METHODS["BM"], frames, GRID, 7)[0, 0]
        assert np.array_equal(velocity, (step, 0)) == found


@pytest.mark.parametrize("margin", [0, 25])
def test_margin_that_leaves_no_room_is_refused(margin):
    with pytest.raises(ValueError, match=f"margin_px {margin}: give 1 to 24"):
        confined_velocities(METHODS["BM"], np.ones((2, 72, 72)), GRID, margin)


FLUXES = tuple(10 ** np.linspace(3, 7, 13))


@pytest.mark.parametrize("exact", [1.7e3, 5e4, 3.5e5, 4.6e6])
def test_flux_at_which_half_are_good_is_found_with_few_fluxes(exact):
    # One block after the other becomes good, at fluxes of normal logs: the steepest share that a
    # method shows is about this one. Its bend between the fluxes tried is worth 3 %.
    needs = exact * np.exp(ndtri((np.arange(2000) + 0.5) / 2000))
    tried = []

    def is_good(flux):
        tried.append(flux)
        return needs < flux

    needed = photons_for_half(is_good, FLUXES)
    assert needed.photons == pytest.approx(exact, rel=0.03)
    assert needed.low < needed.photons < needed.high
    assert len(set(tried)) == len(tried) <= 6


def test_interval_is_that_of_groups_whose_blocks_are_alike():
    # twenty blocks with one need, in each of forty groups: as if there were forty blocks
    rng = np.random.default_rng(0)
    widths = {}
    for copies in (1, 20):
        found = []
        for _ in range(60):
            needs = 5e4 * np.exp(1.5 * rng.standard_normal((40, 1))) * np.ones(copies)
            found.append(photons_for_half(lambda flux, needs=needs: needs < flux, FLUXES))
        widths[copies] = np.mean([np.log(each.high / each.low) for each in found])
    # a width scatters by 20 %: the mean of sixty by 2.6 %, a quotient by 3.7 %
    assert widths[20] == pytest.approx(widths[1], rel=0.2)


def test_shares_on_one_side_of_half_have_no_crossing():
    for good, flux in ((False, np.inf), (True, 0)):
        found = photons_for_half(lambda _, good=good: np.full(9, good), FLUXES)
        assert found == (flux, flux, flux)


@pytest.mark.parametrize("groups", [3, 8])
def test_95_of_100_intervals_of_few_groups_hold_the_flux(groups):
    """Of textures whose needs differ by a factor of 1.6 (5 σ)."""
    rng, held, runs = np.random.default_rng(0), 0, 200
    for _ in range(runs):
        logs = 0.5 * rng.standard_normal((groups, 1)) + rng.standard_normal((groups, 64))
        needs = 5e4 * np.exp(logs)
        _, low, high = photons_for_half(lambda flux, needs=needs: needs < flux, FLUXES)
        held += low <= 5e4 <= high
    assert held > runs * 0.95 - 5 * np.sqrt(runs * 0.95 * 0.05)


def test_one_group_tells_nothing_about_the_others():
    needs = 5e4 * np.exp(np.random.default_rng(0).standard_normal((1, 64)))
    found = photons_for_half(lambda flux: needs < flux, FLUXES)
    assert found[1:] == (0, np.inf)
    assert found.photons == pytest.approx(5e4, rel=0.5)


def test_bound_of_isotropic_errors_has_its_closed_form():
    covariance = 9.0 * np.eye(2)
    flux = bound_photons(covariance, speed=2.0, level=0.25)
    assert 3 * np.sqrt(2 * np.log(2) / flux) == pytest.approx(0.5)
