"""What the emulated camera looks at."""

import numpy as np
import pytest

from megalopta.camera.emulator import flat, plate, rendered
from megalopta.camera.motion_bench import OPEN_PHOTONS, passing_rates
from megalopta.config.model import load
from megalopta.render import read_radiance
from megalopta.sensor import detection_rate, preset
from megalopta.stages.run import run_stage

from ..small import small

SENSOR = preset("spadcam")


def test_flat_light_is_detected_as_efficiency_and_fill_factor_say():
    rate = flat(SENSOR, (1e6,)).rates_hz
    # 700 nm is a node of the curve, 0.0011; breakdown mismatch scatters pixels, 16 % at 3 σ. The
    # curve is not straight over the band of 20 nm, but bends by less than 5 %.
    assert np.median(rate) == pytest.approx(1e6 * 0.0011 * 0.1 * SENSOR.lens.transmission, rel=0.3)
    np.testing.assert_allclose(flat(SENSOR, (3e6,)).rates_hz, 3 * rate)
    assert not flat(SENSOR).rates_hz.any()


def test_steps_follow_one_another():
    film = flat(SENSOR, (0.0, 1e6, 4e6), step_s=2.0)
    rate = film.at(np.array([0.0, 1.9, 2.0, 5.0, 6.1])).mean(axis=(1, 2))
    np.testing.assert_allclose(rate / rate[2], [0, 0, 1, 4, 0])


def test_the_plate_is_that_of_the_motion_bench():
    frames = passing_rates(2.0, SENSOR)
    assert frames.max(axis=0).mean() * SENSOR.exposure_s == pytest.approx(OPEN_PHOTONS, rel=0.02)
    times_s = np.array([0.0, 0.1, 0.65, 0.1 * len(frames)])
    seen = plate(SENSOR, 2.0).at(times_s)
    np.testing.assert_array_equal(seen, frames[[0, 1, 6, 0]])


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    out = tmp_path_factory.mktemp("dataset") / "grating"
    return run_stage(out, load("grating", small(40, 34, 3, samples=4)), "render").root


def test_a_dataset_is_seen_through_its_middle(dataset):
    configuration = load("grating", {"camera.width": "40", "camera.height": "34"})
    step_s = 1 / configuration.trajectory.frame_rate_hz
    rate = rendered(SENSOR, dataset).at(np.arange(4) * step_s)
    np.testing.assert_array_equal(rate[3], rate[0])
    (first, *_) = sorted(dataset.rglob("*frame_0001*.exr")) or sorted(dataset.rglob("*.exr"))
    radiance, bands = read_radiance(first)
    # 32 × 32 px from row 1 and column 4 on, in blocks of 2 × 2.
    block = radiance[1:3, 4:6].astype(np.float64).mean(axis=(0, 1))
    image = np.broadcast_to(block, (1, 16, 16, len(bands)))
    assert rate[0, 0, 0] == pytest.approx(detection_rate(image, bands, SENSOR)[0, 0, 0])


def test_light_levels_scale_a_dataset(dataset):
    one, ten = (rendered(SENSOR, dataset, lux).rates_hz for lux in (1.0, 10.0))
    np.testing.assert_allclose(ten, 10 * one)
