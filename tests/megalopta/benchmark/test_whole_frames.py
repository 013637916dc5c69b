"""The board of whole frames, on scenes made here and on files in the layouts of others."""

import csv
from contextlib import ExitStack
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from PIL import Image
from scipy import stats

from megalopta.benchmark.clips import FlowClip, sequence_of
from megalopta.benchmark.methods import (
    TUNED,
    block_detector,
    methods_and_baselines,
    tuned,
    velocity_methods,
)
from megalopta.benchmark.table import FAR, MEAN, MEDIAN, NONE, means
from megalopta.benchmark.whole_frames import (
    FROM_OTHERS,
    METRICS,
    SECONDS,
    Board,
    clips_without_truth,
    dense_flow,
    frame_errors,
    pairs_without_truth,
)
from megalopta.cli import main as cli
from megalopta.flow import METHODS, optical_flow
from megalopta.flow.detectors.gray_detector import GrayDetector, detector_from
from megalopta.flow.formats import write_flo

BASIC = MEDIAN, MEAN, FAR
GRAY = [name for name, each in METHODS.items() if isinstance(each, GrayDetector)]


@pytest.fixture(scope="module")
def clip():
    """Noise that moves by (2, 1) px per frame, around the edges."""
    texture = 1 + np.random.default_rng(0).random((96, 120))
    light = np.stack([np.roll(texture, (t, 2 * t), axis=(0, 1)) for t in range(8)])
    return FlowClip("rolled", light / light.mean(), np.broadcast_to((2.0, 1.0), (96, 120, 2)))


def always(*flow):
    """A method that says the same of all pictures."""

    def same(first, second):
        return np.full((*first.shape, 2), flow)

    same.__name__ = str(flow)  # by which methods are told apart
    return detector_from(same)


def test_the_truth_has_no_error_and_standstill_that_of_the_motion(clip):
    methods = [always(2.0, 1.0), always(0.0, 0.0), detector_from(half_known)]
    board = frame_errors([clip], methods, (3.0, 10.0), draws=2)
    assert board.parts() == {None: "rolled"}
    motion = np.hypot(2, 1)
    for detector, error in zip(methods, (0, motion, motion), strict=True):
        found = board.by_draw.set_index("method").loc[detector.name, list(BASIC)]
        np.testing.assert_allclose(found, [[error, error, 0]] * 4)


def values(board):
    """The mean of every metric of the only method and flux, but for processor time."""
    (row,) = board.by_draw.to_dict("records")
    del row[SECONDS]
    del row[NONE]
    return {name: row[name] for name in METRICS if np.isfinite(row.get(name, np.nan))}


def test_a_third_of_pixels_far_off_shows_in_mean_and_share_not_in_the_median(clip):
    """The right 40 of 120 columns are taken to move by 10 px more."""

    def wrong_at_the_right(first, second):
        flow = np.full((*first.shape, 2), (2.0, 1.0))
        flow[:, 80:, 0] += 10
        return flow

    board = frame_errors([clip], [detector_from(wrong_at_the_right)], (3.0,))
    assert means(board.samples(None, 3.0))["low"].isna().all()  # one scene tells no spread
    # an error of 10 px is beyond all limits; all pixels move by √5 px; what is hidden is unknown
    third = dict.fromkeys(
        (name for name in METRICS if "beyond" in name or name == "fl_share"), 1 / 3
    )
    mean_errors = dict.fromkeys((MEAN, "mean_epe_below_10_px"), 10 / 3)
    assert values(board) == pytest.approx({MEDIAN: 0, "wauc_share": 2 / 3} | third | mean_errors)


def test_errors_are_told_apart_where_something_is_hidden_and_by_speed(clip):
    """The left 40 of 120 columns move by 60 px; half of them are hidden."""
    flow, hidden = clip.flow.copy(), np.zeros((96, 120), np.bool_)
    flow[:, :40], hidden[:, :20] = (60.0, 0.0), True
    foreground = np.arange(120) < np.full((96, 1), 80)
    moved = replace(clip, flow=flow, hidden=hidden, foreground=foreground)
    board = frame_errors([moved], [always(2.0, 1.0)], (3.0,))
    off, found = np.hypot(58, 1), values(board)
    assert "mean_epe_10_to_40_px" not in found
    for name, error in {
        "mean_epe_below_10_px": 0,
        "fl_foreground_share": 0.5,
        "mean_epe_from_40_px": off,
        "mean_epe_occluded_px": off,
        "mean_epe_visible_px": off / 5,
    }.items():
        assert found[name] == pytest.approx(error), name


