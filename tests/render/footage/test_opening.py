"""What is footage, and what is refused before it is opened.

Arrays, and animated GIF, PNG and WebP, which the tests write.
"""

import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from PIL import Image

from megalopta.core.errors import UserError
from megalopta.render import SUFFIXES, is_footage, open_footage
from megalopta.scenes.spectra.color import linear_of_srgb

from .conftest import refused


def test_what_is_footage(tmp_path):
    Image.fromarray(np.zeros((4, 4), np.uint8)).save(tmp_path / "a.PNG")
    (tmp_path / "empty").mkdir()
    (tmp_path / "notes.txt").write_text("x")
    assert is_footage(tmp_path) and is_footage(tmp_path / "a.PNG")
    assert not is_footage(tmp_path / "empty") and not is_footage(tmp_path / "notes.txt")

    assert all(suffix in refused(tmp_path / "notes.txt") for suffix in SUFFIXES)


def test_what_is_not_there_or_no_regular_file_is_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe.mp4")
    (tmp_path / "null.png").symlink_to("/dev/null")
    assert "no such file or folder" in refused(tmp_path / "none.mp4")
    for name in ("pipe.mp4", "null.png"):
        assert "not a regular file" in refused(tmp_path / name)


def saved(path, values, name="a.npy"):
    np.save(path / name, values)
    return path / name


@pytest.mark.parametrize(
    ("shape", "frames"), [((4, 6), 1), ((5, 4, 6), 5), ((4, 6, 3), 1), ((5, 4, 6, 3), 5)]
)
def test_shapes(tmp_path, shape, frames):
    values = np.random.default_rng(0).random(shape, np.float32)
    with open_footage(saved(tmp_path, values), "linear") as footage:
        assert (len(footage), footage.shape, footage.times_s) == (frames, (4, 6), None)
        last = values.reshape(frames, 4, 6, -1)[-1]
        np.testing.assert_array_equal(footage.frame(frames - 1), np.broadcast_to(last, (4, 6, 3)))
        assert footage.saturated(0) == 0


@pytest.mark.parametrize("dtype", ["u1", "<u2", ">u2"])
@pytest.mark.parametrize(
    ("unit", "light", "told"),
    [
        (
            "srgb",
            lambda share, code: np.where(
                share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4
            ),
            "sRGB",
        ),
        ("linear", lambda share, code: share, "linear"),
        ("cd/m2", lambda share, code: code, "cd/m²"),
    ],
)
def test_whole_numbers_are_codes_of_the_unit(tmp_path, dtype, unit, light, told):
    top = np.iinfo(np.dtype(dtype)).max
    codes = np.array([[0, 1, 100, top - 1, top, top]], dtype)
    with open_footage(saved(tmp_path, codes), unit) as footage:
        expected = light(codes[0] / top, codes[0].astype(float))
        np.testing.assert_allclose(footage.frame(0)[0, :, 1], expected, rtol=1e-6)
        np.testing.assert_allclose(footage.mean(0), expected.mean(), rtol=1e-6)
        assert footage.saturated(0) == pytest.approx(2 / 6)
        assert (footage.coding.name, footage.coding.unit) == (told, unit)


def test_coded_floats_lie_between_0_and_1(tmp_path):
    codes = np.array([[0, 51, 255]], np.uint8)
    with open_footage(saved(tmp_path, codes / 255), "srgb") as footage:
        np.testing.assert_allclose(footage.frame(0)[..., 0], linear_of_srgb(codes / 255), rtol=1e-6)
    with (
        open_footage(saved(tmp_path, codes / 1.0), "srgb") as footage,
        pytest.raises(UserError, match="between 0 and 1"),
    ):
        footage.frame(0)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        (np.zeros((4, 6, 4)), "has the shape (4, 6, 4)"),
        (np.zeros((0, 4, 6)), "has the shape (0, 4, 6)"),
        (np.zeros((4, 6), np.int64), "holds int64"),
        (np.array([[{}]]), "is not a complete array of numbers"),
    ],
)
def test_other_arrays_are_refused(tmp_path, values, said):
    assert said in refused(saved(tmp_path, values), "linear")
    path = saved(tmp_path, np.zeros((40, 60)))
    path.write_bytes(path.read_bytes()[:-100])
    assert "complete array" in refused(path, "linear")


