"""What cannot fit is refused with the figure before anything is built."""

import shutil

import pytest

from megalopta.config.model import load
from megalopta.core.errors import UserError
from megalopta.stages.limits import needed_bytes, refuse_absurd
from megalopta.stages.run import run_all

from ..small import TINY


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("trajectory.frames", "1000000000"),
        ("benchmark.fluxes_per_decade", "100000000"),
        ("light.illuminance_lux", "1e-300"),
        ("light_levels", "[1e300]"),
        ("scene.trees", "1" + "0" * 400),
    ],
)
def test_a_value_beyond_sense_is_refused_by_its_field(path, value):
    with pytest.raises(UserError, match=path):
        load("demo", {path: value})


BURST = {"products": "[counts, burst_npy]"}
SUMS = {"products": "[counts, sums_npy]", "sub_frames": "2", "burst_hz": "1000"}
INFRARED = {"sensors": "[ctia_si]", "render.bands_nm": "[[700, 800], [800, 900]]"}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"trajectory.frames": "1000000", "camera.height": "8000"},
         r"1000000 frames of 48 × 8000 would take about .* TB on disk"),
        ({"camera.width": "32768", "camera.height": "32768"},
         r"about 1.1[0-9] TB of memory, and this machine has .*; lower"),
        ({"trajectory.frames": "6"}, "flow: .*EMD settles: use at least 22"),
        ({"camera.height": "12"}, "flow: .*12 × 48 px cannot be cut"),
        ({"trajectory.frame_rate_hz": "30"},
         "sense: sensor 'spadcam': exposure_s 0.1 is longer than a frame"),
        ({"render.bands_nm": "[[1000, 1200]]", "sensors": "[spadcam]"},
         "sense: sensor 'spadcam': .*1000–1200 nm reaches outside the efficiency"),
        ({"sub_frames": "2", "shutter.exposure_s": "0.05"}, "sub_frames 2: shutter already renders"),
        (BURST, "burst_npy: needs moving light"),
        ({"burst_hz": "5000"}, "burst_hz 5000: products has no burst_npy; add it, or .* at 100000"),
        (BURST | {"sub_frames": "2", "burst_hz": "105"}, "burst_hz 105: not a whole .* use 100"),
        (BURST | {"sub_frames": "2"} | INFRARED, "no single events"),
        (SUMS | {"cubes.sum_frames": "7"}, "a burst has 100 .* a divisor of it as sum_frames .7"),
        ({"products": "[counts, histograms_npy]", "camera.width": "4096", "camera.height": "4096",
          "sensors": "[{preset: ideal, exposure_s: 0.01, tcspc: {bins: 65536}}]"},
         r"would take about .* TB of memory.*or tcspc\.bins"),
        ({"free_running": "true"} | INFRARED, "'ctia_si' integrates"),
        ({"free_running": "true", "sensors": "[{preset: ideal, exposure_s: 0.01}]"},
         "exposure_s 0.01 does.* use .* 0.1,"),
    ],
)  # fmt: skip
def test_what_cannot_be_done_is_refused_before_anything_is_begun(
    tmp_path, monkeypatch, changes, message
):
    roomy = shutil.disk_usage(tmp_path)._replace(free=10**12)  # on a machine of any disk
    monkeypatch.setattr(shutil, "disk_usage", lambda path: roomy)
    with pytest.raises(UserError, match=message):
        run_all(tmp_path / "out", load("grating", {**TINY, **changes}))
    assert not list(tmp_path.iterdir())


def test_more_than_the_disk_holds_is_refused(tmp_path, monkeypatch):
    full = shutil.disk_usage(tmp_path)._replace(free=1000)
    monkeypatch.setattr(shutil, "disk_usage", lambda path: full)
    with pytest.raises(UserError, match=r"render: .* MB on disk, and .*/out has space for 0 MB"):
        refuse_absurd(load("demo"), "render", tmp_path / "out")


@pytest.mark.parametrize("stage", ["render", "sense", "flow", "benchmark"])
def test_disk_grows_with_the_frames_and_memory_does_not(stage):
    few, many = (
        needed_bytes(load("demo", {"trajectory.frames": frames}), stage) for frames in ("40", "80")
    )
    assert many[0] == pytest.approx(few[0], rel=1e-3)
    assert many[1] == pytest.approx(2 * few[1])
