"""Methods on pictures without true flow, on a clip made here whose motion the tests know."""

import csv
from contextlib import ExitStack

import av
import numpy as np
import pytest
from PIL import Image

from megalopta.benchmark.whole_frames import FAR, MEAN, MEDIAN
from megalopta.benchmark.without_truth import (
    FROM_OTHERS,
    FROM_STAND_IN,
    distances_of_pairs,
    pairs_without_truth,
)
from megalopta.cli import main as cli
from megalopta.core.errors import UserError
from megalopta.flow.detectors.gray_detector import detector_from

MOTION = (2, 1)


def frames(count):
    """Codes of noise that moves by (2, 1) px per frame, around the edges."""
    texture = np.random.default_rng(0).integers(60, 200, (96, 120)).astype(np.uint8)
    return [np.roll(texture, (t, 2 * t), axis=(0, 1)) for t in range(count)]


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "walk").mkdir()
    for number, codes in enumerate(frames(4)):
        Image.fromarray(codes).save(tmp_path / f"walk/f{number}.png")
    return tmp_path / "walk"


@pytest.fixture
def film(tmp_path):
    with av.open(tmp_path / "walk.mp4", "w") as container:
        stream = container.add_stream("libx264", rate=25, options={"qp": "0"})
        stream.width, stream.height, stream.pix_fmt = 120, 96, "yuv420p"
        for codes in frames(6):
            frame = av.VideoFrame.from_ndarray(
                np.vstack([codes, np.full((48, 120), 128, np.uint8)]), "yuv420p"
            )
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return tmp_path / "walk.mp4"


def moves(first, second):
    return np.broadcast_to(np.float64(MOTION), (*first.shape, 2))


def stays(first, second):
    return np.zeros((*first.shape, 2))


def says_nothing(first, second):
    return np.full((*first.shape, 2), np.nan)


def test_distances_from_the_stand_in_and_from_the_median_of_the_others(folder):
    methods = list(map(detector_from, (moves, stays, says_nothing)))
    with ExitStack() as stack:
        pairs = pairs_without_truth(stack, [folder], most=20)
        board = distances_of_pairs(pairs, (3.0, 10.0), detector_from(moves), methods, 2)
    assert board.scenes == ("walk 0", "walk 1", "walk 2")
    length = np.hypot(*MOTION)
    expected = {
        "moves": (0, length),
        "stays": (length, length / 2),
        "says_nothing": (length, length / 2),
    }
    for each in board.detectors:
        for names, distance in zip((FROM_STAND_IN, FROM_OTHERS), expected[each.name], strict=True):
            found = [board.of_scenes(names[measure], each, 10.0) for measure in (MEDIAN, MEAN, FAR)]
            np.testing.assert_allclose(
                found, np.transpose([[distance, distance, 0]] * 3), atol=1e-12
            )


def rows_of(out, *words):
    cli.main(["benchmark", "pairs", *map(str, words), "--no-truth", "--out", str(out)])
    return list(csv.DictReader(out.read_text().splitlines()))


def test_a_film_becomes_tables_that_say_what_they_are(film, tmp_path, capsys):
    rows = rows_of(
        tmp_path / "pairs.csv", film, "--pairs", 2, "--methods", "DIS,BM,LK", "--photons", "1,1000"
    )
    assert [row["pair"] for row in rows[::6]] == ["walk 0", "walk 4"]
    assert list(rows[0])[4:] == [*FROM_STAND_IN.values(), *FROM_OTHERS.values()]
    assert all(
        row["stand_in"] == "not the truth but DIS on the pictures without noise, which favors DIS"
        for row in rows
    )
    dark, bright = (
        {
            row["method"]: float(row["mean_px_from_stand_in"])
            for row in rows
            if row["photons_per_px"] == flux
        }
        for flux in ("1", "1000")
    )
    assert all(bright[method] < 0.3 for method in bright)
    assert all(dark[method] > 3 * bright[method] for method in ("DIS", "LK"))
    said = capsys.readouterr()
    assert "NO TRUE FLOW: these are distances, not errors" in said.out
    assert "mean over 2 pairs, 95 % CI over pairs" in said.out
    assert "which favors DIS" in said.out and "may share an error" in said.out
    assert "that of BT.709 is used" in said.err


def test_two_pictures_and_another_reference(folder, tmp_path, capsys):
    words = (
        folder / "f0.png",
        folder / "f2.png",
        "--methods",
        "BM,LK",
        "--reference",
        "LK",
        "--photons",
        "1000",
    )
    row, _ = rows_of(tmp_path / "pairs.csv", *words)
    assert row["pair"] == "f0" and row["stand_in"].startswith("not the truth but LK")
    assert float(row["median_px_from_stand_in"]) < 0.5
    assert "median_px_from_others" not in row
    assert "other methods" not in capsys.readouterr().out


def test_what_has_no_pairs_is_refused(folder, film, refused):
    def told(*words):
        return refused("benchmark", "pairs", *words)

    one = folder / "f0.png"
    assert "has one frame" in told(one, "--no-truth")
    assert "3 paths; without truth" in told(one, one, one, "--no-truth")
    assert "has 6 frames; give it alone" in told(one, film, "--no-truth")
    assert "--reference needs --no-truth" in told(folder, "--reference", "LK")
    assert "NDS measures no velocity" in told(folder, "--no-truth", "--reference", "NDS")
    assert "without flow: --no-truth" in told(one, one)
    small = folder / "small.png"
    Image.fromarray(np.zeros((30, 20), np.uint8)).save(small)
    assert "have 120 × 96 and 20 × 30 px" in told(one, small, "--no-truth")


def test_pairs_without_contrast_are_left_out(folder, capsys):
    for number in (0, 1):
        Image.fromarray(np.zeros((96, 120), np.uint8)).save(folder / f"f{number}.png")
    with ExitStack() as stack:
        pairs = pairs_without_truth(stack, [folder], most=20)
        board = distances_of_pairs(pairs, (1000.0,), "DIS", ["BM"])
        assert board.scenes == ("walk 1", "walk 2")
        assert "walk 0: both pictures are uniform" in capsys.readouterr().err
        with pytest.raises(UserError, match="no contrast; "):
            distances_of_pairs({"walk 0": pairs["walk 0"]}, (1000.0,), "DIS", ["BM"])
