import numpy as np
import pytest

from megalopta.sensor.change import changed
from megalopta.sensor.effects import bias
from megalopta.sensor.spad.presets import preset

SPADCAM = preset("spadcam").bias
OFFSETS = np.linspace(-0.15, 0.15, 31)


def at(excess_v):
    return changed(SPADCAM, excess_v=excess_v)


@pytest.mark.parametrize("factor", [bias.efficiency_factor, bias.dark_count_factor])
def test_factor_since_a_measurement_leads_from_the_reference_to_this_bias(factor):
    raised = at(SPADCAM.excess_v + 0.1)
    np.testing.assert_allclose(
        factor(SPADCAM, OFFSETS) * bias.since_measurement(factor, raised, OFFSETS),
        factor(raised, OFFSETS),
        rtol=1e-12,
    )
    assert np.all(bias.since_measurement(factor, SPADCAM, [*OFFSETS, 1.0]) == 1)


def test_best_bias_is_where_the_ratio_peaks():
    volts = SPADCAM.onset_v + np.linspace(0.001, 0.5, 4000)
    ratio = [
        float(bias.efficiency_factor(at(v), 0.0) / bias.dark_count_factor(at(v), 0.0))
        for v in volts
    ]
    assert bias.best_excess_bias(SPADCAM) == pytest.approx(volts[np.argmax(ratio)], abs=2e-4)


def test_breakdown_voltages_have_the_spread_stated():
    large = bias.breakdown_offset(SPADCAM, (80, 100), 3)
    # 8000 pixels know the spread to 0.8 %
    assert large.std() == pytest.approx(0.042, rel=0.04)
    assert abs(large.mean()) < 5 * 0.042 / np.sqrt(large.size)


def test_efficiency_starts_at_the_onset_and_saturates_and_dark_counts_do_not():
    below = at(SPADCAM.onset_v - 0.01)
    assert bias.efficiency_factor(below, 0.0) == bias.dark_count_factor(below, 0.0) == 0
    at_reference = 1 - np.exp(-(SPADCAM.reference_v - SPADCAM.onset_v) / SPADCAM.efficiency_scale_v)
    assert bias.efficiency_factor(at(20.0), 0.0) == pytest.approx(1 / at_reference)
    assert bias.dark_count_factor(at(SPADCAM.excess_v + 0.12), 0.0) == pytest.approx(np.e)


def test_dark_counts_double_every_doubling_interval():
    assert bias.Temperature(celsius=38, dcr_doubling_k=9).dark_count_factor == pytest.approx(4)
