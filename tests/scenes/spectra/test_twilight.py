import math

import numpy as np
import pytest

from megalopta.scenes.spectra.night_sky import AIRGLOW
from megalopta.scenes.spectra.photometry import luminous
from megalopta.scenes.spectra.sunlight import TWILIGHT


def test_sky_of_that_brightness_gives_a_lux():
    assert math.pi * luminous(TWILIGHT) == pytest.approx(1.0, rel=0.1)


@pytest.mark.parametrize(("band", "depression_deg"), [((1170, 1330), 9.3), ((1510, 1790), 7.4)])
def test_night_begins_in_the_infrared_when_it_was_seen_to(band, depression_deg):
    """It falls by a factor of four per degree; 1 to 20 % of airglow are when one sees night."""
    grid = np.arange(*band)
    now = TWILIGHT(grid).mean() / AIRGLOW(grid).mean()
    assert 0.01 < now * 4 ** -(depression_deg - 6.4) < 0.2
