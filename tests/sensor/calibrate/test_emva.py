"""Figures of EMVA 1288 of an ideal device against their closed forms."""

import numpy as np
import pytest

from megalopta.sensor import changed, preset
from megalopta.sensor.calibrate.emva import (
    Nonuniformity,
    Step,
    device_emva,
    device_steps,
    emva,
    without_dead_time,
)
from megalopta.sensor.frame.exposure import expose_frames
from megalopta.sensor.frame.model import FRAME_PRESETS, pixels
from megalopta.sensor.sampling.streams import Draw
from megalopta.sensor.spad.device import draw_fixed_pattern

SHAPE, DARK, SPREAD, EFFICIENCY, CAPACITY = (64, 64), 9.0, 2.0, 0.3, 1023
IDEAL = preset("ideal")
PER_COUNT = 1e-12 / IDEAL.active_area_m2 / 1e-3
"""Dark counts per area for one count in the exposure"""
DEVICE = changed(
    IDEAL,
    exposure_s=1e-3,
    efficiency={"wavelengths_nm": (300, 1000), "values": (EFFICIENCY, EFFICIENCY)},
    dark_counts={"bulk_mean_hz_um2": DARK * PER_COUNT, "bulk_sigma_hz_um2": SPREAD * PER_COUNT},
    counter={"kind": "digital", "capacity": CAPACITY},
)
PATTERN = draw_fixed_pattern(DEVICE, SHAPE).dark_counts_hz * DEVICE.exposure_s
"""Mean dark counts of every pixel"""


def test_figures_of_an_ideal_counter():
    found = emva(*device_steps(DEVICE, SHAPE, 550.0))
    # Poisson counts below saturation; the counter's end changes 70 % of its range by nothing
    assert (found.gain, found.efficiency) == pytest.approx((1, EFFICIENCY), rel=1e-6)
    dark_e = np.sqrt(PATTERN.mean())
    assert found.dark_noise == pytest.approx(dark_e, rel=1e-9)
    assert (found.dsnu.total, found.prnu.total) == pytest.approx((PATTERN.std(), 0), abs=1e-9)
    assert found.threshold_photons == pytest.approx((dark_e + 0.5) / EFFICIENCY, rel=1e-9)
    # the variance is largest about two standard deviations below the capacity
    assert CAPACITY - DARK - 4 * 32 < found.saturation_electrons < CAPACITY - DARK
    assert found.linearity_error < 1e-3
    assert found.snr_db == pytest.approx(10 * np.log10(found.saturation_electrons), rel=1e-12)


def test_dark_noise_below_a_reading_is_that_of_the_standards_lower_limit():
    dark_counts = {"bulk_mean_hz_um2": 0.0, "bulk_sigma_hz_um2": 0.0}
    quiet = changed(DEVICE, dark_counts=dark_counts, counter={"capacity": 255})
    dark, steps = device_steps(quiet, (2, 2), 550.0)
    found = emva(dark, steps)
    assert dark.noise == 0
    assert found.threshold_photons == pytest.approx((np.sqrt(0.24) + 0.5) / EFFICIENCY, rel=1e-6)


def test_nonuniform_efficiency_is_prnu(tmp_path):
    factors = np.random.default_rng(1).normal(1, 0.03, SHAPE)
    np.save(tmp_path / "efficiency.npy", factors)
    device = changed(DEVICE, measured={"efficiency": str(tmp_path / "efficiency.npy")})
    found = emva(*device_steps(device, SHAPE, 550.0))
    assert found.prnu.total == pytest.approx(factors.std() / factors.mean(), rel=1e-6)


@pytest.mark.parametrize("kind", ["nonparalyzable", "paralyzable"])
def test_efficiency_is_corrected_for_dead_time(kind):
    # a counter that dead time fills to a half: R/K is a fifth too large
    device = changed(DEVICE, dead_time={"kind": kind, "dead_time_s": 1e-6})
    dark, steps = device_steps(device, SHAPE, 550.0)
    assert emva(dark, steps).efficiency > 1.2 * EFFICIENCY
    factors = without_dead_time(device, SHAPE, 550.0, steps)
    found = emva(dark, steps, factors=factors)
    assert found.efficiency == pytest.approx(EFFICIENCY, rel=1e-4)
    assert found.gain == pytest.approx(1, rel=1e-4)
    few = steps[:40:4]
    found = emva(dark, few, factors=without_dead_time(device, SHAPE, 550.0, few))
    assert found.efficiency == pytest.approx(EFFICIENCY, rel=1e-4)


def test_what_does_not_suffice_is_refused():
    dark, steps = device_steps(DEVICE, SHAPE, 550.0)
    with pytest.raises(ValueError, match="3 levels of light; EMVA 1288 needs 8"):
        emva(dark, steps[:3])
    with pytest.raises(ValueError, match="no brighter than the dark"):
        emva(dark, [dark] * 8)
    with pytest.raises(ValueError, match="do not saturate"):
        device_steps(changed(DEVICE, counter={"capacity": 2**32 - 1}), SHAPE, 550.0)


