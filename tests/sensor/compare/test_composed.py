"""Faults composed at random, on cameras of an own simulation: what is said of them."""

from collections import Counter

import pytest

from . import composed
from .judgment import Recipe
from .own_cameras import CAMERAS


def test_a_composed_fault_is_named_and_an_identical_device_raises_no_alarm(monkeypatch):
    _, levels, dead_s = CAMERAS["bits"]
    monkeypatch.setitem(CAMERAS, "bits", ((24, 24), levels, dead_s))
    assert not composed.compared("bits", (), 0, 3).alarms
    fault = Recipe("bits", "noise of rows")
    assert composed.verdict((fault,), 2, 3)[0] == "right"


@pytest.mark.slow
def test_identical_devices_raise_no_alarm():
    alarms = sum(
        bool(composed.compared(list(CAMERAS)[seed % 3], (), 0, seed).alarms) for seed in range(9)
    )
    # at the stated 1 %, 4 or more of 9 have a chance of 1.2e-6, 5 or more of 1.2e-8
    assert alarms < 5


@pytest.mark.slow
def test_composed_faults_are_named_or_left_unexplained():
    outcomes = Counter(
        composed.verdict((composed.compose(seed, reserved=False),), seed % 3, seed)[0]
        for seed in range(16)
    )
    # at 95 % right or none, 8 or fewer of 16 have a chance below 1e-6; at 2 % wrong, 6 or more
    assert outcomes["right"] + outcomes["none"] > 8, outcomes
    assert outcomes["wrong"] < 6, outcomes
