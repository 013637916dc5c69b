"""Corrected frames against the true photon image: mean, variance, hot pixels, what is refused.

Means over n frames are held to 5 standard errors of the mean and 0.5 %; |z| < 5 fails with
probability 6e-7.
"""

import numpy as np
import pytest

from megalopta.sensor import DeadTime, DigitalCounter, changed, expose_rate, preset
from megalopta.sensor.calibrate.correction import (
    calibrate,
    correct,
    filled_in,
    response_curve,
    simulated_calibration,
)
from megalopta.sensor.frame.exposure import expose_frames
from megalopta.sensor.frame.model import FRAME_PRESETS, FrameSensor
from megalopta.sensor.sampling.streams import Draw
from megalopta.sensor.spad.device import draw_fixed_pattern

SHAPE = (8, 16)
FRAMES = 500
SENSORS = {
    "spadcam": preset("spadcam"),
    "nonparalyzable": changed(
        preset("ideal"),
        dead_time=DeadTime(kind="nonparalyzable", dead_time_s=1e-3),
        counter=DigitalCounter(capacity=90),
    ),
    "paralyzable": changed(
        preset("ideal"), dead_time=DeadTime(kind="paralyzable", dead_time_s=1e-3)
    ),
    "frame": changed(
        FRAME_PRESETS["imx900-high-gain"],
        dark={"mean_e_s": 50.0, "log_sigma": 2.0},
        pattern={"dsnu_row_e": 2.0, "prnu_pixel": 0.05, "prnu_column": 0.03},
        lag_share=0.02,
    ),
}


@pytest.fixture(scope="module")
def calibrations():
    return {name: simulated_calibration(each, SHAPE, frames=300) for name, each in SENSORS.items()}


def exposed(sensor, share, curve):
    """Frames of a ramp of which the brightest column reads a share of the largest reading."""
    brightest = float(curve.arrivals_of(np.array([share * curve.largest]))[0])
    scene = np.broadcast_to(brightest * np.linspace(0.2, 1, SHAPE[1]), SHAPE)
    rate = np.broadcast_to(scene / sensor.exposure_s, (FRAMES, *SHAPE))
    if isinstance(sensor, FrameSensor):
        return scene, expose_frames(rate, sensor, Draw(1, "ramp"))[0]
    rate = rate * draw_fixed_pattern(sensor, SHAPE).efficiency_factor
    return scene, expose_rate(rate, sensor, seed=1, stream="ramp")


@pytest.mark.parametrize("share", [0.1, 0.5, 0.8])
@pytest.mark.parametrize("name", list(SENSORS))
def test_corrected_frames_are_the_photons_on_average_with_the_stated_variance(
    name, share, calibrations
):
    calibration = calibrations[name]
    scene, exposure = exposed(SENSORS[name], share, calibration.curve)
    corrected = correct(exposure.counts, exposure.saturated, calibration)
    good = ~corrected.filled.any(axis=0)
    assert good.mean() > 0.4
    mean, true = corrected.detections.mean(axis=0)[good], scene[good]
    of_gain = scene**2 * calibration.gain_variance
    calibrated = (calibration.dark_variance + of_gain) / calibration.gain**2
    # of a pixel: its own noise and that of its calibration
    noise = (corrected.detections.var(axis=0) / FRAMES + calibrated)[good]
    assert abs(mean.sum() / true.sum() - 1) < 0.005 + 5 * np.sqrt(noise.sum()) / true.sum()
    z = (mean - true) / np.sqrt(noise)
    assert np.sqrt(np.mean(z**2)) == pytest.approx(1, abs=5 / np.sqrt(2 * good.sum()))
    stated = (corrected.variance.mean(axis=0) - calibrated)[good].sum()
    assert corrected.detections.var(axis=0)[good].sum() / stated == pytest.approx(1, abs=0.05)


def test_the_curve_is_that_of_dead_time():
    for name, mean_of in (
        ("nonparalyzable", lambda r, tau: r / (1 + r * tau)),
        ("paralyzable", lambda r, tau: r * (1 - tau) * np.exp(-r * tau) + 1 - np.exp(-r * tau)),
    ):
        sensor = changed(SENSORS[name], counter=DigitalCounter())
        tau = sensor.dead_time.dead_time_s / sensor.exposure_s
        curve = response_curve(sensor)
        # From a live start up to one event more is counted than in the stationary limit.
        atol = 0.5 if name == "nonparalyzable" else 1e-9
        np.testing.assert_allclose(curve.mean, mean_of(curve.arrivals, tau), rtol=1e-9, atol=atol)


