"""Datasets with moving objects and a shutter: what is stored, sensed, checked and refused."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

from megalopta.cli import main as cli
from megalopta.config.model import load
from megalopta.dataset.frames import read_radiance_frames, read_truth_frame
from megalopta.dataset.sequence import Sequence
from megalopta.dataset.store import open_sequence
from megalopta.flow.formats import write_flo
from megalopta.render import read_attributes, read_radiance, read_truth, write_truth
from megalopta.report.panels import SequencePanels
from megalopta.sensor import expectation, open_counts
from megalopta.verification.truth import check_truth, footprint_residuals

from ..small import agreeing, made, small

OBJECTS = (
    "[{name: crate, position_m: [3, 0.3, 1.5], motion: {velocity_m_s: [0, -2, 0.4], "
    "spin_deg_s: 90, spin_axis: [1, 2, 3]}}, "
    "{name: bird, shape: ball, position_m: [4, -1, 1.6], motion: {velocity_m_s: [0, 2, 0]}}]"
)
SMALL = small(64, 48, 3, samples=16, sensors="ideal", levels="twilight")
SMALL |= {"render.bands_nm": "[[450, 550]]"}


@pytest.fixture(scope="session")
def moving(tmp_path_factory):
    """A grating with a crate and a bird before it, exposed for half of each frame."""
    settings = load("grating", {**SMALL, "objects": OBJECTS, "shutter.exposure_s": "0.05"})
    return made(tmp_path_factory.mktemp("moving") / "data", settings)


@pytest.fixture(scope="session")
def rolling(tmp_path_factory):
    """The whole cylinder of the grating, read out row by row."""
    changes = {"camera.kind": "cylindrical", "camera.lower_deg": "-30", "camera.upper_deg": "30"}
    settings = load(
        "grating", {**changes, **SMALL, "camera.width": "160", "shutter.readout_s": "0.08"}
    )
    return made(tmp_path_factory.mktemp("rolling") / "data", settings, "render")


def test_flow_is_derived_again_for_what_rests_and_what_moves(moving):
    rows = {row.name: row for row in check_truth(moving)}
    assert list(rows) == [
        *("at rest, backward", "at rest, forward", "hidden share backward, in standard errors"),
        *("hidden share forward, in standard errors", "image, warped"),
        *("moving, backward", "moving, forward", "outlines missed, share"),
        *("pixel mean, backward", "pixel mean, forward", "sky share, in standard errors"),
    ]
    assert all(row.passed for row in rows.values())
    assert min(row.pixels for name, row in rows.items() if "moving" in name) > 150
    # The objects are rigid: float32 of the stored numbers is all that is left.
    exact = [row for name, row in rows.items() if name.startswith(("at rest", "moving"))]
    assert max(row.percentile_99 for row in exact) < 1e-4


def test_flow_of_a_panorama_is_derived_again(rolling):
    rows = check_truth(rolling)
    assert all(row.passed for row in rows)
    assert next(row.pixels for row in rows if row.name == "at rest, forward") == 2 * 160 * 48


@pytest.mark.parametrize(
    ("wrong", "failing"),
    [
        (lambda flow: flow + np.float32(0.002), "rest, forward"),
        (lambda flow: flow + np.float32(0.5), "image"),
        (lambda flow: flow * np.float32([-1, 1]), "image"),
        (lambda flow: flow * np.float32(np.nan), "rest, forward"),
    ],
    ids=["slightly off", "half a pixel off", "mirrored", "missing"],
)
def test_wrong_flow_fails_the_check(moving, tmp_path, wrong, failing, capsys):
    root = tmp_path / "data"
    shutil.copytree(moving.root, root)
    for index in (0, 1):
        source = open_sequence(root).frame("truth", index)
        truth, header = read_truth(source), read_attributes(source)
        values = {**vars(truth), "flow_forward": wrong(truth.flow_forward)}
        kept = {name: header[name] for name in ("camera", "cameraToWorld", "timeSeconds")}
        write_truth(source, type(truth)(**values), (0, 0, 1), kept)
    assert any(failing in row.name for row in check_truth(agreeing(root)) if not row.passed)
    with pytest.raises(SystemExit) as stopped:
        cli.main(["check", "truth", str(root)])
    assert stopped.value.code == 1
    assert "NO" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("wrong", "failing", "limit"),
    [
        (lambda print_: replace(print_, sky=1 - print_.sky), "sky share", 5),
        (lambda print_: replace(print_, purity=1 + 0 * print_.purity), "outlines missed", 0.1),
        (
            lambda print_: replace(
                print_, forward=replace(print_.forward, mean=print_.forward.mean + 0.5)
            ),
            "pixel mean, forward",
            1e-3,
        ),
        (
            lambda print_: replace(
                print_, forward=replace(print_.forward, hidden=print_.forward.hidden + 0.5)
            ),
            "hidden share forward",
            5,
        ),
    ],
    ids=["sky", "purity", "mean", "hidden"],
)
def test_wrong_truth_of_whole_pixels_fails_the_check(moving, wrong, failing, limit):
    right = read_truth(moving.frame("truth", 0))
    found = dict(footprint_residuals(replace(right, footprint=wrong(right.footprint))))
    name = next(name for name in found if name.startswith(failing))
    assert np.median(found[name]) > limit


def test_sensors_see_the_frames_of_the_shutter(moving):
    blurred, bands = read_radiance(moving.exposed_radiance(1))
    sharp, _ = read_radiance(moving.frame("radiance", 1))
    assert moving.exposed_radiance(1) != moving.frame("radiance", 1)
    assert not np.allclose(blurred, sharp, rtol=0.2)
    stored = open_counts(moving.counts(moving.configuration.sensors[0], "twilight"))
    first, *_ = (frames for _, frames in read_radiance_frames(moving))
    np.testing.assert_array_equal(first[1], blurred)
    stated = expectation(blurred[None], bands, stored.sensor)
    ratio = stored.exposure().expectation.mean_events[1] / stated.mean_events[0]
    np.testing.assert_allclose(ratio, ratio.mean(), rtol=1e-5)


def test_of_a_rolling_shutter_the_motion_of_what_sensors_see_is_shown(rolling, tmp_path):
    shutil.copytree(rolling.root, tmp_path / "data")
    copy = Sequence(open_sequence(tmp_path / "data"))
    flow = read_truth(copy.dataset.exposed_truth(0)).flow_forward
    write_flo(copy.dataset.frame("training/flow", 0), np.zeros_like(flow))  # of whole frames
    np.testing.assert_array_equal(SequencePanels(copy, range(2), 1).motion_of(0), flow)


def test_blur_has_the_truth_of_its_middle_and_rows_have_their_own(moving, rolling):
    assert moving.exposed_truth(1) == moving.frame("truth", 1)
    assert rolling.exposed_truth(1) != rolling.frame("truth", 1)
    times = range(rolling.configuration.trajectory.frames)
    frames = [read_truth_frame(rolling, time) for time in times]
    # The camera turns at 15°/s about the vertical: azimuth tells each row's time. A row sees its
    # point a frame later in the same row, so the flow is that of an instant.
    sharp = read_truth(rolling.frame("truth", 0))
    np.testing.assert_allclose(frames[0].flow_forward, sharp.flow_forward, atol=1e-4)
    azimuth = [
        np.arctan2(each.position[:, 80, 1], each.position[:, 80, 0]) for each in (frames[0], sharp)
    ]
    delay = 0.08 * (np.arange(48) / 47 - 0.5)
    np.testing.assert_allclose(azimuth[0] - azimuth[1], np.radians(15) * delay, atol=1e-6)