def test_nonuniformity_splits_into_rows_columns_and_pixels():
    rng, (m, n) = np.random.default_rng(1), (40, 60)
    row, column, pixel = (rng.normal(size=size) for size in ((m, 1), (1, n), (m, n)))
    # of pixels, means over rows and columns are 0; the standard expects their variance over n and m
    pixel -= pixel.mean(axis=0) + pixel.mean(axis=1, keepdims=True) - pixel.mean()
    pattern = 100 + 3 * row / row.std() + 2 * column / column.std() + 5 * pixel / pixel.std()
    rest = m * n - m - n
    expected = np.array([38, 9 - 25 * m / rest, 4 - 25 * n / rest, 25 * m * n / rest])
    found = np.square(Nonuniformity.of(pattern, 7.0, 2.0))  # of which 7 are noise, as of pixels
    np.testing.assert_allclose(4 * found, expected - (7, 0, 0, 7), rtol=1e-9)
    assert found[0] == pytest.approx(found[1:].sum(), rel=1e-12)


IMX900 = FRAME_PRESETS["imx900-high-gain"]


@pytest.mark.parametrize("name", FRAME_PRESETS)
def test_exact_figures_of_a_frame_camera_are_its_parameters(name):
    camera, shape = FRAME_PRESETS[name], (32, 32)
    eta, em, device = max(camera.efficiency.values), camera.em, pixels(camera, shape)
    at = shape, camera.efficiency.wavelengths_nm[camera.efficiency.values.index(eta)]
    found, dark_e, gain = device_emva(camera, *at), device.dark_e.mean(), em.gain
    k, read_e2 = gain / camera.adc.e_per_dn, np.mean(device.read_e**2) / gain**2
    assert (found.efficiency, found.gain) == pytest.approx((eta, k), rel=1e-3)
    assert found.dark_noise**2 == pytest.approx(read_e2 + em.excess_noise * dark_e, rel=1e-3)
    assert found.dark_current == pytest.approx(camera.dark.now_e_s, rel=0.01)
    assert found.dsnu.total == pytest.approx(device.offset_e.std() / gain, rel=0.01)
    assert found.prnu.total == pytest.approx(device.response.std(), rel=0.01, abs=1e-12)
    end_e = min(camera.full_well_e, (camera.adc.largest_dn - camera.adc.black_dn) / k)
    saturation_e = found.saturation_electrons
    well_e = saturation_e + 2.8 * np.sqrt(em.excess_noise * saturation_e)  # frame-camera.md
    assert well_e == pytest.approx(end_e, rel=0.01)
    # by the rules of the standard; the threshold is of signal and noise, so F² does not change it
    plain = emva(*device_steps(camera, *at), rounding=1 / 12)
    assert plain.gain == pytest.approx(found.excess_noise * k, rel=1e-3)
    assert plain.threshold_photons == pytest.approx(found.threshold_photons, rel=1e-3)


@pytest.mark.parametrize(("name", "threshold"), [("low", 6.692), ("high", 2.782)])
def test_thresholds_of_the_imx900_are_those_of_its_sheet(name, threshold):
    camera = changed(FRAME_PRESETS[f"imx900-{name}-gain"], dark={"mean_e_s": 0.0})
    found = device_emva(camera, SHAPE, 536.0)
    assert found.threshold_photons == pytest.approx(threshold, rel=5e-4)


def test_photon_transfer_of_drawn_frames_gives_gain_and_dark_noise():
    dark, steps = device_steps(IMX900, SHAPE, 536.0)
    drawn, n = [], 50
    for step in (dark, *steps[:35:3]):
        light_hz = np.full((n, *SHAPE), 0.8847 * step.photons / IMX900.exposure_s)
        electrons = expose_frames(light_hz, IMX900, Draw(1, "emva"))[0].counts
        drawn.append(Step.of(step.photons, electrons / IMX900.adc.e_per_dn))
    found = emva(drawn[0], drawn[1:], rounding=1 / 12)
    level, noise = np.array([(step.level - drawn[0].level, step.noise) for step in drawn[1:]]).T
    relative = np.sqrt(2 / ((n - 1) * np.prod(SHAPE)))  # standard error of a variance
    gain_error = relative * np.sqrt(np.sum((level * noise) ** 2)) / np.sum(level**2)
    assert found.gain == pytest.approx(1.673, abs=3 * gain_error)
    dark_e = np.sqrt(1.954**2 + 1.473 * IMX900.exposure_s)
    error = np.hypot(relative / 2, gain_error / 1.673)
    assert found.dark_noise == pytest.approx(dark_e, rel=3 * error)
