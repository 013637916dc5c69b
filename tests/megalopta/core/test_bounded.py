"""Only regular files are read, and only so far."""

from pathlib import Path

import pytest

from megalopta.core.bounded import (
    check_file,
    cut,
    printable,
    quoted,
    read_bytes,
    read_text,
    sentence,
)
from megalopta.core.errors import UserError


def test_a_file_within_its_bound_is_read(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("ä", encoding="utf-8")
    assert read_text(tmp_path / "a", 2) == "ä"


def test_a_larger_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"123")
    for read in (read_bytes, check_file):
        with pytest.raises(UserError, match="larger than"):
            read(tmp_path / "a", 2)


@pytest.mark.parametrize("device", ["/dev/zero", "/dev/urandom"])
def test_devices_are_refused(device: str) -> None:
    with pytest.raises(UserError, match="not a regular file"):
        read_bytes(device)


def test_messages_quote_no_more_than_their_limit() -> None:
    assert quoted("a" * 300) == "a" * 200 + "…"
    assert quoted([1, 2]) == "[1, 2]"


def test_control_codes_do_not_reach_a_terminal() -> None:
    assert printable("a\x1b[31m\nb\udcff\u202eä") == "a\\x1b[31m\\nb\\udcff\\u202eä"


def test_of_what_was_given_a_message_quotes_no_more_than_that() -> None:
    told = cut(f"name: {'a' * 300!r} is taken; give another", {"x": [{"name": "a" * 300}]})
    assert told == f"name: '{'a' * 200}…' is taken; give another"


def test_a_sentence_is_one_line_that_a_terminal_only_shows() -> None:
    assert sentence("a\n b\x1b[31m \u202ec\udcff ☃") == r"a b\x1b[31m \u202ec\udcff ☃"


def test_a_long_sentence_keeps_its_beginning_and_its_end() -> None:
    told = sentence(f"name: {'a' * 10_000}; give another")
    assert told.startswith("name: a") and told.endswith("; give another") and len(told) < 810
