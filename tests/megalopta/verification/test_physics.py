"""The checks that users run, as tests; that they notice a wrong model, and what they print."""

import io
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from megalopta.core.errors import UserError
from megalopta.sensor import exposure
from megalopta.sensor.ctia import model as ctia_model, noise as ctia_noise
from megalopta.sensor.effects import bias
from megalopta.sensor.optics import pixels
from megalopta.sensor.optics.lens import falloff
from megalopta.sensor.sampling.streams import generator
from megalopta.verification import physics as check_physics
from megalopta.verification.physics import (
    CASES,
    Row,
    check_case,
    false_alarm,
    law_z,
    two_sample_z,
    worst,
)

QUICK = ("changing-light", "counters", "ctia")
"""Groups that take a second or two; `megalopta check physics` runs all"""
BY_TERM = {case.term: case for group in CASES.values() for case in group}


@pytest.mark.parametrize(
    "case",
    [
        pytest.param(case, id=case.term, marks=[pytest.mark.slow] * (group not in QUICK))
        for group, cases in CASES.items()
        for case in cases
    ],
)
def test_sensors_agree_with_the_plainest_simulation(case):
    row = check_case(case)
    assert row.passed, row


WRONG = [
    (
        pixels,
        "image_irradiance",
        lambda L, lens: np.pi * L / (4 * lens.f_number**2),
        "lens, filter, efficiency",
    ),
    (pixels, "falloff", lambda lens, shape: falloff(lens, (1, shape[1])), "cos⁴ falloff"),
    (bias, "since_measurement", lambda factor, *at: factor(*at), "bias and breakdown, measured"),
    (
        bias,
        "dark_count_factor",
        lambda law, offset, right=bias.dark_count_factor: right(law, -np.asarray(offset)),
        "bias and breakdown, drawn",
    ),
    (exposure, "open_fraction", lambda gate, exposure_s: 3 / 7, "binary frames, gate"),
    (ctia_model, "gain_from_db", lambda decibels: 10 ** (decibels / 10), "CTIA, poor amplifiers"),
    (ctia_noise, "poisson_charge", lambda rng, charge: 0 * charge, "CTIA, electrons"),
    (ctia_noise, "reset_variance", lambda noise, pixel: 0.0, "CTIA, reset and readout"),
    (ctia_model, "drift_rate", lambda bias: 0.0, "CTIA, offsets and a leaking gate"),
]


@pytest.mark.parametrize(
    ("module", "name", "wrong", "term"), WRONG, ids=[name for _, name, *_ in WRONG]
)
def test_a_wrong_law_is_noticed(monkeypatch, module, name, wrong, term):
    monkeypatch.setattr(module, name, wrong)
    few = replace(BY_TERM[term], samples=min(BY_TERM[term].samples, 4000))
    assert not check_case(few).passed


def test_laws_that_share_mean_and_variance_are_told_apart():
    rng = generator(0)
    poisson = rng.poisson(9.0, 50_000)
    normal = np.rint(rng.normal(9.0, np.sqrt(9 - 1 / 12), 50_000)).clip(0).astype(int)
    assert law_z(poisson, rng.poisson(9.0, 50_000)) < 5 < law_z(poisson, normal)
    assert abs(two_sample_z(poisson, normal)[0]) < 5


GOOD, BAD = Row("gate", "counts", 3.0, 3.1, 0.4), Row("jitter", "variance", 1.0, 2.0, 17.0)


@pytest.fixture
def console():
    return Console(file=io.StringIO(), width=140)


@pytest.fixture
def rows_of(monkeypatch):
    """Has every case answered by a row in place of being compared; returns the cases."""

    def answer(row):
        monkeypatch.setattr(check_physics, "check_case", lambda case: seen.append(case) or row)
        return seen

    seen = []
    return answer


@pytest.mark.parametrize("row", [GOOD, BAD])
def test_outcome_and_table_tell_whether_all_passed(console, rows_of, row):
    rows_of(row)
    assert check_physics.run_check_physics(["frames"], console=console) is row.passed
    text, rows = console.file.getvalue(), len(CASES["frames"])
    assert f"{rows} rows, {0 if row.passed else rows} failed" in text
    assert ("NO" in text) is not row.passed


def test_printed_false_alarm_counts_every_comparison_behind_a_row(console, rows_of):
    row = worst([GOOD, worst([GOOD] * 4)])
    rows_of(row)
    check_physics.run_check_physics(["frames"], console=console)
    text = " ".join(console.file.getvalue().split())
    assert f"{5 * len(CASES['frames'])} comparisons" in text
    # two-sided probability of 5 σ from tables
    assert false_alarm([row] * 4) == pytest.approx(20 * 5.733e-7, rel=1e-4)
    assert "at most 1e-05" in text


def test_only_the_groups_asked_for_are_checked(console, rows_of):
    seen = rows_of(GOOD)
    check_physics.run_check_physics(["gate", "crosstalk"], console=console)
    assert sorted(case.term for case in seen) == sorted(
        case.term for case in (*CASES["crosstalk"], *CASES["gate"])
    )
    seen.clear()
    check_physics.run_check_physics(console=console)
    assert len(seen) == len(BY_TERM)


def test_what_cannot_be_checked_is_refused_before_anything_is(console, rows_of):
    seen = rows_of(GOOD)
    with pytest.raises(UserError, match="check physics: no group 'gates'; one of counting, light"):
        check_physics.run_check_physics(["gate", "gates"], console=console)
    assert not seen
