"""Arrays that run on from frame to frame, through the command line."""

import shutil

import numpy as np
import pytest

from megalopta.cli import main
from megalopta.config.model import load
from megalopta.dataset.frames import FRAMES_AT_ONCE
from megalopta.dataset.store import open_sequence
from megalopta.render import read_truth
from megalopta.sensor.formats.events import read_events
from megalopta.sensor.formats.reading import read_frames
from megalopta.sensor.quantities import histogram
from megalopta.stages.sense import open_exposure, sense

from ...sensor.plainest import sub_frames
from ..small import made, small

SHAPE, PERIOD_S, DEAD_S, LEVEL, BITS = (20, 24), 0.1, 0.03, 1e-5, 10
FRAMES = FRAMES_AT_ONCE + 2
"""More than are read at once."""
DEVICE = (
    f"{{preset: ideal, exposure_s: {PERIOD_S}, dead_time: "
    f"{{kind: nonparalyzable, dead_time_s: {DEAD_S}}}}}"
)
SMALL = small(*SHAPE[::-1], FRAMES, samples=4, sensors=DEVICE, levels=LEVEL) | {
    "render.bands_nm": "[[450, 550], [550, 650]]",
    "products": "[counts, events_hdf5]",
}
OPTIONS = (
    "--free-running", "--sub-frames", "2", "--burst-hz", str(BITS / PERIOD_S), "--redo",
    "--products", "counts", "events_hdf5", "binary_npy", "burst_npy", "sums_npy",
    "brackets_npy", "changes_hdf5", "--cubes.sum-frames", "5", "--cubes.bracket-frames", "1", "10",
    "--cubes.change-frames", "7", "--cubes.change-sigmas", "1.5",
)  # fmt: skip


@pytest.fixture(scope="module")
def reset(tmp_path_factory):
    return made(tmp_path_factory.mktemp("reset") / "data", load("grating", SMALL)).root


@pytest.fixture(scope="module")
def running(reset, tmp_path_factory):
    root = tmp_path_factory.mktemp("running") / "data"
    shutil.copytree(reset, root)
    main.main(["sense", str(root), *OPTIONS])
    return root


def beside(root, suffix):
    (path,) = (root / "counts").glob(f"*/*{suffix}")
    return path


def stored(root):
    dataset = open_sequence(root)
    return open_exposure(dataset, dataset.configuration.sensors[0], LEVEL)


def shortest_gap(root):
    """Between two events of a pixel, s."""
    events = read_events(beside(root, ".events.h5")).events
    times = events.frame * PERIOD_S + events.time_s
    order = np.lexsort((times, events.pixel))
    same = np.diff(events.pixel[order].astype(int)) == 0
    return np.diff(times[order])[same].min()


def test_dead_times_reach_into_the_next_frame(reset, running):
    # a time stamp of a file is exact to some nanoseconds
    assert shortest_gap(running) > DEAD_S - 1e-6
    assert shortest_gap(reset) < DEAD_S / 2


def test_counts_events_and_bits_are_the_same_avalanches(running):
    counts = stored(running)["counts"][:]
    numbered = histogram(read_events(beside(running, ".events.h5")).events)
    np.testing.assert_array_equal(numbered, counts)
    bits = read_frames(beside(running, ".binary.npy"), shape=SHAPE).counts
    np.testing.assert_array_equal(bits, counts > 0)


def test_a_dead_time_spans_frames_of_a_burst(running):
    bits = read_frames(beside(running, ".burst.npy"), shape=SHAPE).counts
    assert bits.shape == (FRAMES * BITS, *SHAPE)
    # of 10 ms each: a pixel that fired is blind in the whole of the next two, across frames, too
    for later in (1, 2):
        assert not (bits[later:] & bits[:-later]).any()
    assert (bits[3:] & bits[:-3]).any()


def test_sums_and_changes_are_those_of_the_bits(running):
    bits = read_frames(beside(running, ".burst.npy"), shape=SHAPE).counts
    sums = read_frames(beside(running, ".sums.npy"), shape=SHAPE).counts
    np.testing.assert_array_equal(sums, bits.reshape(-1, 5, *SHAPE).sum(axis=1))
    of_frame = bits.reshape(FRAMES, BITS, *SHAPE)
    brackets = np.stack([of_frame[:, 0], of_frame.sum(axis=1)], axis=-1)
    np.testing.assert_array_equal(read_frames(beside(running, ".brackets.npy")).counts, brackets)
    told = []
    for row, column in np.ndindex(SHAPE):
        mean, sent, k = 0.0, np.inf, 0
        for at, bit in enumerate(bits[:, row, column]):
            k += 1
            mean += (bit - mean) / min(k, 7)
            chance = (mean + min(sent, 1.0)) / 2
            if k >= 7 and abs(mean - sent) > 1.5 * np.sqrt(chance * (1 - chance) / 7):
                told.append((at, row, column, mean))
                sent, k = mean, 0
    events = read_events(beside(running, ".changes.h5")).events
    found = np.stack([events.frame, events.row, events.column, events.value], axis=1)
    assert len(told) > 3 * bits[0].size  # more than the first of each pixel
    np.testing.assert_allclose(found, sorted(told), rtol=1e-6)


def test_stated_means_are_those_of_settled_pixels(running):
    opened = stored(running)
    counts, stated = opened["counts"][:].astype(float), opened["mean_reading"][:]
    variance = opened["reading_variance"][:]
    # off by less than one count times the change of light: the wave passes in 5 frames or more
    z = (counts[1:] - stated[1:]).sum() / np.sqrt(variance[1:].sum())
    assert abs(z) < 5 + 0.02 * stated[1:].sum() / np.sqrt(variance[1:].sum())
    assert stated.mean() < counts[0].mean()  # which began live


def test_light_in_an_exposure_moves_with_the_true_flow(reset, running):
    """As `sub_frames` moves it, which tests/sensor compares with a closed form."""
    still, moved = (np.asarray(stored(root)["photons"][:], float) for root in (reset, running))
    truths = [read_truth(open_sequence(reset).frame("truth", index)) for index in range(FRAMES - 1)]
    flow, hidden = (
        [getattr(each, f"{name}_forward") for each in truths] for name in ("flow", "occluded")
    )
    expected = sub_frames(still, np.array(flow), 2, np.array(hidden)).mean(axis=1)
    np.testing.assert_allclose(moved[:-1], expected, rtol=1e-5)
    assert np.abs(still[:-1] / expected - 1).mean() > 0.05


def test_what_a_kill_left_out_is_made_again_alike(running):
    products = [
        beside(running, end)
        for end in (".burst.npy", ".events.h5", ".binary.npy", ".sums.npy", ".changes.h5")
    ]
    before = [path.read_bytes() for path in products]
    for path in products:
        path.unlink()
    sense(open_sequence(running))
    assert [path.read_bytes() for path in products] == before
