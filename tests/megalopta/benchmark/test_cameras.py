"""Cameras in one light: pixels keep the light, information has closed forms, noise is as stated."""

import numpy as np
import pytest

from megalopta.benchmark import cameras
from megalopta.benchmark.cameras_page import summary, verdict, write_cameras
from megalopta.cli import main as cli
from megalopta.config.model import load
from megalopta.core.errors import UserError
from megalopta.sensor import IMAGE_SENSORS, changed
from megalopta.sensor.information import information
from megalopta.sensor.optics import detected_rate
from megalopta.stages.run import run_stages

BANDS = ((500.0, 550.0),)
SPAD = changed(IMAGE_SENSORS["spad512-squared"], dark_counts={"hot_fraction": 0.0})


def light(sensor, electrons, frames=1):
    """Uniform light that frees so many electrons in an exposure."""
    of_one = detected_rate(np.ones((1, 1, 1, 1)), BANDS, sensor)[0, 0, 0] * sensor.exposure_s
    return np.full((frames, 64, 64, 1), electrons / of_one)


@pytest.mark.parametrize("pitch", [0.4, 1.0, 2.5])
def test_pixels_of_another_pitch_keep_the_light(pitch):
    image = np.random.default_rng(0).random((1, 20, 40, 2)) + 0.1
    pixels = cameras.on_pixels(image, pitch)
    assert pixels.shape == (1, int(20 / pitch), int(40 / pitch), 2)
    assert pixels.mean(axis=(1, 2)) == pytest.approx(image.mean(axis=(1, 2)), rel=1e-12)
    assert pixels.min() > 0


def test_sums_of_binary_frames_tell_as_bernoulli_trials():
    """1/(e^µ − 1) each, from the derivative of 1 − e^−µ; 1 %."""
    for mu in (0.001, 0.5, 2.0):
        slopes = cameras.motion_information(
            light(SPAD, mu), BANDS, cameras.Setting(SPAD, frames=400)
        )
        expected = np.full((64, 64), 400 / np.expm1(mu))
        assert slopes.information == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize(
    ("name", "read_e", "peak", "shares"),
    [
        ("orca-quest-2", 0.3, 0.72, (0.46, 0.61, 0.69, 0.71)),
        ("zyla-5.5", 1.2, 0.91, (0.03, 0.22, 0.67, 0.81)),
    ],
)
def test_information_per_area_over_an_ideal_detector(name, read_e, peak, shares):
    """As computed from normal noise on Poisson electrons, at 10 ms, to two digits."""
    fields = {"read": {"median_e": read_e, "log_sigma": 0.0}, "adc": {"e_per_dn": 0.1}}
    sensor = changed(IMAGE_SENSORS[name], exposure_s=0.01, **fields)
    electrons = peak * np.array([0.001, 0.01, 0.1, 0.3]) * (1e6 * sensor.pitch_m) ** 2
    assert peak * electrons * information(electrons, sensor) == pytest.approx(shares, abs=0.01)


@pytest.mark.parametrize("name", ["orca-quest-2", "ixon-888", "imx174", "spad512-squared"])
def test_corrected_readings_have_the_stated_variance(name):
    """Within 4 standard errors, of n differences 4·√(2/n), and 3 % of the calibration."""
    is_spad = name.startswith("spad")
    electrons, frames = (0.1, 300) if is_spad else (30.0, 1)
    setting = cameras.Setting(SPAD if is_spad else IMAGE_SENSORS[name], frames=frames)
    radiance = light(setting.sensor, electrons, 2)
    read, (slope, offset), _ = cameras.corrected_readings(radiance, BANDS, setting, 0, "test")
    stated = slope * read.mean() + offset
    assert np.var(read[1] - read[0]) / 2 == pytest.approx(stated, rel=4 * np.sqrt(2 / 64**2) + 0.03)
    assert read.mean() == pytest.approx(frames * electrons, rel=0.03)


@pytest.mark.slow
def test_a_small_comparison_has_a_page_and_is_kept(tmp_path):
    shape = {"camera.width": "96", "camera.height": "72", "trajectory.frames": "5"}
    root, out, names = tmp_path / "light", tmp_path / "out", ["orca-quest-2", "spad512-squared"]
    run_stages(root, load("grating", shape | {"render.samples_per_pixel": "16"}), ("render",))
    settings = {"light_levels": (0.01, 10.0), "methods": ("DIS √",), "image_mm": 0.8}
    compared = cameras.compare_cameras([root], out, sensors=(*names, "davis346"), **settings)
    means = summary(compared).set_index(["pixels", "lux", "sensor", "metric"])["value"]
    assert all(0 < means["of 10 µm", 10.0, name, "information"] < 1 for name in names)
    assert 0 < means["as sold", 10.0, "davis346", "error"] < 0.8
    page = write_cameras(out, compared).read_text("utf-8")
    assert page.count("<svg") == 6 and page.count("bound\u00a0–<br>I\u00a0–") == 4
    assert "davis346" not in verdict(summary(compared), "information")

    kept = {path: path.stat().st_mtime_ns for path in (out / "measured").iterdir()}
    words = f"--out {out} --sensors {' '.join(names)} davis346 --light-levels 0.01 10".split()
    cli.main(["benchmark", "cameras", str(root), *words, "--image-mm", "0.8", "--methods", "DIS √"])
    assert kept == {path: path.stat().st_mtime_ns for path in (out / "measured").iterdir()}

    (tmp_path / "color.yaml").write_text("{preset: ideal, name: color, filters: {mosaic: [W]}}")
    with pytest.raises(UserError, match="without color filters"):
        cameras.compare_cameras([root], out, sensors=(str(tmp_path / "color.yaml"),))
