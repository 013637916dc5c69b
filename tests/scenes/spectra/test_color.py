import mitsuba
import numpy as np
import pytest
from scipy.optimize import nnls

from megalopta.scenes.spectra.color import BLUE, GREEN, KNOWN_NM, RED, reflectance_of_color
from megalopta.scenes.spectra.spectrum import SPECTRA

GRID = np.arange(KNOWN_NM[0], KNOWN_NM[1] + 1, 1.0)
D65 = SPECTRA["D65"](GRID)
XYZ_OF_SRGB = np.array(
    [
        [0.4124564, 0.3575761, 0.1804375],
        [0.2126729, 0.7151522, 0.0721750],
        [0.0193339, 0.1191920, 0.9503041],
    ]
)


@pytest.fixture(scope="module")
def observer():
    """CIE 1931 standard observer (wavelengths, 3), from Mitsuba's tables."""
    mitsuba.set_variant("scalar_spectral")
    return np.array([np.ravel(mitsuba.cie1931_xyz(float(each))) for each in GRID], np.float64)


def seen(reflectance, observer):
    """Color (..., 3) of a reflectance (..., wavelengths) in D65, in linear sRGB; of white, 1."""
    xyz = (reflectance * D65) @ observer / (D65 @ observer) * XYZ_OF_SRGB.sum(axis=1)
    return xyz @ np.linalg.inv(XYZ_OF_SRGB).T


@pytest.mark.parametrize("color", [*np.eye(3), *np.random.default_rng(1).random((20, 3))])
def test_a_color_has_a_reflectance_that_looks_like_it_in_daylight(color, observer):
    reflectance = reflectance_of_color(color)(GRID)
    assert reflectance.min() >= 0 and reflectance.max() <= 1 + 1e-9
    # Tables have four digits; the inverse of the matrix multiplies their rounding by up to 3.
    np.testing.assert_allclose(seen(reflectance, observer), color, atol=3e-4)


def test_red_green_and_blue_add_up_to_a_perfect_white():
    np.testing.assert_allclose(RED(GRID) + GREEN(GRID) + BLUE(GRID), 1, atol=1e-9)


def test_the_primaries_are_the_smoothest_with_their_colors(observer):
    knots = np.linspace(*KNOWN_NM, 48)
    n = len(knots)
    tents = np.array([np.interp(GRID, knots, row) for row in np.eye(n)])
    colors = seen(tents, observer)
    heavy = 1e4  # of conditions, in the least squares of the steps
    rows = np.concatenate(
        [
            np.kron(np.eye(3), np.diff(np.eye(n), axis=0)),
            heavy * np.kron(np.eye(3), colors.T),
            heavy * np.tile(np.eye(n), 3),
        ]
    )
    wanted = np.concatenate([np.zeros(3 * (n - 1)), heavy * np.eye(3).ravel(), np.full(n, heavy)])
    best = nnls(rows, wanted, maxiter=10_000)[0].reshape(3, n)
    for found, expected in zip((RED, GREEN, BLUE), best, strict=True):
        np.testing.assert_allclose(found(knots), expected, atol=2e-3)
