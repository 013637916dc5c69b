"""The checks that users run, as tests, and that they notice a wrong model.

Rows are compared at |z| < 5: a right program fails one with probability 6e-7, with fixed streams
always or never.
"""

from functools import partial

import numpy as np
import pytest

from megalopta.sensor.ctia import (
    calibration as ctia_calibration,
    integration as ctia_integration,
    model as ctia_model,
    noise as ctia_noise,
)
from megalopta.sensor.effects import bias
from megalopta.sensor.optics import falloff, pixels
from megalopta.sensor.readout import binary
from megalopta.sensor.sampling import generator
from megalopta.sensor.selfcheck import (
    combinations,
    counting as check_counting,
    ctia_bias as check_ctia_bias,
)
from megalopta.sensor.selfcheck.all import EFFECT_CHECKS
from megalopta.sensor.selfcheck.binary import check_gated_bits
from megalopta.sensor.selfcheck.combinations import (
    check_combinations,
    check_maps,
    check_running_frames,
)
from megalopta.sensor.selfcheck.comparison import (
    Row,
    exact_row,
    false_alarm,
    law_z,
    mean_row,
    two_sample_z,
)
from megalopta.sensor.selfcheck.counting import counting_checks, effects_of, samples
from megalopta.sensor.selfcheck.ctia import check_ctia_discharge, check_ctia_noise
from megalopta.sensor.selfcheck.ctia_bias import check_gate_leak, check_pulse_loop, check_trimming
from megalopta.sensor.selfcheck.distances import GRID, Point, compare, measure
from megalopta.sensor.selfcheck.measured import check_measured_maps
from megalopta.sensor.selfcheck.optics import check_falloff, check_lens

pytestmark = pytest.mark.slow

COUNTING = counting_checks(arrivals=1e5)


def name_of(check):
    return check.args[0] if isinstance(check, partial) else check.__name__


def is_dear(name):
    return (
        name.startswith("paralyzable") and name != "paralyzable dead time, live start, afterpulsing"
    )


FRAME_BY_FRAME = (check_combinations, check_maps, check_running_frames)
"""Frames are drawn one by one, so that their number is what these cost."""

DEAR = {
    "check_afterpulsing", "check_crosstalk", "check_dead_time_ends", "check_delays", "check_frames",
    "check_parts", "reading, analog, uneven, uncalibrated", "array-12x4",
    # tables of moments that are simulated first, as in tests/sensor/avalanches/test_moments.py
    "reading, afterpulsing, gate", "reading, afterpulsing, table",
    "reading, crosstalk, afterpulsing, gate", "reading, non-paralyzable dead time, afterpulsing",
}  # fmt: skip
"""Of more than a second, for laws that tests of the same effects hold with fewer draws"""


@pytest.mark.parametrize(
    "check",
    [
        pytest.param(
            check,
            marks=[pytest.mark.slow] if check in FRAME_BY_FRAME or name_of(check) in DEAR else [],
        )
        for check in EFFECT_CHECKS
    ],
    ids=name_of,
)
def test_effects_agree_with_theory(check):
    assert [row for row in check() if not row.passed] == []


@pytest.mark.parametrize("check", FRAME_BY_FRAME, ids=name_of)
def test_combinations_agree_with_brute_force_on_fewer_frames(monkeypatch, check):
    monkeypatch.setattr(combinations, "FRAMES", 500)
    # a table takes many seconds; those of tests/sensor/avalanches/test_moments.py stand for it
    monkeypatch.setattr(combinations, "TABULATED", "none")
    assert [row for row in check() if not row.passed] == []


@pytest.mark.parametrize(
    "check",
    [
        # paralyzable pixels take three times as long; one case of them is enough to begin with
        pytest.param(check, marks=[pytest.mark.slow] if is_dear(name_of(check)) else [])
        for check in COUNTING
    ],
    ids=name_of,
)
def test_counts_agree_with_brute_force_in_mean_variance_and_law(check):
    assert [row for row in check() if not row.passed] == []


