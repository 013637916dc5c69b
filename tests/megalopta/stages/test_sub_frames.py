"""Light that moves within an exposure, through the command line."""

import shutil

import numpy as np
import pytest

from megalopta.cli import main
from megalopta.config.model import load
from megalopta.dataset.store import open_sequence
from megalopta.stages.pipeline import run_stage
from megalopta.stages.sense import open_exposure

FRAMES, BITS, LEVEL = 4, 200, 1e-4
SMALL = {
    "camera.width": "48",
    "camera.height": "40",
    "scene.cycles_per_frame": "2",
    "render.samples_per_pixel": "16",
    "render.bands_nm": "[[450, 550], [550, 650]]",
    "sensors": "[ideal]",
    "light_levels": f"[{LEVEL}]",
}
OPTIONS = (
    "--sub-frames", "2", "--burst-hz", str(10 * BITS), "--redo",
    "--products", "counts", "events_npz", "burst_npy",
)  # fmt: skip


@pytest.fixture(scope="module")
def still(tmp_path_factory):
    """Four frames at 10 Hz, whose light stands still."""
    root = tmp_path_factory.mktemp("sub_frames") / "data"
    settings = load("grating", SMALL | {"trajectory.frames": str(FRAMES)})
    for stage in ("render", "sense"):
        run_stage(root, settings, stage)
    return root


@pytest.fixture(scope="module")
def moving(still, tmp_path_factory):
    root = tmp_path_factory.mktemp("moving") / "data"
    shutil.copytree(still, root)
    main.main(["sense", str(root), *OPTIONS])
    return root


@pytest.fixture(scope="module")
def fast(tmp_path_factory):
    """The same way, rendered forty times a second."""
    root = tmp_path_factory.mktemp("fast") / "data"
    changes = {"trajectory.frames": str(4 * FRAMES), "trajectory.frame_rate_hz": "40"}
    changes["sensors"] = "[{preset: ideal, exposure_s: 0.025}]"
    for stage in ("render", "sense"):
        run_stage(root, load("grating", SMALL | changes), stage)
    return root


def mean_events(root):
    dataset = open_sequence(root)
    opened = open_exposure(dataset, dataset.configuration.sensors[0], LEVEL)
    return opened.exposure().expectation.mean_events.astype(float)


def beside(root, suffix):
    (path,) = (root / "counts").glob(f"*/*{suffix}")
    return path


def test_light_in_an_exposure_is_that_of_more_frames(still, moving, fast):
    # the parts of an exposure have their middles where every second of those frames is
    true = 4 * mean_events(fast).reshape(FRAMES, 4, 40, 48)[:, 1::2].mean(axis=1)
    contrast = true.std()
    errors = {
        root: np.sqrt(((mean_events(root) - true)[:, :, 3:-3] ** 2).mean()) / contrast
        for root in (still, moving)
    }
    # bilinear interpolation of a sine of 24 px: (π/24)²/2 = 0.9 %; half a pixel of lag: 13 %
    assert errors[moving] < 0.02
    assert errors[still] > 0.08
