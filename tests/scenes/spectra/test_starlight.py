import math

import numpy as np
import pytest

from megalopta.scenes.spectra.night_sky import AIRGLOW, S10, STARLIGHT, ZODIACAL_S10
from megalopta.scenes.spectra.photometry import luminous


def test_unit_is_a_star_of_tenth_magnitude_per_square_degree():
    # V: 3.631e-8 W·m⁻²·µm⁻¹ at magnitude 0 (Bessell et al. 1998), here per nm
    assert 3.631e-11 * 1e-4 / math.radians(1) ** 2 == pytest.approx(S10, rel=2e-3)


def test_zodiacal_light_is_the_mean_of_its_latitudes():
    # Benn and Ellison (1998) over the sphere
    latitude = np.radians(np.linspace(0, 90, 9001))
    brightness = np.where(latitude < np.pi / 3, 140 - 90 * np.sin(latitude), 60)
    mean = np.trapezoid(brightness * np.cos(latitude), latitude)
    assert mean == pytest.approx(ZODIACAL_S10, rel=0.01)


def test_stars_and_airglow_make_a_moonless_night_of_a_millilux():
    # 1 mlux is the usual value for a starry sky; parts from five papers, each good to some 20 %
    lux = math.pi * (luminous(STARLIGHT) + luminous(AIRGLOW))
    assert lux == pytest.approx(1e-3, rel=0.15)


def test_airglow_is_far_stronger_in_the_short_wave_infrared():
    grid = np.arange(1450, 1700)
    assert AIRGLOW(grid).mean() > 20 * STARLIGHT(grid).mean()
