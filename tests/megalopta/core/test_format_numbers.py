"""Format numbers: today's is read, newer and older ones are refused in one sentence."""

import re
from pathlib import Path

import pytest

from megalopta.core.errors import UserError
from megalopta.core.format_numbers import FORMATS, Format, check_format, written


@pytest.mark.parametrize("kind", FORMATS)
def test_what_is_written_today_is_read(kind: str) -> None:
    check_format(kind, {"format": written(kind)}, "file")


def test_a_newer_format_is_refused() -> None:
    with pytest.raises(UserError, match="dataset format 99 is newer than .*; update megalopta"):
        check_format("dataset", {"format": 99}, "file")


def test_an_older_format_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(FORMATS, "dataset", Format(3, 2))  # type: ignore[arg-type]
    with pytest.raises(UserError, match="dataset format 0 is older than 2"):
        check_format("dataset", {}, "file")


@pytest.mark.parametrize("found", ["1", -1, True, 1.0, None, [1]])
def test_what_is_no_number_is_refused(found: object) -> None:
    with pytest.raises(UserError, match="not a format number"):
        check_format("dataset", {"format": found}, "file")


def test_the_table_of_the_documentation_is_that_of_the_program() -> None:
    text = (Path(__file__).parents[3] / "docs/file-formats.md").read_text("utf-8")
    rows = re.findall(r"^\| `(\w+)` \| .* \| (\d+) \| (\d+)(?:–(\d+))? \|$", text, re.MULTILINE)
    told = {name: (int(written), int(oldest)) for name, written, oldest, _ in rows}
    assert told == {name: tuple(each) for name, each in FORMATS.items()}
    assert all(newest in ("", now) for _, now, _, newest in rows)
