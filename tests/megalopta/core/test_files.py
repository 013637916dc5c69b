import errno
from pathlib import Path

import pytest

from megalopta.core.files import atomic_write, sweep, write_json, write_text


def test_a_failed_write_leaves_the_old_file_and_no_partial_one(tmp_path):
    path = tmp_path / "deep" / "a.txt"
    write_text(path, "old")
    with pytest.raises(RuntimeError), atomic_write(path) as temporary:
        temporary.write_text("half")
        raise RuntimeError
    assert path.read_text() == "old"
    assert [entry.name for entry in path.parent.iterdir()] == ["a.txt"]


def test_json_refuses_what_json_cannot_hold(tmp_path):
    with pytest.raises(ValueError, match="JSON"):
        write_json(tmp_path / "a.json", {"a": float("nan")})
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
