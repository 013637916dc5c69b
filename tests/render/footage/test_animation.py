"""Animated GIF, PNG and WebP, which the tests write."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from PIL import Image

from megalopta.core.errors import UserError
from megalopta.render import open_footage
from megalopta.scenes.spectra.color import decode_srgb
from megalopta.stages.importing import PictureOptions, timing_of as timing

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
            [each[5, 8, 1] for each in in_order], decode_srgb(LEVELS), rtol=1e-6
        )
        for k in (3, 0, 2, 1):
            np.testing.assert_array_equal(footage.frame(k), in_order[k])
            np.testing.assert_allclose(footage.mean(k), in_order[k].mean((0, 1), dtype=float))
        assert footage.saturated(1) == pytest.approx(1 / 54)
        assert footage.notes == () and footage.transfer == "sRGB"


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


def test_the_last_frame_has_a_duration_too(tmp_path):
    path = write(tmp_path / "a.gif", [20, 20, 400, 600])
    with open_footage(path) as footage:
        assert footage.last_s == pytest.approx(0.6)
        assert timing(footage, PictureOptions(frame_rate_hz=50.0))["frames"] == 52


def test_a_picture_that_is_no_part_of_the_animation_is_left_out(tmp_path):
    with open_footage(write(tmp_path / "a.png", default_image=True)) as footage:
        assert len(footage) == 3 and "no part of its animation" in footage.notes[0]
        np.testing.assert_allclose(
            footage.frame(0)[5, 8, 0], decode_srgb(LEVELS[1:2])[0], rtol=1e-6
        )


def test_an_animation_that_is_cut_off_is_refused(tmp_path):
    path = write(tmp_path / "a.png")
    path.write_bytes(path.read_bytes()[:-60])
    with pytest.raises(UserError, match="cannot be read as a picture"):
        open_footage(path)


@pytest.mark.parametrize("suffix", ["gif", "png", "webp"])
def test_threads_that_share_a_file_get_the_frames_that_they_ask_for(tmp_path, suffix):
    asked = np.random.default_rng(0).integers(0, 4, 400).tolist()
    with open_footage(write(tmp_path / f"a.{suffix}")) as footage, ThreadPoolExecutor(4) as threads:
        seen = threads.map(lambda k: footage.frame(k)[5, 8, 1], asked)
        np.testing.assert_allclose(list(seen), decode_srgb(LEVELS[asked]), rtol=1e-6)
