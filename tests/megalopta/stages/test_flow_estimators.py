"""Every method on a rendered sequence, and the motion that four of them find."""

import json

import pytest

from megalopta.config.model import load
from megalopta.flow.detectors.registry import METHODS

from ..small import TINY, made, small

pytestmark = pytest.mark.slow

# these take as long as all others; tests/flow/detectors/test_estimators.py has them
QUICK = [name for name in METHODS if name not in ("TV-L1", "DualTVL1")]

DOTS = TINY | small(60, 60, 30, samples=16, sensors="ideal", levels="twilight")
DOTS |= {
    "trajectory.rotation_deg_s": "-6",
    "scene.pattern": "dots",
    "scene.cycles_per_frame": "7",
    "methods": f"[{', '.join(QUICK)}]",
}


@pytest.fixture(scope="module")
def records(tmp_path_factory):
    root = tmp_path_factory.mktemp("estimators") / "data"
    finished = made(root, load("grating", DOTS), "render", "sense", "flow")
    found = json.loads(finished.result("flow.json").read_text("utf-8"))
    return {record["method"]: record for record in found}


@pytest.mark.parametrize("name", ["LK", "FB", "DIS", "PC"])
def test_estimators_find_the_motion_of_rendered_dots(name, records):
    # 6 deg/s at 10 frames per second are about 0.5 px per frame; BM, in whole pixels, reads 0.
    truth = records[name]["truth"]
    assert truth["ideal"]["relative_error_median"] < 0.25
    assert truth["counts"]["relative_error_median"] < 0.25
