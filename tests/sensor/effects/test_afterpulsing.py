import pytest

from megalopta.sensor.effects.afterpulsing import Afterpulsing


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"mean_carriers": 1.0}, "mean_carriers"),
        ({"delay_s": 0.0}, "delay_s"),
        ({"table_delays_s": (0, 1)}, "one fraction per delay"),
        ({"table_delays_s": (0, 1), "table_cumulative": (0, 0.9)}, "from 0 to 1"),
        ({"table_delays_s": (1, 0), "table_cumulative": (0, 1)}, "must increase"),
    ],
)
def test_impossible_traps_are_refused(wrong, message):
    with pytest.raises(ValueError, match=message):
        Afterpulsing(**wrong)
