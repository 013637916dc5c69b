import numpy as np
import pytest

from megalopta.sensor.effects.afterpulsing import Afterpulsing, draw_carriers, draw_delay
from megalopta.sensor.sampling.streams import generator


@pytest.mark.slow
def test_number_of_carriers_is_poisson():
    rng = generator(0)
    draws = np.array([draw_carriers(rng, 0.7) for _ in range(100_000)])
    assert abs(draws.mean() - 0.7) < 5 * np.sqrt(0.7 / draws.size)  # false alarm 6e-7
    assert np.mean(draws == 0) == pytest.approx(np.exp(-0.7), abs=5 * 0.5 / np.sqrt(draws.size))


@pytest.mark.slow
def test_tabulated_delay_has_the_tabulated_distribution():
    delays, cumulative = np.array([0.0, 1.0, 5.0]), np.array([0.0, 0.8, 1.0])
    rng = generator(1)
    draws = np.array([draw_delay(rng, 1.0, delays, cumulative) for _ in range(100_000)])
    for time, share in ((0.5, 0.4), (1.0, 0.8), (3.0, 0.9)):
        # 5 standard errors: false alarm 6e-7
        assert np.mean(draws < time) == pytest.approx(share, abs=5 * 0.5 / np.sqrt(draws.size))


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
