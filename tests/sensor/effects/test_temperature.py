import numpy as np
import pytest

from megalopta.sensor.effects.base import PixelRates
from megalopta.sensor.effects.bias import Temperature


def test_dark_counts_double_every_doubling_interval():
    rates = PixelRates((1, 1), 0, 1e-12, np.ones((1, 1)), np.full((1, 1), 3.0))
    Temperature(celsius=38, dcr_doubling_k=9).act_on_rates(rates)
    assert rates.dark_counts_hz[0, 0] == pytest.approx(12)


@pytest.mark.parametrize("celsius", [-300, 1e5])
def test_temperature_at_which_no_chip_works_is_refused(celsius):
    with pytest.raises(ValueError, match="celsius"):
        Temperature(celsius=celsius)
