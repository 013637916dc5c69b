"""Folders of pictures that other libraries wrote."""

from unittest.mock import Mock

import imageio.v3 as imageio
import numpy as np
import pytest
import tifffile
from PIL import Image, PngImagePlugin

from megalopta.sensor.formats import pictures
from megalopta.sensor.formats.reading import read_frames

from .scene import bits as draw

BITS = draw(12, 20, 37)
COUNTS = np.random.default_rng(0).poisson(300, (12, 20, 37)).astype(np.uint16)


def saved(folder, frames, write=imageio.imwrite, suffix="png"):
    for number, frame in enumerate(frames):
        write(folder / f"frame{number}.{suffix}", frame)
    return folder


def pillow(path, frame):
    Image.fromarray(frame).save(path)


@pytest.mark.parametrize(
    ("write", "frames", "told"),
    [
        (pillow, 255 * BITS, "0 or 255"),
        (imageio.imwrite, BITS, "0 or 1"),
        (imageio.imwrite, BITS.astype(np.uint16) * 65535, "0 or 65535"),
        (pillow, BITS > 0, "by its type"),
        (pillow, COUNTS.astype(np.uint8), "values up to 255"),
        (pillow, COUNTS, "values up to 3"),
        (imageio.imwrite, COUNTS, "values up to 3"),
    ],
)
def test_pictures_are_frames_in_natural_order(tmp_path, write, frames, told):
    read = read_frames(saved(tmp_path, frames, write))
    is_binary = "values up to" not in told
    assert told in read.basis and read.bit_depth == (1 if is_binary else 8 * frames.itemsize)
    np.testing.assert_array_equal(read.counts, BITS if is_binary else frames)
    assert (read.source, read.total) == ("png", 12)


def test_only_frames_that_are_read_are_decoded(tmp_path, monkeypatch):
    saved(tmp_path, [255 * BITS[0]] * 200)
    counted = Mock(wraps=pictures.opened_picture)
    monkeypatch.setattr(pictures, "opened_picture", counted)
    read = read_frames(tmp_path, frames=slice(50, 53))
    assert (read.total, len(read.counts)) == (200, 3)
    assert counted.call_count <= 1 + 3 + 17  # the first, those read, and those that tell bits


def test_bits_of_a_dark_recording_that_the_sample_misses_are_bits(tmp_path):
    frames = np.zeros((100, 8, 8), np.uint8)
    frames[50, 2, 2] = 255
    read = read_frames(saved(tmp_path, frames), frames=slice(49, 52))
    np.testing.assert_array_equal(read.counts, frames[49:52] > 0)
    assert read.bit_depth == 1


def test_statement_overrules_values(tmp_path):
    saved(tmp_path, BITS)
    assert read_frames(tmp_path, values="counts").bit_depth == 8
    (tmp_path / "other").mkdir()
    saved(tmp_path / "other", COUNTS)
    with pytest.raises(ValueError, match="no bits; state values: counts"):
        read_frames(tmp_path / "other", values="bits")


def test_palettes_and_four_bits_are_counts(tmp_path):
    counts = COUNTS[0].astype(np.uint8) % 16
    picture = Image.fromarray(counts, "L").convert("P")
    picture.putdata(counts.ravel())
    picture.save(tmp_path / "a.png", bits=4)
    np.testing.assert_array_equal(read_frames(tmp_path).counts[0], counts)


def test_text_of_a_picture_states_the_exposure(tmp_path):
    text = PngImagePlugin.PngInfo()
    text.add_text("Integration time", "20 us")
    text.add_text("light", "2e7")
    Image.fromarray(255 * BITS[0]).save(tmp_path / "a.png", pnginfo=text)
    read = read_frames(tmp_path)
    assert (read.exposure_s, read.conditions["light"]) == (pytest.approx(2e-5), 2e7)


def test_three_equal_colors_are_gray(tmp_path):
    saved(tmp_path, np.repeat(255 * BITS[..., np.newaxis], 3, axis=-1))
    assert read_frames(tmp_path).counts.shape == BITS.shape


def test_single_tiff_pictures_are_frames(tmp_path):
    saved(tmp_path, COUNTS, tifffile.imwrite, "tif")
    read = read_frames(tmp_path, frames=slice(8, 12))
    np.testing.assert_array_equal(read.counts, COUNTS[8:])
    assert (read.source, read.total) == ("tiff", 12)


def test_a_folder_with_one_stack_is_that_stack(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", COUNTS)
    np.testing.assert_array_equal(read_frames(tmp_path).counts, COUNTS)


def color(folder):
    imageio.imwrite(folder / "frame3.png", np.full((20, 37, 3), (9, 9, 8), np.uint8))


def link(folder):
    (folder / "frame3.png").unlink()
    (folder / "frame3.png").symlink_to(folder / "frame2.png")


def other_size(folder):
    imageio.imwrite(folder / "frame3.png", np.zeros((21, 37), np.uint8))


@pytest.mark.parametrize(
    ("harm", "told"),
    [
        (color, "frame3.png: in color; give gray"),
        (link, "frame3.png: a link in a recording"),
        (other_size, r"frame3.png: uint8 \(21, 37\), but frame0.png is"),
    ],
)
def test_harm_is_one_sentence(tmp_path, harm, told):
    saved(tmp_path, 255 * BITS)
    harm(tmp_path)
    with pytest.raises(ValueError, match=told):
        read_frames(tmp_path)
