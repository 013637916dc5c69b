import numpy as np
import pytest

from megalopta.reproduction.chapter3_pixel import bias_error
from megalopta.reproduction.drawing import names
from megalopta.sensor.ctia.model import PHOTODIODES
from megalopta.sensor.ctia.photodiode import Photodiode, reverse_current

from ..figures import canvas_of, made


def column(name, index):
    return np.array([row[index] for row in made(name).rows])


@pytest.mark.parametrize("name", names("chapter-3"))
def test_figure_draws_labeled_axes_that_are_not_empty(name):
    for axes in canvas_of(made(name)).axes:
        assert axes.lines or axes.texts
        assert name.startswith("table") or (axes.get_xlabel() and axes.get_ylabel())


def test_motion_of_the_input_is_the_swing_over_the_gain_as_printed():
    printed = made("fig-3.2").printed
    # 3.3 V over 100 and over 100 000
    assert printed["Motion of the input at 40 dB"] == ("33 mV", "33 mV")
    assert printed["Motion of the input at 100 dB"] == ("33 µV", "33 µV")


def test_discharge_at_high_gain_is_straight_and_at_low_gain_is_not():
    times, low, high = column("fig-3.2", 0), column("fig-3.2", 1), column("fig-3.2", 6)

    def bend(output):
        inside = output > 0.3
        line = np.polyval(np.polyfit(times[inside], output[inside], 1), times[inside])
        return np.abs(output[inside] - line).max()

    # at 90 dB the bias moves by a tenth, which bends the line by less than a hundredth of the swing
    assert bend(high) < 0.033 < 0.2 < bend(low)


def test_initial_slope_is_the_dark_current_at_1_mv_at_every_gain():
    slope = reverse_current(Photodiode(saturation_current_a=100e-12), 1e-3) / 100e-15
    steps = [column("fig-3.2", index)[:2] for index in range(1, 7)]
    for first, second in steps[3:]:
        assert (first - second) / 0.5e-3 == pytest.approx(slope, rel=0.01)


@pytest.mark.parametrize(("diode", "rise_db"), [("si", 30.0), ("ingaas_quiet", 40.0)])
def test_bias_error_gives_the_rise_it_was_asked_for(diode, rise_db):
    error = bias_error(PHOTODIODES[diode], rise_db)
    near, far = (reverse_current(PHOTODIODES[diode], read - error) for read in (1e-3, 20e-3))
    assert 20 * np.log10(far / near) == pytest.approx(rise_db, abs=1e-6)


def test_table_orders_the_states_as_the_dissertation_does_for_the_adaptive_pixel():
    states = column("table-3.1", 0)
    poor, fine = (list(states).index(f"Adaptive ({state})") for state in ("poor", "fine"))
    for printed, ours in ((1, 2), (3, 4)):
        assert column("table-3.1", printed)[fine] < column("table-3.1", printed)[poor] / 10
        assert column("table-3.1", ours)[fine] < column("table-3.1", ours)[poor] / 10
