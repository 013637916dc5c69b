import numpy as np
import pytest

from megalopta.sensor.ctia.bias import (
    DacBias,
    FixedBias,
    FloatingGateBias,
    drift_rate,
    trimmed_bias,
)

OFFSETS = np.random.default_rng(0).normal(18.7e-3, 10e-3, 5000)


@pytest.mark.parametrize("bias", [DacBias(), DacBias(target_v=2e-3), FloatingGateBias()])
def test_trimmed_bias_is_spread_evenly_over_one_step_above_the_target(bias):
    left = (trimmed_bias(bias, OFFSETS) - bias.target_v) / bias.step_v
    assert np.all((left >= -1e-9) & (left < 1 + 1e-9))
    # mean of 5000 uniforms: |z| < 5, false alarm 6e-7
    assert abs(left.mean() - 0.5) < 5 * np.sqrt(1 / 12 / left.size)


def test_floating_gate_is_where_pulses_one_by_one_leave_it():
    gate = FloatingGateBias(erased_v=20e-3, target_v=2e-3)
    left = trimmed_bias(gate, OFFSETS)
    expected = OFFSETS + gate.erased_v
    for _ in range(200):
        expected -= gate.step_v * (expected - gate.step_v >= gate.target_v)
    np.testing.assert_allclose(left, expected, atol=1e-12)
    assert np.any(left < gate.target_v)


def test_leak_takes_back_a_millivolt_in_1000_s_and_a_degree_another():
    gate = FloatingGateBias()
    aged = FloatingGateBias(age_s=1000, warming_k=-1)
    np.testing.assert_allclose(
        trimmed_bias(aged, OFFSETS) - trimmed_bias(gate, OFFSETS), 1.5e-3 - 1e-3, atol=1e-15
    )


def test_what_no_bias_can_do_is_refused():
    with pytest.raises(ValueError, match="cannot be compensated"):
        trimmed_bias(DacBias(), 2.0)


def test_fixed_bias_keeps_the_offsets_and_only_the_gate_drifts():
    np.testing.assert_array_equal(trimmed_bias(FixedBias(reverse_bias_v=1.0), OFFSETS), OFFSETS + 1)
    assert [drift_rate(b) for b in (FixedBias(), DacBias(), FloatingGateBias())] == [0, 0, 1.5e-6]