def test_flow_of_methods_of_blocks_is_that_of_optical_flow(clip):
    first, second = clip.counts(100.0, 0)[3:5]
    block_matching = block_detector("BM")
    np.testing.assert_array_equal(
        np.nan_to_num(optical_flow(first, second, "BM", block_px=24)),
        dense_flow(block_matching, clip, np.stack([first, second])),
    )


def of_sequences(errors_by_draw):
    """A board of methods a and b whose mean errors (runs, sequences, frames) are given."""
    rows = [
        {"set": "s", "sequence": str(place[0]), "unit": str(place), "group": "none"}
        | {"photons": 3.0, "frames": 2, "draw": 0, "method": method, MEAN: error}
        for method, errors in errors_by_draw.items()
        for place, error in np.ndenumerate(errors)
    ]
    return Board(pd.DataFrame(rows))


def test_95_of_100_intervals_over_sequences_hold_the_mean_though_frames_are_alike():
    """Frames of a sequence differ by 5 %, sequences by 35 %: over frames it held 60 of 100 (5 σ)."""
    rng, held, over_frames, runs = np.random.default_rng(0), 0, 0, 200
    for _ in range(runs):
        errors = rng.lognormal(0, 0.35, (8, 1)) * rng.lognormal(0, 0.05, (8, 4))
        board = of_sequences({"a": errors})
        (row,) = board.means(None, 3.0).itertuples()
        held += row.low <= np.exp(0.35**2 / 2 + 0.05**2 / 2) <= row.high
        low, high = stats.t.interval(0.95, 31, errors.mean(), stats.sem(errors, axis=None))
        over_frames += low <= np.exp(0.35**2 / 2 + 0.05**2 / 2) <= high
    assert board.units(None) == ("sequence", "95 % CI over 8 sequences")
    assert held > runs * 0.95 - 5 * np.sqrt(runs * 0.95 * 0.05) > over_frames


def test_the_difference_from_the_best_has_students_interval_over_means_of_sequences():
    a, b = np.random.default_rng(1).lognormal(0, 0.4, (2, 6, 3))
    b += 1
    board = of_sequences({"a": a, "b": b})
    _, row = board.means(None, 3.0).itertuples()
    paired = stats.ttest_rel(b.mean(axis=1), a.mean(axis=1)).confidence_interval()
    ends = row.difference - row.difference_half, row.difference + row.difference_half
    assert ends == pytest.approx(tuple(paired)) and row.against == "a"
    first, _ = replace(board, against="b").means(None, 3.0).itertuples()
    assert (first.difference, first.difference_half) == (-row.difference, row.difference_half)


@pytest.mark.parametrize(
    ("shape", "told"),
    [((4, 2), "range of 4 sequences"), ((1, 9), "range of 9 pairs of one sequence"), ((1, 1), "")],
)
def test_few_sequences_and_frames_of_one_have_a_range(shape, told):
    errors = np.random.default_rng(0).lognormal(size=shape)
    board = of_sequences({"a": errors})
    (row,) = board.means(None, 3.0).itertuples()
    units = errors.mean(axis=1) if shape[0] > 1 else errors[0]
    assert board.units(None)[1] == told and np.isnan(row.difference_half)
    if told:
        assert (row.low, row.high) == pytest.approx((units.min(), units.max()))


def test_one_pair_has_the_interval_over_its_draws(clip):
    board = frame_errors([clip], ["LK"], (3.0,), draws=6)
    errors = board.by_draw[MEAN]
    row = board.means(None, 3.0).set_index("metric").loc[MEAN]
    low, high = stats.t.interval(0.95, 5, errors.mean(), stats.sem(errors))
    assert board.units(None)[1] == "95 % CI over 6 draws"
    assert (row["low"], row["high"]) == pytest.approx((low, high), rel=0.02)


