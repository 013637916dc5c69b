import io

import pytest
from rich.console import Console

from megalopta.core.errors import UserError
from megalopta.verification import physics as check_physics
from megalopta.verification.cases import CHECKS
from megalopta.verification.comparison import Row, worst

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


def test_pictures_are_written_where_asked(console, monkeypatch, tmp_path):
    monkeypatch.setattr(check_physics, "run_checks", lambda checks: [GOOD])
    monkeypatch.setattr(check_physics, "EXPOSURES_OF_A_PICTURE", 1000)
    check_physics.run_check_physics((), tmp_path / "plots", console)
    names = sorted(path.name for path in (tmp_path / "plots").iterdir())
    assert names == ["counts_ideal.png", "counts_nonparalyzable.png", "counts_paralyzable.png"]


def test_only_the_groups_asked_for_are_checked(console, monkeypatch):
    seen = []
    monkeypatch.setattr(check_physics, "run_checks", lambda checks: seen.extend(checks) or [GOOD])
    check_physics.run_check_physics(["gate", "crosstalk"], console=console)
    assert seen == [*CHECKS["crosstalk"], *CHECKS["gate"]]
    seen.clear()
    check_physics.run_check_physics(console=console)
    assert seen == [check for group in CHECKS.values() for check in group]


def test_a_name_that_is_no_group_is_refused_with_those_that_are(console, monkeypatch):
    monkeypatch.setattr(check_physics, "run_checks", lambda checks: pytest.fail("checked"))
    with pytest.raises(UserError, match="check physics: no group 'gates'; one of counting, light"):
        check_physics.run_check_physics(["gate", "gates"], console=console)