LEVELS = np.array([0, 60, 120, 180], np.uint8)


def write(path, lasts_ms=40, alpha=255, **more):
    frames = []
    for level in LEVELS:
        codes = np.full((6, 9, 4), level, np.uint8)
        codes[..., 3] = 255
        codes[:3, :, 3] = alpha
        codes[level // 60, level // 60, :3] = 255  # no two frames alike
        frames.append(Image.fromarray(codes))
    frames[0].save(
        path,
        save_all=True,
        append_images=frames[1:],
        duration=lasts_ms,
        loop=0,
        disposal=2,
        lossless=True,
        **more,
    )
    return path


@pytest.mark.parametrize("suffix", ["gif", "png", "webp"])
def test_frames_and_times(tmp_path, suffix):
    with open_footage(write(tmp_path / f"a.{suffix}", [40, 80, 40, 40])) as footage:
        np.testing.assert_allclose(footage.times_s, [0, 0.04, 0.12, 0.16], atol=1e-9)
        in_order = [footage.frame(k) for k in range(4)]
        np.testing.assert_allclose(
            [each[5, 8, 1] for each in in_order], linear_of_srgb(LEVELS / 255), rtol=1e-6
        )
        for k in (3, 0, 2, 1):
            np.testing.assert_array_equal(footage.frame(k), in_order[k])
            np.testing.assert_allclose(footage.mean(k), in_order[k].mean((0, 1), dtype=float))
        assert footage.saturated(1) == pytest.approx(1 / 54)
        assert footage.notes == () and footage.coding.name == "sRGB"


@pytest.mark.parametrize("suffix", ["gif", "png", "webp"])
def test_transparency_stands_before_black(tmp_path, suffix):
    with open_footage(write(tmp_path / f"a.{suffix}", alpha=0)) as footage:
        light = footage.frame(2)
        assert not light[:3].any() and light[4:].all()
        assert footage.notes == ("transparent parts are shown over black",)


def test_frames_of_no_time_last_a_tenth_of_a_second_as_in_browsers(tmp_path):
    with open_footage(write(tmp_path / "a.gif", 0)) as footage:
        np.testing.assert_allclose(footage.times_s, [0, 0.1, 0.2, 0.3])
        assert footage.last_s == 0.1 and "no duration" in footage.notes[0]


def test_a_picture_that_is_no_part_of_the_animation_is_left_out(tmp_path):
    with open_footage(write(tmp_path / "a.png", default_image=True)) as footage:
        assert len(footage) == 3 and "no part of its animation" in footage.notes[0]
        np.testing.assert_allclose(
            footage.frame(0)[5, 8, 0], linear_of_srgb(LEVELS[1:2] / 255)[0], rtol=1e-6
        )


def test_an_animation_that_is_cut_off_is_refused(tmp_path):
    path = write(tmp_path / "a.png")
    path.write_bytes(path.read_bytes()[:-60])
    assert "cannot be read as a picture" in refused(path)


@pytest.mark.parametrize("suffix", ["gif", "png", "webp"])
def test_threads_that_share_a_file_get_the_frames_that_they_ask_for(tmp_path, suffix):
    asked = np.random.default_rng(0).integers(0, 4, 400).tolist()
    with open_footage(write(tmp_path / f"a.{suffix}")) as footage, ThreadPoolExecutor(4) as threads:
        seen = threads.map(lambda k: footage.frame(k)[5, 8, 1], asked)
        np.testing.assert_allclose(list(seen), linear_of_srgb(LEVELS[asked] / 255), rtol=1e-6)