@pytest.mark.parametrize(
    ("pair", "sequence"),
    [
        ("alley_1/frame_0001", "alley_1/"),
        ("0001/flow_BW_right/flow_BW_right_0004", "0001/"),
        ("000012_10", "/000012"),
        ("00001_flow", "/00001_flow"),
        ("other-gt-flow/Venus/flow10", "other-gt-flow/Venus/"),
    ],
)
def test_sequences_by_the_names_of_pairs(pair, sequence):
    """Sintel and megalopta, Spring in all directions, KITTI, FlyingChairs and Middlebury."""
    assert sequence_of(pair) == sequence


def half_known(first, second):
    return np.where(np.arange(first.shape[1])[:, None] % 4, np.nan, np.zeros((*first.shape, 2)))


def test_the_share_without_flow_is_told_and_a_method_without_any_refused(clip, tmp_path, refused):
    board = frame_errors([clip], [detector_from(half_known)], (3.0,))
    assert board.by_draw[NONE].tolist() == [0.75]
    for flow, told in ((np.nan, "gives no flow at any pixel"), (np.inf, "infinite flow")):
        with pytest.raises(ValueError, match=rf"\({flow}, {flow}\):? {told}"):
            frame_errors([clip], [always(flow, flow)], (3.0,))


def test_small_frames_do_for_methods_without_blocks(clip):
    small = replace(clip, light=clip.light[:, :64, :64], flow=clip.flow[:64, :64])
    frame_errors([small], ["DIS", always(2.0, 1.0)], (3.0,))
    with pytest.raises(ValueError, match="BM: frames of 64 × 64 px .* a method without blocks"):
        frame_errors([small], ["BM"], (3.0,))


def test_a_disturbance_is_a_further_row_with_the_same_photons_for_all(clip, tmp_path, capsys):
    middlebury(tmp_path / "data", clip)
    words = "--methods LK,BM --photons 1000 --disturb ramp20,shadow --disturb warm"
    rows = measured(tmp_path, tmp_path / "data", *words.split())
    assert [row["disturbance"] for row in rows[:8:2]] == ["none", "ramp 20", "shadow 40", "warm 3"]
    none, shadow = (float(rows[place][MEAN]) for place in (0, 4))
    assert shadow > 1.5 * none  # LK supposes constant light
    said = capsys.readouterr().out
    assert "mean px minus" in said and "shadow 40" in said


def test_several_folders_are_sets_and_one_table_over_all(clip, tmp_path, capsys):
    for place in ("one/set", "two/set"):
        middlebury(tmp_path / place, clip)
    rows = measured(tmp_path, tmp_path / "one/set", tmp_path / "two/set", "--methods", "BM,LK")
    assert {row["set"] for row in rows} == {f"{tmp_path}/one/set", f"{tmp_path}/two/set"}
    assert "All 2 pairs, photons per px: 1 " in capsys.readouterr().out


def test_of_two_passes_only_the_first_is_measured_and_the_other_named(
    clip, tmp_path, capsys, refused
):
    for name in ("clean", "final"):
        write_pictures(tmp_path / name / "alley", ("frame_0001.png", "frame_0002.png"), clip)
    (tmp_path / "flow/alley").mkdir(parents=True)
    write_flo(tmp_path / "flow/alley/frame_0001.flo", clip.flow.astype(np.float32))
    words = ("--methods", "LK", "--photons", 100, "--draws", 1, "--against", "zero")
    (row, zero) = measured(tmp_path, tmp_path, *words)
    assert row["set"].endswith("clean") and zero["method"] == "zero"
    told = capsys.readouterr()
    assert "final is omitted" in told.err and "zero (± 95 % CI, paired)" in told.out
    (row,) = measured(tmp_path, tmp_path / "final", *words[:-2])
    assert row["set"] == "final"
    assert "both have" in refused("benchmark", "pairs", tmp_path, tmp_path / "final")