def test_dim_and_bright_readings_of_a_paralyzable_pixel_are_ambiguous_near_its_peak(calibrations):
    calibration = calibrations["paralyzable"]
    readings = np.full((1, *SHAPE), 0.95 * calibration.curve.largest)
    full = np.zeros(readings.shape, bool)
    assert correct(readings, full, calibration).ambiguous.all()
    assert not correct(readings / 10, full, calibration).ambiguous.any()


def counted(dark):
    """100 dark frames with these counts in all of them, and as many flat ones."""
    frames = np.diff(np.arange(101)[:, None, None] * dark // 100, axis=0)
    return frames, np.random.default_rng(0).poisson(50, frames.shape)


def test_hot_pixels_are_those_beyond_the_median():
    dark = np.full((4, 5), 100.0)
    dark[1, 2] = 3000
    assert np.argwhere(calibrate(*counted(dark), preset("ideal")).bad).tolist() == [[1, 2]]
    with pytest.raises(ValueError, match="hot_times"):
        calibrate(*counted(np.array([[1.0, 90, 90, 90]])), preset("ideal"), hot_times=0.5)


@pytest.mark.parametrize("capacity", [3, 15])
def test_gains_of_small_counters_are_those_of_equal_pixels(capacity):
    """At half of the largest reading, 14 and 0.9 % of the readings are cut off. |z| < 6: 2e-9."""
    found = simulated_calibration(
        changed(preset("ideal"), counter=DigitalCounter(capacity=capacity)), (64, 64)
    )
    assert not found.bad.any()
    assert abs(found.gain.mean() - 1) < 6 * np.sqrt(found.gain_variance.mean() / 64**2)


@pytest.mark.parametrize(
    ("capacity", "share", "darker"),
    [(15, 0.3, 0.002), (15, 0.5, 0.026), (15, 0.7, 0.1), (63, 0.7, 0.006), (63, 0.8, 0.028)],
)
def test_frames_near_capacity_are_as_much_too_dark_as_documented(capacity, share, darker):
    """docs/how-to/correct.md; |z| < 5 over all pixels and frames."""
    sensor = changed(preset("ideal"), counter=DigitalCounter(capacity=capacity))
    calibration = simulated_calibration(sensor, SHAPE, frames=1000)
    mean = share * capacity
    rate = np.full((FRAMES, *SHAPE), mean / sensor.exposure_s)
    exposure = expose_rate(rate, sensor, seed=1, stream="even")
    found = correct(exposure.counts, exposure.saturated, calibration).detections.mean() / mean
    error = np.sqrt((1 / FRAMES + 2 / 1000) / (mean * np.prod(SHAPE)))
    assert found == pytest.approx(1 - darker, abs=0.002 + 5 * error)


def test_a_hole_is_the_mean_of_its_neighbors_with_their_variance():
    values = np.arange(25.0).reshape(1, 5, 5)
    bad = np.zeros((5, 5), bool)
    bad[2, 2] = True
    filled, variance = filled_in(values, np.ones_like(values), bad)
    assert filled[0, 2, 2] == pytest.approx(12)  # a plane is kept
    # weights 1 across an edge, ½ across a corner: (4·1 + 4·¼)/(4 + 2)²
    assert variance[0, 2, 2] == pytest.approx(5 / 36)
    np.testing.assert_array_equal(filled[0][~bad], values[0][~bad])
    # wide holes are filled, and frames without any good pixel stay
    holes = np.stack([np.pad(np.ones((5, 5), bool), 2), np.ones((9, 9), bool)])
    values = np.where(holes, 100.0, 3.0)
    filled, _ = filled_in(values, np.ones_like(values), holes)
    assert np.allclose(filled[0], 3.0) and np.all(filled[1] == 100.0)


@pytest.mark.parametrize(
    ("dark", "flat", "sentence"),
    [
        (np.zeros((1, 4, 4)), np.zeros((5, 4, 4)), "two or more"),
        (np.zeros((5, 4, 4)), np.zeros((5, 4, 5)), "of one device"),
        (np.zeros((5, 4, 4)), np.zeros((5, 4, 4)), "too dark or too bright"),
        (np.zeros((5, 4, 4)), np.full((5, 4, 4), 1e9), "too dark or too bright"),
    ],
)
def test_what_does_not_suffice_is_refused(dark, flat, sentence, calibrations):
    with pytest.raises(ValueError, match=sentence):
        calibrate(dark, flat, SENSORS["nonparalyzable"])
    with pytest.raises(ValueError, match="one event saturates"):
        simulated_calibration(changed(preset("ideal"), counter=DigitalCounter(capacity=1)), SHAPE)
    for counts, full, words in (
        (np.zeros((3, 4, 4)), np.zeros((3, 4, 4)), "that were calibrated"),
        (np.zeros((3, *SHAPE)), np.zeros((2, *SHAPE)), "saturated"),
    ):
        with pytest.raises(ValueError, match=words):
            correct(counts, full, calibrations["spadcam"])
