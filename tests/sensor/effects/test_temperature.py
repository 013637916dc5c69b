import pytest

from megalopta.sensor.effects.temperature import Temperature, dark_count_factor


def test_dark_counts_double_every_doubling_interval():
    assert dark_count_factor(Temperature()) == 1
    assert dark_count_factor(Temperature(celsius=38, dcr_doubling_k=9)) == pytest.approx(4)


def test_cooling_by_30_to_40_kelvin_gains_one_to_two_decades():
    # dissertation §2.3.1
    for kelvin in (30, 40):
        factor = dark_count_factor(Temperature(celsius=20 - kelvin))
        assert 0.01 < factor < 0.1


def test_temperature_below_absolute_zero_is_refused():
    with pytest.raises(ValueError, match="celsius"):
        Temperature(celsius=-300)


def test_temperature_at_which_no_chip_works_is_refused():
    with pytest.raises(ValueError, match="celsius"):
        Temperature(celsius=1e5)