def test_methods_and_baselines_of_a_board_do_with_two_frames():
    two = {method.name: method for method in methods_and_baselines()}
    assert {"PM", "DIS tuned"} <= set(two) and not {"PPM", "EMD"} & set(two)
    assert block_detector("DIS tuned") == block_detector(two["DIS tuned"])
    assert block_detector("DIS √").name == "DIS √"
    assert list(velocity_methods(["DIS √", "DeepFlow tuned"])) == ["DIS √", "DeepFlow tuned"]
    denoised = block_detector("DIS NLM")
    assert (denoised.name, denoised.stretch) == ("DIS NLM", "denoised")
    with pytest.raises(ValueError, match="settings exist for DIS, .*; or give .* √"):
        block_detector(f"{next(name for name in GRAY if name not in TUNED)} tuned")


SLOW = {"DualTVL1": pytest.mark.slow}


@pytest.mark.parametrize("name", [pytest.param(name, marks=SLOW.get(name, ())) for name in TUNED])
def test_a_tuned_method_has_the_settings_for_the_nearest_light(name, clip):
    for flux, nearest in ((0.4, 1.0), (12.0, 10.0)):
        first, second = clip.counts(flux, 0)[3:5]
        settings = {key: value for key, value in TUNED[name][nearest].items() if key != "error_px"}
        np.testing.assert_array_equal(
            optical_flow(first, second, tuned(name)), optical_flow(first, second, name, **settings)
        )


def write_pictures(folder, names, clip):
    folder.mkdir(parents=True, exist_ok=True)
    # pictures are coded as sRGB: light² is near enough to tell motion
    for name, light in zip(names, clip.light, strict=False):
        Image.fromarray((200 * np.sqrt(light / clip.light.max())).astype(np.uint8)).save(
            folder / name
        )


def middlebury(root, clip, name="Venus"):
    write_pictures(root / "other-data" / name, ("frame10.png", "frame11.png"), clip)
    truth = root / "other-gt-flow" / name
    truth.mkdir(parents=True)
    write_flo(truth / "flow10.flo", clip.flow.astype(np.float32))


def measured(folder, *words):
    """Return the rows that `benchmark pairs` writes."""
    out = folder / "errors.csv"
    cli.main(["benchmark", "pairs", *map(str, words), "--out", str(out)])
    return list(csv.DictReader(out.read_text().splitlines()))


def test_a_folder_becomes_a_table_of_error_against_flux(clip, tmp_path, capsys):
    middlebury(tmp_path / "data", clip)
    rows = measured(tmp_path, tmp_path / "data", "--methods", "BM,LK", "--photons", "1,1000")
    cases = [(row["method"], row["photons_per_px"], row["draw"]) for row in rows]
    assert cases == [
        (method, flux, draw)
        for draw in "01234"
        for flux in ("1", "1000")
        for method in ("BM", "LK")
    ]
    assert list(rows[0])[8:] == list(METRICS)
    assert float(rows[3]["mean_epe_px"]) < 0.05
    assert float(rows[0]["mean_epe_px"]) > 0
    of_mean = pd.read_csv(tmp_path / "errors-means.csv").query("metric == @MEAN and method == 'LK'")
    assert of_mean["photons_per_px"].tolist() == [1, 1000]
    assert (of_mean["low"] < of_mean["value"]).all() and (of_mean["value"] < of_mean["high"]).all()
    said = capsys.readouterr().out
    assert "other-gt-flow/Venus/flow10, photons per px: 1 " in said and "95 % CI over 5" in said
    assert "BM" in said and "px: 1000" in said and "WAUC" in said
    assert "none %" not in said and "0–10 px" not in said  # all zero, or the mean once more
    assert "95 % CI over 5 draws" in (tmp_path / "errors.html").read_text("utf-8")


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["{picture}", "{truth}"], "2 paths, not all folders; give folders"),
        (["{picture}"], "1 path, not all folders; give folders"),
        (["{root}", "--against", "DeepFlwo"], "did you mean 'DeepFlow'?"),
        (["{root}", "{root}/other-data"], "both have"),
        (["{root}", "--disturb", "fog"], "disturbance 'fog' is unknown; choose from ramp 20, "),
        (["{root}", "--methods", "NDS"], "NDS measures no velocity"),
        (["{root}", "--methods", "PPM"], "has 2 frames; PPM needs 8"),
        (["{picture}", "{small}", "{truth}"], "give pictures and flow of one size"),
        (["{picture}", "{picture}", "none.flo"], "none.flo cannot be read (no such file or dir"),
        (["{picture}", "--no-truth"], "1 paths, 1 frames in all"),
        (["{picture}"] * 3 + ["--no-truth"], "3 paths, 3 frames in all; without truth"),
        (["{root}", "--reference", "LK"], "--reference needs --no-truth"),
        (["{picture}", "{small}", "--no-truth"], "have 120 × 96 and 30 × 20 px"),
    ],
)
def test_mistakes_are_told_in_a_sentence(clip, tmp_path, refused, words, told):
    middlebury(tmp_path, clip)
    small = tmp_path / "small.png"
    Image.fromarray(np.full((20, 30), 9, np.uint8)).save(small)
    names = {
        "root": tmp_path,
        "small": small,
        "picture": tmp_path / "other-data/Venus/frame10.png",
        "truth": tmp_path / "other-gt-flow/Venus/flow10.flo",
    }
    assert told in refused("benchmark", "pairs", *(word.format(**names) for word in words))


