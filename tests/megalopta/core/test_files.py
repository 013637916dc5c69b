"""Files and folders: written whole, read so far, kept apart, in formats of today."""

import errno
import re
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from megalopta.core import freshness
from megalopta.core.bounded import check_file, read_bytes, sentence
from megalopta.core.errors import DamagedFileError, UserError
from megalopta.core.files import atomic_write, sweep, write_text
from megalopta.core.folders import locked
from megalopta.core.format_numbers import FORMATS, check_format
from megalopta.core.pictures import read_codes

from ..harm import claiming


def test_a_failed_write_leaves_the_old_file_and_no_partial_one(tmp_path):
    path = tmp_path / "deep" / "a.txt"
    write_text(path, "old")
    with pytest.raises(RuntimeError), atomic_write(path) as temporary:
        temporary.write_text("half")
        raise RuntimeError
    assert path.read_text() == "old"
    assert [entry.name for entry in path.parent.iterdir()] == ["a.txt"]


def test_ctrl_c_stays_ctrl_c_while_threads_still_write(tmp_path, monkeypatch):
    def refilled(path):
        raise OSError(errno.ENOTEMPTY, "Directory not empty", str(path))

    monkeypatch.setattr("shutil.rmtree", refilled)
    with pytest.raises(KeyboardInterrupt), atomic_write(tmp_path / "a.zarr") as temporary:
        temporary.mkdir()
        raise KeyboardInterrupt
    monkeypatch.undo()
    sweep(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_appears_whole_or_not_at_all(tmp_path):
    with pytest.raises(RuntimeError), atomic_write(tmp_path / "a.zarr") as temporary:
        temporary.mkdir()
        (temporary / "half").write_text("")
        raise RuntimeError
    assert list(tmp_path.iterdir()) == []
    with atomic_write(tmp_path / "a.zarr") as temporary:
        temporary.mkdir()
        (temporary / "whole").write_text("x")
    assert [path.name for path in tmp_path.rglob("*")] == ["a.zarr", "whole"]


def test_a_full_disk_is_told_with_the_files_own_name(tmp_path):
    full = pytest.raises(OSError, match=r"No space left on device: .*/a\.txt'")
    with full as caught, atomic_write(tmp_path / "a.txt"):
        Path("/dev/full").write_text("x" * 100_000)
    assert caught.value.errno == errno.ENOSPC
    assert list(tmp_path.iterdir()) == []


def test_only_what_writers_left_is_swept(tmp_path):
    for name in (".part-0123456789ab-a.exr", ".part-mine", "a.exr"):
        (tmp_path / name).write_text("")
    (tmp_path / "deep" / ".part-0123456789ab-b.zarr").mkdir(parents=True)
    sweep(tmp_path)
    assert sorted(path.name for path in tmp_path.rglob("*")) == [".part-mine", "a.exr", "deep"]


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


@pytest.mark.parametrize("found", ["1", -1, True, 1.0, None, [1]])
def test_what_is_no_number_is_refused(found: object) -> None:
    with pytest.raises(UserError, match="not a format number"):
        check_format("dataset", {"format": found}, "file")


def test_the_table_of_the_documentation_is_that_of_the_program() -> None:
    text = (Path(__file__).parents[3] / "docs/reference/dataset-files.md").read_text("utf-8")
    rows = re.findall(r"^\| `(\w+)` \| .* \| (\d+) \| (\d+)(?:–(\d+))? \|$", text, re.MULTILINE)
    told = {name: (int(written), int(oldest)) for name, written, oldest, _ in rows}
    assert told == {name: tuple(each) for name, each in FORMATS.items()}
    assert all(newest in ("", now) for _, now, _, newest in rows)


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A package with a module in a sub-package; its hash is remembered in a process."""
    folder = tmp_path / "some_package" / "room"
    folder.mkdir(parents=True)
    (folder / "module.py").write_text("x = 1\n")
    for init in (folder, folder.parent):
        (init / "__init__.py").write_text("")
    monkeypatch.syspath_prepend(tmp_path)
    freshness.code_digest.cache_clear()
    yield folder
    freshness.code_digest.cache_clear()
    sys.modules.pop("some_package", None)


def test_code_in_the_rooms_of_a_package_counts(package):
    before = freshness.code_digest("some_package")
    (package / "module.py").write_text("x = 2\n")
    freshness.code_digest.cache_clear()
    assert freshness.code_digest("some_package") != before


def test_a_larger_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"123")
    for read in (read_bytes, check_file):
        with pytest.raises(UserError, match="larger than"):
            read(tmp_path / "a", 2)


@pytest.mark.parametrize("device", ["/dev/zero", "/dev/urandom"])
def test_devices_are_refused(device: str) -> None:
    with pytest.raises(UserError, match="not a regular file"):
        read_bytes(device)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda png: claiming(png, 60_000, 60_000), "too many pixels"),
        (lambda png: cv2.imencode(".png", np.full((2, 2), 40_000, np.uint16))[1].tobytes(), "more than 8 bits"),
        (lambda png: b"", "cannot be read as a picture"),
        (lambda png: b"%!PS-Adobe-3.0 EPSF-3.0\n", "cannot be read as a picture"),
    ],
)  # fmt: skip
def test_what_is_no_picture_of_eight_bits_is_refused(tmp_path, change, message):
    path = tmp_path / "a.png"
    Image.new("L", (2, 2)).save(path)
    path.write_bytes(change(path.read_bytes()))
    with pytest.raises(DamagedFileError, match=message):
        read_codes(path, "L")


def test_a_sentence_is_one_short_line_that_a_terminal_only_shows() -> None:
    assert sentence("a\n b\x1b[31m \u202ec\udcff ☃") == r"a b\x1b[31m \u202ec\udcff ☃"
    told = sentence(f"name: {'a' * 10_000}; give another")
    assert told.startswith("name: a") and told.endswith("; give another") and len(told) < 810
