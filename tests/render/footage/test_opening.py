"""What is footage, and what is refused before it is opened."""

import os

import numpy as np
import pytest
from PIL import Image

from megalopta.core.errors import UserError
from megalopta.render import SUFFIXES, is_footage, open_footage


def test_what_is_footage(tmp_path):
    Image.fromarray(np.zeros((4, 4), np.uint8)).save(tmp_path / "a.PNG")
    (tmp_path / "empty").mkdir()
    (tmp_path / "notes.txt").write_text("x")
    assert is_footage(tmp_path) and is_footage(tmp_path / "a.PNG")
    assert not is_footage(tmp_path / "empty") and not is_footage(tmp_path / "notes.txt")


def test_an_unknown_suffix_is_answered_with_what_is_read(tmp_path):
    (tmp_path / "notes.txt").write_text("x")
    with pytest.raises(UserError) as refusal:
        open_footage(tmp_path / "notes.txt")
    assert all(suffix in str(refusal.value) for suffix in SUFFIXES)


def test_what_is_not_there_or_no_regular_file_is_refused(tmp_path):
    with pytest.raises(UserError, match=r"none\.mp4: no such file or folder"):
        open_footage(tmp_path / "none.mp4")
    os.mkfifo(tmp_path / "pipe.mp4")
    with pytest.raises(UserError, match="not a regular file"):
        open_footage(tmp_path / "pipe.mp4")
    (tmp_path / "null.png").symlink_to("/dev/null")
    with pytest.raises(UserError, match="not a regular file"):
        open_footage(tmp_path / "null.png")


def test_a_frame_that_is_not_there_raises_an_index_error(tmp_path):
    Image.fromarray(np.zeros((4, 4), np.uint8)).save(tmp_path / "a.png")
    with open_footage(tmp_path / "a.png") as footage, pytest.raises(IndexError):
        footage.frame(1)
