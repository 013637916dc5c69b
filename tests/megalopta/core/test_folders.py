"""Two who want the same folder: the second is told who is inside, and waits."""

import subprocess
import sys

import pytest

from megalopta.core.errors import UserError
from megalopta.core.folders import ensure_directory, locked

SECOND = """
import sys
from pathlib import Path
from megalopta.core.folders import locked
with locked(Path(sys.argv[1])):
    print("inside")
"""


def test_the_second_process_is_told_who_is_inside_and_waits(tmp_path):
    with locked(tmp_path):
        second = subprocess.Popen(
            [sys.executable, "-c", SECOND, str(tmp_path)],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        told = second.stderr.readline()
        assert "waiting for process" in told
        assert second.poll() is None
    out, _ = second.communicate(timeout=20)
    assert out == "inside\n"
    assert list(tmp_path.iterdir()) == []


def test_a_file_in_the_way_is_named(tmp_path):
    (tmp_path / "a").write_text("")
    with pytest.raises(UserError, match="a file is in the way"):
        ensure_directory(tmp_path / "a" / "b")
