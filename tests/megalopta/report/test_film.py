"""Films of pictures side by side."""

import io

import numpy as np
import pytest
from PIL import Image

from megalopta.report.film import Moment, bounded_gif, composed, gif, magnified, write_film


def plain(color, size=(8, 6)):
    return Image.new("RGB", size, color)


def moments():
    for gray in range(0, 200, 40):
        yield Moment(f"frame {gray}", [("light", plain((200, 40, 40))), ("b", plain((gray,) * 3))])


def frames_of(content):
    with Image.open(io.BytesIO(content)) as image:
        for index in range(image.n_frames):
            image.seek(index)
            yield image.info["duration"], np.asarray(image.convert("RGB"))


def test_pixels_are_repeated_or_left_out_but_never_mixed():
    noise = Image.fromarray(np.random.default_rng(0).integers(0, 256, (6, 9, 3), np.uint8))
    large = np.asarray(magnified(noise, 40))
    assert large.shape == (24, 36, 3)
    np.testing.assert_array_equal(large[::4, ::4], noise)
    np.testing.assert_array_equal(large[3::4, 3::4], noise)
    small = np.asarray(magnified(noise, 4))
    assert small.shape == (2, 3, 3)
    colors = np.asarray(noise).reshape(-1, 3).tolist()
    assert all(each in colors for each in small.reshape(-1, 3).tolist())


def test_many_pictures_stand_in_two_rows():
    several = [("a", plain("red"))] * 4
    one, two = (composed(Moment("now", several[:n] + several[: n - 4]), 600, 12) for n in (4, 5))
    assert one.height < one.width / 3
    assert two.height > two.width / 2.2


def test_a_film_has_every_moment_and_the_gif_repeats(tmp_path):
    written = write_film(tmp_path, moments, 5, 12.5)
    frames = list(frames_of((tmp_path / "film.gif").read_bytes()))
    assert tmp_path / "film.gif" in written and len(frames) == 5
    assert {duration for duration, _ in frames} == {80}
    assert [int(each[100, 500, 0]) for _, each in frames] == [0, 40, 80, 120, 160]


def test_the_mp4_plays_the_same_with_even_sides(tmp_path):
    av = pytest.importorskip("av")
    assert write_film(tmp_path, moments, 5, 12.5)[0] == tmp_path / "film.mp4"
    with av.open(str(tmp_path / "film.mp4")) as film:
        stream = film.streams.video[0]
        shown = [each.to_ndarray(format="rgb24") for each in film.decode(stream)]
        assert float(stream.average_rate) == 12.5
    assert len(shown) == 5
    assert not any(side % 2 for side in shown[0].shape[:2])
    np.testing.assert_allclose(shown[3][100, 100], (200, 40, 40), atol=8)
    np.testing.assert_allclose(shown[3][100, 700], 120, atol=8)


def test_a_gif_that_would_be_large_has_fewer_frames_and_lasts_as_long():
    rng = np.random.default_rng(0)
    noise = [
        Image.fromarray(rng.integers(0, 256, (250, 300), np.uint8)).convert("P") for _ in range(64)
    ]
    assert len(gif(noise[:16], 50)) * 4 > 4_000_000
    content = bounded_gif(noise, 50)
    frames = [duration for duration, _ in frames_of(content)]
    assert len(content) <= 4_000_000
    assert 8 <= len(frames) < 64 and sum(frames) == 64 * 50