@pytest.mark.parametrize(
    "point",
    [
        *(
            # these cost most, and counts_agree_with_brute_force has them at 12 points
            pytest.param(point, marks=pytest.mark.slow)
            if point.has_afterpulsing or point.start == "stationary"
            else point
            for point in GRID
            if (point.rate_times_dead_time, point.mean_counts) == (0.1, 1)
        ),
        pytest.param(Point("nonparalyzable", "live", False, 1.0, 30), marks=pytest.mark.slow),
        pytest.param(Point("paralyzable", "live", True, 1.0, 30), marks=pytest.mark.slow),
    ],
    ids=str,
)
def test_law_is_within_three_thousandths_of_brute_force(point):
    # points of the grid where a million exposures or little more do: the chance level is 0.8e-3 to
    # 2.3e-3, the standard error 3e-4 or less
    assert point.exposures >= 1_000_000
    distance = measure(point)
    assert distance.measured < 3e-3
    assert abs(distance.mean_z) < 5
    assert abs(distance.variance_z) < 5


def test_chance_level_is_the_distance_of_samples_of_one_law():
    rng = generator(0)
    histograms = [np.bincount(rng.poisson(30.0, 100_000)) for _ in range(200)]
    pairs = list(zip(histograms[::2], histograms[1::2], strict=True))
    distances = [compare(first, second) for first, second in pairs]
    measured = np.array([each.measured for each in distances])
    error = measured.std() / len(pairs) ** 0.5
    # the normal law for rare counts makes it high by up to 2 %
    assert measured.mean() == pytest.approx(distances[0].by_chance, rel=0.02, abs=5 * error)
    assert measured.std() == pytest.approx(distances[0].error, rel=0.3)


WRONG = [
    (pixels, "image_irradiance", lambda L, lens: np.pi * L / (4 * lens.f_number**2), check_lens),
    (pixels, "falloff", lambda lens, shape: falloff(lens, (1, shape[1])), check_falloff),
    (bias, "since_measurement", lambda factor, *at: factor(*at), check_measured_maps),
    (binary, "open_fraction", lambda gate, exposure_s: 3 / 7, check_gated_bits),
    (ctia_integration, "STEPS", 4, check_ctia_discharge),
    (ctia_noise, "poisson_charge", lambda rng, charge: 0 * charge, check_ctia_noise),
    (ctia_noise, "reset_variance", lambda noise, pixel: 0.0, check_ctia_noise),
    (check_ctia_bias, "trimmed_bias", lambda b, v: np.mod(v, b.step_v), check_trimming),
    (ctia_calibration, "WORTHWHILE", 0.9, check_pulse_loop),
    (ctia_model, "drift_rate", lambda bias: 0.0, check_gate_leak),
]


@pytest.mark.parametrize(
    ("module", "name", "wrong", "check"), WRONG, ids=[name for _, name, *_ in WRONG]
)
def test_a_wrong_law_is_noticed(monkeypatch, module, name, wrong, check):
    monkeypatch.setattr(module, name, wrong)
    assert not all(row.passed for row in check())


def test_a_dead_time_one_percent_too_long_is_noticed():
    right = effects_of("nonparalyzable", "live", check_counting.AFTERPULSING)
    longer = right.dead_time.model_copy(update={"dead_time_s": 1.01e-6})
    plain, _ = samples(right, 1e6, 60e-6, 100_000)
    _, wrong = samples(right.model_copy(update={"dead_time": longer}), 1e6, 60e-6, 100_000)
    assert abs(two_sample_z(plain, wrong)[0]) > 5


def test_laws_that_share_mean_and_variance_are_told_apart():
    rng = generator(0)
    poisson = rng.poisson(9.0, 50_000)
    normal = np.rint(rng.normal(9.0, np.sqrt(9 - 1 / 12), 50_000)).clip(0).astype(int)
    assert law_z(poisson, rng.poisson(9.0, 50_000)) < 5 < law_z(poisson, normal)


def test_worst_row_of_a_check_stands_for_its_twelve_points():
    assert [row.comparisons for row in COUNTING[0]()] == [12, 12, 12]


def test_false_alarm_adds_up_five_sigma_of_every_comparison():
    rows = [Row("x", "y", 0.0, 0.0, 0.0, comparisons) for comparisons in (1, 12, 27)]
    # two-sided probability of 5 σ from tables
    assert false_alarm(rows) == pytest.approx(40 * 5.733e-7, rel=1e-4)


def test_constant_samples_pass_only_where_they_are_right():
    assert mean_row("x", "y", 2.0, np.full(10, 2)).passed
    assert not mean_row("x", "y", 2.0, np.full(10, 3)).passed
    assert not exact_row("x", "y", 1.0, 1.1, 0.05).passed
