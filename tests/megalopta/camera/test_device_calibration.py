"""Recordings to a device file that a sensor is loaded from, and a report."""

from dataclasses import replace

import numpy as np
import pytest

from megalopta.camera.calibrating import calibrate_recordings
from megalopta.camera.calibration import adc_of, primary, write_device
from megalopta.camera.recording import Beam, Source, read_recorded
from megalopta.core.errors import UserError
from megalopta.sensor import (
    changed,
    expose_rate,
    load_sensor,
    preset,
)
from megalopta.sensor.calibrate.device import Estimate, calibrate_device
from megalopta.sensor.calibrate.level import Level
from megalopta.sensor.calibrate.neighbors import Kernel
from megalopta.sensor.spad.device import draw_fixed_pattern

from ..recordings import write_recording

pytestmark = pytest.mark.slow

SHAPE = (16, 16)
DARK_EXPOSURES_S = (1e-3, 3e-3, 0.01, 0.03, 0.1)
LIGHTS_HZ = (2e8, 1e9, 4e9)
SENSOR = changed(preset("spadcam"), device_seed=9)
EFFICIENCY = 1.1e-4
"""Of the photons on a pixel at 700 nm: 0.11 % on a tenth of its area."""


def recorded(folder, exposure_s, light_hz, frames=100, seed=0):
    """A recording of codes that counts and read noise make."""
    sensor = changed(SENSOR, exposure_s=exposure_s)
    pattern, counter = draw_fixed_pattern(sensor, SHAPE), sensor.counter
    rates = np.broadcast_to(light_hz * EFFICIENCY * pattern.efficiency_factor, (frames, *SHAPE))
    counts = expose_rate(rates, sensor, seed=seed, stream=folder.name).counts
    volts = counter.supply_v - counts * pattern.counters.step_v - pattern.counters.leaked_v
    noise = np.random.default_rng(seed + round(1e6 * exposure_s)).normal(0, 1e-3, volts.shape)
    codes = np.rint((volts + noise) / counter.lsb_v).clip(0, 4095).astype(np.uint16)
    return Source(write_recording(folder, sensor, codes), light_hz)


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory):
    """Folder of recordings and the device file from them."""
    folder = tmp_path_factory.mktemp("camera")
    levels = [(exposure, 0.0) for exposure in DARK_EXPOSURES_S]
    levels += [(2e-4, light) for light in LIGHTS_HZ]
    sources = [recorded(folder / f"{at}", *each) for at, each in enumerate(levels)]
    sentence = calibrate_recordings(sources, folder / "device.yaml", beam=Beam(700.0))
    return folder, sources, sentence


def test_the_device_file_loads_with_its_maps(calibrated):
    folder, _, sentence = calibrated
    device = load_sensor(folder / "device.yaml")
    found, truth = (draw_fixed_pattern(each, SHAPE) for each in (device, SENSOR))
    # a pixel's dark counts are known to 1 to 2 %, its efficiency to 1.5 %, its step to 0.02 %
    np.testing.assert_allclose(found.dark_counts_hz, truth.dark_counts_hz, rtol=0.15)
    np.testing.assert_allclose(found.efficiency_factor, truth.efficiency_factor, rtol=0.1)
    np.testing.assert_allclose(found.counters.step_v, truth.counters.step_v, rtol=2e-3)
    assert device.dead_time.kind == "paralyzable"
    assert "256 of 256 pixels" in sentence
    page = (folder / "device.html").read_text("utf-8")
    assert "Saturation" in page
    assert "absolute sensitivity threshold" in page


def test_crosstalk_and_afterpulses_of_the_device_file_make_what_was_counted(calibrated, tmp_path):
    _, sources, _ = calibrated
    levels = [Level(read_recorded(s).codes, read_recorded(s).exposure_s, s.light) for s in sources]
    device = calibrate_device(levels, adc_of(SENSOR))
    share = np.array([0.01, 0.01, 2e-3, 2e-3, 0, 0])
    kernel = Kernel(share, np.full(6, 1e-4), afterpulses=0.05, afterpulses_error=1e-3)
    path = tmp_path / "fired.yaml"
    write_device(path, replace(device, kernel=kernel), preset("spadcam"), 700.0, "spadcam")
    found = changed(load_sensor(path), exposure_s=0.05)
    assert found.crosstalk.mean_fired_neighbors == pytest.approx(2 * share.sum())
    assert found.crosstalk.diagonal == pytest.approx(0.2)
    counts = expose_rate(np.zeros((150, *SHAPE)), found, seed=1, stream="dark").counts
    # 150 000 events, of a variance a quarter above Poisson's: 5 standard errors are 1.5 %; dead
    # time hides 0.03 %, and of afterpulses, a second time, below 0.1 %
    expected = device.dark_counts_hz.value.mean()
    assert counts.mean() / 0.05 == pytest.approx(expected, rel=0.016)


def test_light_of_a_beam():
    # dissertation §2.4.5: 17.5 nW over 100 mm² at 450 nm are 396 photons per µm² and second
    pixel = changed(preset("spadcam"), pitch_m=1e-6)
    assert Beam(450, 100).photons_hz(17.5e-9, pixel) == pytest.approx(396, rel=2e-3)


@pytest.mark.parametrize("text", ["flat@bright", "flat@-1", "flat@1:0"])
def test_impossible_light_is_refused(text):
    with pytest.raises(UserError):
        Source.parse(text)


def test_a_missing_recording_is_told(tmp_path):
    with pytest.raises(UserError, match="nothing"):
        calibrate_recordings([Source(tmp_path / "nothing")], tmp_path / "a.yaml", beam=Beam())


def test_intervals_include_the_error_of_what_crosstalk_adds(calibrated):
    folder, _, _ = calibrated
    dark = np.load(folder / "device" / "dark_counts.npy")
    sure = Estimate(dark, dark, dark)
    kernel = Kernel(np.array([0.01, 0.01, 0, 0, 0, 0]), np.full(6, 1e-3), np.nan, np.nan)
    found = primary(sure, kernel)
    # of 4 neighbors at 1 % each; the total has an error of 2·√6·0.1 % of an event
    half = 1.959964 * (dark - found.value) * 2 * np.sqrt(6) * 1e-3 / 0.04
    np.testing.assert_allclose(found.high - found.value, half)
    np.testing.assert_allclose(found.value - found.low, half)
