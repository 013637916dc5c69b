import pytest

from megalopta.sensor.effects.temperature import Temperature, dark_count_factor


def test_dark_counts_double_every_doubling_interval():
    assert dark_count_factor(Temperature()) == 1
    assert dark_count_factor(Temperature(celsius=38, dcr_doubling_k=9)) == pytest.approx(4)


@pytest.mark.parametrize("celsius", [-300, 1e5])
def test_temperature_at_which_no_chip_works_is_refused(celsius):
    with pytest.raises(ValueError, match="celsius"):
        Temperature(celsius=celsius)
