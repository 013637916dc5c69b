"""Figure "night-bands": contrast and information of pictures that are known."""

import numpy as np
import pytest

from megalopta.reproduction.comparison_night_bands import (
    BLOCK_PX,
    FLOOR_BANDS_NM,
    contrast,
    seen_by,
)
from megalopta.sensor import IMAGE_SENSORS, expectation

BANDS = len(FLOOR_BANDS_NM)


def ramp(rise, size=64):
    """Light that rises and falls by a share of the mean from column to column, alike in bands."""
    row = 1 + rise * (np.arange(size) % 2 - 0.5)
    return np.broadcast_to(row[None, :, None] * 1e-9, (size, size, BANDS)).astype(np.float32)


def test_contrast_is_that_without_the_noise_of_the_renderings():
    rng = np.random.default_rng(0)
    noisy = [ramp(0.3) * (1 + 0.5 * rng.normal(size=(64, 64, BANDS))) for _ in range(2)]
    found, error = contrast(*noisy)
    # Products of differences, each 0.3 with a variance of 2·0.5²: 0.5² + 2·0.3²·0.5, and half as
    # much again since neighbors share a pixel. 64 rows know their scatter to 9 %.
    np.testing.assert_allclose(error, (1.5 * 0.34) ** 0.5 / 63.5 / (2 * 0.3), rtol=0.5)
    assert (np.abs(found - 0.3) < 6 * error).all()  # 13 bands: a false alarm in 4e7 runs


def test_an_ideal_array_is_as_good_as_poisson_counts_allow():
    sensor = IMAGE_SENSORS["ideal"]
    light = ramp(0.2)
    seen = seen_by((light, light), sensor)
    photons = expectation(light[None].astype(float), FLOOR_BANDS_NM, sensor).photons[0]
    slope, mean = 0.2 * photons.mean(), photons[:, 1:].mean()
    # Two frames: every pixel tells slope²/(2·mean); columns of both kinds, half and half.
    pairs = (1 / photons[0, 1:]).mean()
    assert seen.error_px == pytest.approx((slope**2 * pairs / 2 * BLOCK_PX**2) ** -0.5, rel=1e-3)
    assert seen.dark == 0
    assert seen.events.sum() == pytest.approx(photons.mean(), rel=1e-6)
    assert mean == pytest.approx(photons.mean(), rel=0.01)


def test_a_device_is_blind_beyond_its_curve():
    seen = seen_by((ramp(0.2), ramp(0.2)), IMAGE_SENSORS["ctia_ingaas_quiet"])
    blind = np.array([high <= 850 for _, high in FLOOR_BANDS_NM])
    assert (seen.events[blind] == 0).all()
    assert (seen.events[-7:] > 0).all()