# without truth

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


def moves(first, second):
    return np.broadcast_to(np.float64(MOTION), (*first.shape, 2))


def stays(first, second):
    return np.zeros((*first.shape, 2))


def test_distances_from_the_stand_in_and_from_the_median_of_the_others(folder):
    methods = list(map(detector_from, (moves, stays, half_known)))
    with ExitStack() as stack:
        pairs = pairs_without_truth(stack, [folder])
        clips = clips_without_truth(pairs, detector_from(moves))
        board = frame_errors(clips, methods, (3.0, 10.0), 2)
    assert list(board.by_draw["unit"].unique()) == ["walk 0", "walk 1", "walk 2"]
    length = np.hypot(*MOTION)
    expected = {"moves": (0, length)}
    expected |= dict.fromkeys(("stays", "half_known"), (length, length / 2))
    by_draw = board.by_draw[board.by_draw["photons"] == 10].set_index("method")
    for method, both in expected.items():
        found = by_draw.loc[method, [MEAN, FROM_OTHERS]]
        np.testing.assert_allclose(found, [both] * 6, atol=1e-6)


def test_pictures_become_tables_that_say_what_they_are(folder, tmp_path, capsys):
    words = (folder, "--no-truth", "--pairs", 2, "--methods", "DIS,BM,LK", "--photons", "1,1000")
    rows = measured(tmp_path, *words)
    assert [row["pair"] for row in rows[::6]] == ["walk 0", "walk 2"]
    assert list(rows[0])[9:] == [
        *(name.replace("epe_", "") + "_from_stand_in" for name in METRICS if name != SECONDS),
        *(SECONDS, FROM_OTHERS),
    ]
    assert all(
        row["stand_in"] == "not the truth but DIS on the pictures without noise, which favors DIS"
        for row in rows
    )
    table = pd.read_csv(tmp_path / "errors.csv").pivot_table(
        "mean_px_from_stand_in", "method", "photons_per_px", sort=False, aggfunc="last"
    )
    dark, bright = table[1.0], table[1000.0]
    assert (bright < 0.3)[["DIS", "LK"]].all()
    assert (dark > 3 * bright)[["DIS", "LK"]].all()
    said = capsys.readouterr().out
    assert "NO TRUE FLOW: these are distances, not errors" in said
    assert "All 2 pairs, photons per px: 1 " in said and "range of 2 pairs of one sequence" in said


def test_pairs_without_contrast_are_left_out(folder, capsys):
    for number in (0, 1):
        Image.fromarray(np.zeros((96, 120), np.uint8)).save(folder / f"f{number}.png")
    with ExitStack() as stack:
        pairs = pairs_without_truth(stack, [folder])
        board = frame_errors(clips_without_truth(pairs, "DIS"), ["BM"], (1000.0,))
        assert list(board.by_draw["unit"].unique()) == ["walk 1", "walk 2"]
        assert "walk 0: no contrast" in capsys.readouterr().err
        with pytest.raises(ValueError, match="no pair with texture"):
            frame_errors(clips_without_truth({"walk 0": pairs["walk 0"]}, "DIS"), ["BM"])
