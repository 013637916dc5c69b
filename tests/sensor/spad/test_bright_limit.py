"""Daylight: moments in bright light, what every door of a sensor takes for it, and refusals."""

import time

import numpy as np
import pytest

from megalopta.core.errors import UserError
from megalopta.sensor.change import changed
from megalopta.sensor.effects.afterpulsing import Afterpulsing
from megalopta.sensor.effects.dead_time import DeadTime, moments
from megalopta.sensor.exposure import expose_binary, expose_events, expose_rate
from megalopta.sensor.histograms import expose_histograms
from megalopta.sensor.spad.model import AvalancheEffects
from megalopta.sensor.spad.moments import bright_moments, is_limit
from megalopta.sensor.spad.presets import PRESETS

from ..plainest import brute_force_events

TAU_S = 1e-6
ACTIVE = {"kind": "nonparalyzable", "dead_time_s": 1e-7}
PASSIVE = {"kind": "paralyzable", "dead_time_s": 1e-6}
TRAPS = {"mean_carriers": 0.02}
GATE = {"period_s": 1e-4, "width_s": 1e-5}
EFFECTS = {
    "none": {},
    "afterpulses": {"afterpulsing": TRAPS},
    "afterpulses and dead time": {"afterpulsing": TRAPS, "dead_time": ACTIVE},
    "twilight": {"dead_time": ACTIVE | {"twilight_s": 2e-8}},
    "recharging": {"dead_time": ACTIVE | {"recharge_s": 3e-8}},
    "gate": {"gate": GATE, "dead_time": PASSIVE},
    "gate and afterpulses": {"gate": GATE, "dead_time": ACTIVE, "afterpulsing": TRAPS},
    "crosstalk": {"crosstalk": {"mean_fired_neighbors": 0.05}},
    "crosstalk and afterpulses": {
        "crosstalk": {"mean_fired_neighbors": 0.05}, "afterpulsing": TRAPS, "dead_time": ACTIVE,
    },
    "mismatch": {"dead_time": PASSIVE | {"mismatch_sigma": 0.1}, "afterpulsing": TRAPS},
    "stationary": {"dead_time": ACTIVE | {"start": "stationary"}, "afterpulsing": TRAPS},
}  # fmt: skip


@pytest.mark.parametrize("start", ["live", "stationary"])
@pytest.mark.parametrize("per_dead_time", [10.0, 30.0, 100.0, 1000.0])
def test_moments_of_a_renewal_process_are_those_of_dead_time(start, per_dead_time):
    dead_time = DeadTime(kind="nonparalyzable", dead_time_s=TAU_S, start=start)
    effects, rate_hz = AvalancheEffects(dead_time=dead_time), np.array([per_dead_time / TAU_S])
    for dead_times in (500.1, 1000.5, 20_000.0, 1e6):
        mean, variance = bright_moments(rate_hz, dead_times * TAU_S, effects, None)
        exact = moments(rate_hz, dead_times * TAU_S, dead_time)
        assert mean == pytest.approx(exact[0], rel=1e-7)
        assert variance == pytest.approx(exact[1], rel=2e-3, abs=2e-3)


@pytest.mark.slow
@pytest.mark.parametrize("end", [{}, {"twilight_s": 0.3 * TAU_S}, {"recharge_s": 0.5 * TAU_S}])
@pytest.mark.parametrize(("carriers", "delay"), [(0.0, 1.0), (0.1, 0.3), (0.1, 3.0), (0.4, 3.0)])
def test_moments_in_bright_light_are_those_of_single_events(end, carriers, delay):
    dead_time = DeadTime(kind="nonparalyzable", dead_time_s=TAU_S, **end)
    traps = Afterpulsing(mean_carriers=carriers, delay_s=delay * TAU_S)
    effects = AvalancheEffects(dead_time=dead_time, afterpulsing=traps)
    frames, exposure_s = 1500, 7.003e-4
    for per_dead_time in (17.0, 60.0):
        rate_hz = np.full((1, 1), per_dead_time / TAU_S)
        assert is_limit(rate_hz, exposure_s, effects, None).all()
        mean, variance = (part[0, 0] for part in bright_moments(rate_hz, exposure_s, effects, None))
        arrivals_hz = np.full((frames, 1, 1), per_dead_time / TAU_S)
        counts = brute_force_events(np.random.default_rng(1), arrivals_hz, exposure_s, effects)
        # 5.5 standard errors, false alarm 4e-8; stated are 1e-3 and 1e-2, or .02
        assert abs(counts.mean() - mean) < 5.5 * (max(variance, 0.02) / frames) ** 0.5 + 1e-3 * mean
        fourth = max(((counts - counts.mean()) ** 4).mean(), 3 * variance**2)
        off = 5.5 * (fourth / frames) ** 0.5 + max(1e-2 * variance, 0.02)
        assert abs(counts.var() - variance) < off


SLOW = (pytest.param(name, marks=pytest.mark.slow) for name in ("array-12x4", "gersbach-130nm-5v"))


@pytest.mark.parametrize("name", ["spadcam", "ideal", *SLOW])
@pytest.mark.parametrize("effects", EFFECTS)
def test_daylight_is_drawn_from_moments(name, effects):
    # 3e7 detections per second in SPADCAM are daylight on an albedo of .2
    sensor = changed(PRESETS[name], **EFFECTS[effects])
    rate_hz = np.geomspace(1e6, 1e8, 6).reshape(1, 2, 3)
    start = time.process_time()
    counts = expose_rate(rate_hz, sensor, seed=1, stream="a").counts
    assert counts.max() > 0
    # up to 4 s without a table of moments, and compilation; hours at first
    assert time.process_time() - start < 30


STATIONARY = {"dead_time": {"kind": "ideal", "start": "stationary"}}
LONG = {"afterpulsing": {"mean_carriers": 0.5, "delay_s": 10.0}}
REFUSED = {
    "events": (expose_events, {}, {}),
    "free running": (expose_rate, {}, {"free_running": True}),
    "free-running bits": (expose_binary, {}, {"free_running": True}),
    "stationary bits of carriers": (expose_rate, STATIONARY | LONG, {}),
    "strong crosstalk": (
        expose_rate,
        {"crosstalk": {"mean_fired_neighbors": 0.8}, "dead_time": ACTIVE | {"dead_time_s": 1e-8}},
        {},
    ),
}


@pytest.mark.parametrize("door", REFUSED)
def test_light_that_takes_too_long_is_refused_at_once(door):
    draw, effects, how = REFUSED[door]
    sensor = changed(PRESETS["ideal"], **({"dead_time": ACTIVE} | effects))
    # the last of many frames is the bright one
    rate_hz = np.full((20, 60, 80), 1e3)
    rate_hz[-1] = 1e9
    start = time.process_time()
    with pytest.raises(UserError, match="detections and dark counts per second"):
        draw(rate_hz, sensor, seed=1, stream="a", **how)
    assert time.process_time() - start < 2


def test_histograms_of_too_many_bins_are_refused():
    tcspc = {"bins": 65536, "period_s": 1e-6}
    sensor = changed(PRESETS["ideal"], tcspc=tcspc)
    with pytest.raises(ValueError, match="numbers per frame"):
        expose_histograms(np.ones((1, 240, 320)), sensor, seed=1, stream="a")
