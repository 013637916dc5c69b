"""The checks that users run, as tests; that they notice a wrong model, and what they print."""

import io
from functools import partial

import numpy as np
import pytest
from rich.console import Console

from megalopta.core.errors import UserError
from megalopta.sensor import exposure
from megalopta.sensor.ctia import (
    integration as ctia_integration,
    model as ctia_model,
    noise as ctia_noise,
)
from megalopta.sensor.effects import bias
from megalopta.sensor.optics import pixels
from megalopta.sensor.optics.lens import falloff
from megalopta.sensor.sampling.streams import generator
from megalopta.verification import physics as check_physics
from megalopta.verification.cases import CHECKS, Case
from megalopta.verification.comparison import Row, false_alarm, law_z, two_sample_z, worst
from megalopta.verification.theory import (
    check_ctia_noise,
    check_discharge,
    check_falloff,
    check_gate_leak,
    check_lens,
)

QUICK = ("changing-light", "light", "ctia")
"""Groups that take a second or two; `megalopta check physics` runs all"""


def name_of(check):
    if not isinstance(check, partial):
        return check.__name__
    return check.args[0].term if isinstance(check.args[0], Case) else check.args[0]


@pytest.mark.parametrize(
    "check",
    [
        pytest.param(check, id=name_of(check), marks=[pytest.mark.slow] * (group not in QUICK))
        for group, checks in CHECKS.items()
        for check in checks
    ],
)
def test_sensors_agree_with_theory_and_with_brute_force(check):
    row = check()
    assert row.passed, row


def case(group, term):
    return next(check for check in CHECKS[group] if name_of(check) == term)


WRONG = [
    (pixels, "image_irradiance", lambda L, lens: np.pi * L / (4 * lens.f_number**2), check_lens),
    (pixels, "falloff", lambda lens, shape: falloff(lens, (1, shape[1])), check_falloff),
    (
        bias,
        "since_measurement",
        lambda factor, *at: factor(*at),
        case("device", "bias and breakdown, measured"),
    ),
    (
        bias,
        "dark_count_factor",
        lambda law, offset, right=bias.dark_count_factor: right(law, -np.asarray(offset)),
        case("device", "bias and breakdown, drawn"),
    ),
    (
        exposure,
        "open_fraction",
        lambda gate, exposure_s: 3 / 7,
        case("gate", "binary frames, gate"),
    ),
    (ctia_integration, "STEPS", 4, check_discharge),
    (ctia_noise, "poisson_charge", lambda rng, charge: 0 * charge, check_ctia_noise),
    (ctia_noise, "reset_variance", lambda noise, pixel: 0.0, check_ctia_noise),
    (ctia_model, "drift_rate", lambda bias: 0.0, check_gate_leak),
]


@pytest.mark.parametrize(
    ("module", "name", "wrong", "check"), WRONG, ids=[name for _, name, *_ in WRONG]
)
def test_a_wrong_law_is_noticed(monkeypatch, module, name, wrong, check):
    monkeypatch.setattr(module, name, wrong)
    assert not check().passed


def test_laws_that_share_mean_and_variance_are_told_apart():
    rng = generator(0)
    poisson = rng.poisson(9.0, 50_000)
    normal = np.rint(rng.normal(9.0, np.sqrt(9 - 1 / 12), 50_000)).clip(0).astype(int)
    assert law_z(poisson, rng.poisson(9.0, 50_000)) < 5 < law_z(poisson, normal)
    assert abs(two_sample_z(poisson, normal)[0]) < 5


def test_false_alarm_adds_up_five_sigma_of_every_comparison():
    rows = [Row("x", "y", 0.0, 0.0, 0.0, comparisons) for comparisons in (1, 12, 27)]
    # two-sided probability of 5 σ from tables
    assert false_alarm(rows) == pytest.approx(40 * 5.733e-7, rel=1e-4)


GOOD, BAD = Row("gate", "counts", 3.0, 3.1, 0.4), Row("jitter", "variance", 1.0, 2.0, 17.0)


@pytest.fixture
def console():
    return Console(file=io.StringIO(), width=140)


@pytest.mark.parametrize(("rows", "verdict"), [([GOOD], True), ([GOOD, BAD], False)])
def test_outcome_and_table_tell_whether_all_passed(console, monkeypatch, rows, verdict):
    monkeypatch.setattr(check_physics, "run_checks", lambda checks: rows)
    assert check_physics.run_check_physics(console=console) is verdict
    text = console.file.getvalue()
    assert f"{len(rows)} rows, {len(rows) - 1} failed" in text
    assert ("NO" in text) is not verdict


def test_printed_false_alarm_counts_every_comparison_behind_a_row(console, monkeypatch):
    rows = [GOOD, worst([GOOD] * 12), worst([GOOD, worst([GOOD] * 4)])]
    monkeypatch.setattr(check_physics, "run_checks", lambda checks: rows)
    check_physics.run_check_physics(console=console)
    text = console.file.getvalue()
    assert "3 rows, 0 failed" in text
    assert "18 comparisons" in text
    # 18 times P(|z| >= 5) = 5.733e-7
    assert "at most 1e-05" in " ".join(text.split())


def test_only_the_groups_asked_for_are_checked(console, monkeypatch):
    seen = []
    monkeypatch.setattr(check_physics, "run_checks", lambda checks: seen.extend(checks) or [GOOD])
    check_physics.run_check_physics(["gate", "crosstalk"], console=console)
    assert seen == [*CHECKS["crosstalk"], *CHECKS["gate"]]
    seen.clear()
    check_physics.run_check_physics(console=console)
    assert seen == [check for group in CHECKS.values() for check in group]


def test_what_cannot_be_checked_is_refused_before_anything_is(console, monkeypatch):
    monkeypatch.setattr(check_physics, "run_checks", lambda checks: pytest.fail("checked"))
    with pytest.raises(UserError, match="check physics: no group 'gates'; one of counting, light"):
        check_physics.run_check_physics(["gate", "gates"], console=console)
