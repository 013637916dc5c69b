"""Figures of EMVA 1288 of an ideal device against their closed forms."""

import numpy as np
import pytest

from megalopta.sensor import changed, expose_rate, preset
from megalopta.sensor.calibrate.emva import Step, device_steps, emva, without_dead_time
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
    assert found.gain == pytest.approx(1, rel=1e-6)
    assert found.efficiency == pytest.approx(EFFICIENCY, rel=1e-6)
    assert found.dark_noise == pytest.approx(np.sqrt(PATTERN.mean()), rel=1e-9)
    assert found.dsnu == pytest.approx(PATTERN.std(), rel=1e-9)
    assert found.prnu == pytest.approx(0, abs=1e-9)
    assert found.threshold_photons == pytest.approx(
        (np.sqrt(PATTERN.mean()) + 0.5) / EFFICIENCY, rel=1e-9
    )
    # the variance is largest about two standard deviations below the capacity
    assert CAPACITY - DARK - 4 * 32 < found.saturation_electrons < CAPACITY - DARK
    assert found.linearity_error < 1e-3
    assert found.snr_db == pytest.approx(10 * np.log10(found.saturation_electrons), rel=1e-12)


def test_dark_noise_below_a_reading_is_that_of_the_standards_lower_limit():
    counter = {"kind": "digital", "capacity": 255}
    quiet = changed(
        DEVICE, dark_counts={"bulk_mean_hz_um2": 0.0, "bulk_sigma_hz_um2": 0.0}, counter=counter
    )
    dark, steps = device_steps(quiet, (2, 2), 550.0)
    found = emva(dark, steps)
    assert dark.noise == 0
    assert found.threshold_photons == pytest.approx((np.sqrt(0.24) + 0.5) / EFFICIENCY, rel=1e-6)


def _recorded(device, dark, steps, frames):
    seen = []
    for at, level in enumerate([dark, *steps]):
        rate = np.full((frames, *SHAPE), EFFICIENCY * level.photons / device.exposure_s)
        counts = expose_rate(rate, device, seed=at, stream="emva").counts
        seen.append(Step.of(level.photons, counts))
    return seen


def test_recorded_steps_give_the_figures_of_the_device():
    dark, steps = device_steps(DEVICE, SHAPE, 550.0)
    steps = steps[::4]
    seen = _recorded(DEVICE, dark, steps, frames=200)
    own, found = emva(dark, steps), emva(seen[0], seen[1:])
    # n = 4096 pixels × 200 frames a level: 5 standard errors of a variance, √(2/n), are 0.8 %
    assert found.gain == pytest.approx(own.gain, rel=0.008)
    assert found.efficiency == pytest.approx(own.efficiency, rel=0.008)
    assert found.dark_noise == pytest.approx(own.dark_noise, rel=0.008)
    # of a standard deviation over pixels, 5/√(2·4096)
    assert found.dsnu == pytest.approx(own.dsnu, rel=0.06)


def test_nonuniform_efficiency_is_prnu(tmp_path):
    factors = np.random.default_rng(1).normal(1, 0.03, SHAPE)
    np.save(tmp_path / "efficiency.npy", factors)
    device = changed(DEVICE, measured={"efficiency": str(tmp_path / "efficiency.npy")})
    found = emva(*device_steps(device, SHAPE, 550.0))
    assert found.prnu == pytest.approx(factors.std() / factors.mean(), rel=1e-6)


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
    recorded = _recorded(device, dark, steps[:40:4], frames=100)
    factors = without_dead_time(device, SHAPE, 550.0, recorded[1:])
    # n = 4096 pixels × 100 frames a level: 5 standard errors of a variance are 1.1 %
    found = emva(recorded[0], recorded[1:], factors=factors)
    assert found.efficiency == pytest.approx(EFFICIENCY, rel=0.011)


def test_what_does_not_suffice_is_refused():
    dark, steps = device_steps(DEVICE, SHAPE, 550.0)
    with pytest.raises(ValueError, match="3 levels of light; EMVA 1288 needs 8"):
        emva(dark, steps[:3])
    with pytest.raises(ValueError, match="no brighter than the dark"):
        emva(dark, [dark] * 8)
    with pytest.raises(ValueError, match="do not saturate"):
        device_steps(changed(DEVICE, counter={"capacity": 2**32 - 1}), SHAPE, 550.0)
