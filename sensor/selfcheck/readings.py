"""Mean and variance of readings, stated against drawn: every preset, and what counters do."""

from collections.abc import Iterator
from functools import partial

import numpy as np
from scipy.special import comb
from scipy.stats import poisson

from megalopta.core.arrays import Floats
from megalopta.sensor import changed, event_moments
from megalopta.sensor.counters import AnalogCounter, DigitalCounter
from megalopta.sensor.ctia import (
    CTIA_PRESETS,
    CtiaNoise,
    CtiaSensor,
    expose_photocurrent,
    volt_moments,
)
from megalopta.sensor.effects import DeadTime
from megalopta.sensor.selfcheck.comparison import Check, Row, exact_row
from megalopta.sensor.spad import PRESETS, Sensor, expose_rate, reading_moments

_SIDE = 20
_CAPACITY = 15
_ANALOG = AnalogCounter(step_v=0.1, swing_v=1.6)
_SPREAD = changed(
    _ANALOG, adc_bits=7, step_sigma_v=5e-3, leak_v_s=0.5, leak_sigma_v_s=0.05, offset_sigma_v=0.05
)
_FINE = AnalogCounter(step_v=0.03, step_sigma_v=6e-4, read_noise_v=1e-3, adc_bits=12)
_DEAD = DeadTime(kind="nonparalyzable", dead_time_s=2e-3)
_STRONG = DeadTime(kind="paralyzable", dead_time_s=2e-3)

# name, what differs from a perfect sensor, arrivals in an exposure
_CASES: tuple[tuple[str, dict[str, object], float], ...] = (
    ("saturating", {"counter": DigitalCounter(capacity=_CAPACITY)}, 14.0),
    ("wrapping", {"counter": DigitalCounter(capacity=_CAPACITY, overflow="wrap")}, 14.0),
    (
        "wrapping seven times",
        {"counter": DigitalCounter(capacity=_CAPACITY, overflow="wrap")},
        120.0,
    ),
    ("one bit", {"counter": DigitalCounter(capacity=1)}, 1.5),
    (
        "saturating, non-paralyzable",
        {"counter": DigitalCounter(capacity=_CAPACITY), "dead_time": _DEAD},
        18.0,
    ),
    (
        "wrapping, non-paralyzable, running",
        {
            "counter": DigitalCounter(capacity=_CAPACITY, overflow="wrap"),
            "dead_time": changed(_DEAD, start="stationary"),
        },
        20.0,
    ),
    (
        "saturating, paralyzable",
        {"counter": DigitalCounter(capacity=_CAPACITY), "dead_time": _STRONG},
        40.0,
    ),
    (
        "saturating, paralyzable, running",
        {
            "counter": DigitalCounter(capacity=_CAPACITY),
            "dead_time": changed(_STRONG, start="stationary"),
        },
        90.0,
    ),
    ("analog", {"counter": _ANALOG}, 14.0),
    ("analog, uneven, calibrated", {"counter": _SPREAD}, 14.0),
    ("analog, uneven, uncalibrated", {"counter": changed(_SPREAD, calibrated=False)}, 12.0),
    ("analog, noise of half a step", {"counter": changed(_ANALOG, read_noise_v=0.05)}, 3.0),
    (
        "analog, half a step, dead time",
        {"counter": changed(_ANALOG, read_noise_v=0.05, adc_bits=8), "dead_time": _DEAD},
        16.0,
    ),
    ("analog, steps that shrink", {"counter": changed(_ANALOG, step_slope=0.5)}, 12.0),
    (
        "analog, noisy steps",
        {"counter": changed(_ANALOG, step_noise_v=0.011, read_noise_v=0.03)},
        16.0,
    ),
)


def reading_checks(exposures: int = 40_000) -> tuple[Check, ...]:
    """Return a check for every preset and every case, each of about so many exposures."""
    spads = [(name, sensor, 60.0) for name, sensor in PRESETS.items()]
    spads += [
        (f"reading, {name}", changed(PRESETS["ideal"], **changes), arrivals)
        for name, changes, arrivals in _CASES
    ]
    return (
        *(partial(_spad_rows, *case, exposures) for case in spads),
        *(partial(_ctia_rows, name, sensor, exposures) for name, sensor in CTIA_PRESETS.items()),
    )


def check_few_events() -> Iterator[Row]:
    """Events more regular than chance, which no counter cuts: readings have their moments.

    From three nearly as regular as a clock to forty that are nearly Poisson.
    """
    ideal = PRESETS["ideal"]
    for dead_times, a, capacity in ((3.3, 5.0, 5), (30.0, 2.0, 35), (200.0, 0.25, 90)):
        dead_s = ideal.exposure_s / dead_times
        sensor = changed(
            ideal,
            dead_time=DeadTime(kind="nonparalyzable", dead_time_s=dead_s, twilight_s=dead_s / 100),
        )
        rate = np.full((1, 1, 1), a / dead_s)
        expected = event_moments(rate, sensor)
        found = reading_moments(rate, changed(sensor, counter=DigitalCounter(capacity=capacity)))
        for name, right, got in zip(("mean", "variance"), expected, found, strict=True):
            value = float(right.sum())
            quantity = f"{name} of readings of {expected[0].item():.0f} events"
            yield exact_row("law of events", quantity, value, float(got.sum()), 1e-6 * value)


def check_paralyzable_law() -> Iterator[Row]:
    """Readings that stop at one to three counts, against the law of arrivals a dead time apart.

    Of m arrivals in an exposure T, live at its start, those count that come more than τ after the
    one before: with l = 1 − (n − 1 + j)·τ/T where that is positive,

        P(n) = Σ_m e^(−x)·x^m/m! · C(m − 1, n − 1) · Σ_j (−1)^j·C(m − n, j)·l^m.
    """
    ideal = PRESETS["ideal"]
    for x, dead in ((0.5, 0.1), (2.0, 0.04), (2.0, 0.3)):
        sensor = changed(
            ideal, dead_time=DeadTime(kind="paralyzable", dead_time_s=dead * ideal.exposure_s)
        )
        below = np.cumsum([np.exp(-x), *(_paralyzable_chance(n, x, dead) for n in (1, 2))])
        for capacity in (1, 2, 3):
            reached = 1 - below[:capacity]
            mean = float(reached.sum())
            square = float((2 * np.arange(capacity) + 1) @ reached)
            found = reading_moments(
                np.full((1, 1, 1), x / ideal.exposure_s),
                changed(sensor, counter=DigitalCounter(capacity=capacity)),
            )
            for name, right, got in zip(
                ("mean", "variance"), (mean, square - mean**2), found, strict=True
            ):
                quantity = f"{name}, {x:g} arrivals, τ/T {dead:g}, stops at {capacity}"
                yield exact_row("paralyzable, law", quantity, right, float(got.sum()), 1e-6)


def _paralyzable_chance(n: int, x: float, dead: float) -> float:
    total = 0.0
    for m in range(n, 40):
        j = np.arange(m - n + 1)
        left = np.maximum(1 - (n - 1 + j) * dead, 0.0) ** m
        apart = comb(m - 1, n - 1) * np.sum((-1.0) ** j * comb(m - n, j) * left)
        total += float(poisson.pmf(m, x) * apart)
    return total


def check_tabulated_laws() -> Iterator[Row]:
    """Analog pixels that differ, half of them full: from a table of laws, and few one by one."""
    sensor = changed(PRESETS["ideal"], counter=_FINE)
    rate = np.full((1, 32, 32), 105 / sensor.exposure_s)
    some = reading_moments(rate, sensor)
    others = reading_moments(rate[:, :6, :6], sensor)
    for name, one, other in zip(("mean", "variance"), some, others, strict=True):
        off = float(np.abs(one[:, :6, :6] / other - 1).max())
        yield exact_row("law of events", f"{name} from a table, largest error", 0.0, off, 1e-4)


def check_full_swing() -> Iterator[Row]:
    """A CTIA whose readings its noise takes to the end of the swing and back: ∫ min(v + σz, rail).

    Drawn, and by a sum over the normal law of the noise.
    """
    ctia = changed(CTIA_PRESETS["ctia_si"], noise=CtiaNoise(read_noise_v=0.02))
    still = CtiaNoise(photon_shot=False, dark_shot=False, reset=False)
    z = np.linspace(-8, 8, 200_001)
    weights = np.exp(-(z**2) / 2) / np.exp(-(z**2) / 2).sum()
    for name, share in (("below", 0.98), ("close to", 0.995)):
        term = f"reading, {name} full swing"
        yield from _ctia_rows(term, ctia, 40_000, share)
        light = np.full((1, 1, 1), share * ctia.swing_v * ctia.capacitance_f / ctia.exposure_s)
        free = volt_moments(light, changed(ctia, noise=still))[0].item()
        found = volt_moments(light, changed(ctia, noise=changed(still, read_noise_v=0.02)))
        volts = np.minimum(free + 0.02 * z, ctia.swing_v)
        mean = float(weights @ volts)
        for quantity, right, got in zip(
            ("mean (V)", "variance (V²)"),
            (mean, float(weights @ (volts - mean) ** 2)),
            found,
            strict=True,
        ):
            yield exact_row(term, f"stated {quantity}", right, got.item(), 1e-6 * right)


def _spad_rows(name: str, sensor: Sensor, arrivals: float, exposures: int) -> Iterator[Row]:
    rate = np.full((exposures // _SIDE**2, _SIDE, _SIDE), arrivals / sensor.exposure_s)
    counts = expose_rate(rate, sensor, seed=4, sequence=name).counts
    mean, variance = reading_moments(rate[:1], sensor)
    return _rows(name, sensor.unit, counts.astype(np.float64), mean, variance)


def _ctia_rows(name: str, sensor: CtiaSensor, exposures: int, share: float = 0.3) -> Iterator[Row]:
    """Two frames in which light alone takes pixels to a share of the swing and somewhat further."""
    side = int(exposures**0.5)
    light = np.full((2, side, side), share * sensor.swing_v * sensor.capacitance_f)
    light[1] *= 1.1 if share < 0.9 else 1.01
    light /= sensor.exposure_s
    volts = expose_photocurrent(light, sensor, seed=4, sequence=name, first_frame=9).volts
    return _rows(name, "V", volts, *volt_moments(light, sensor, first_frame=9))


def _rows(name: str, unit: str, drawn: Floats, mean: Floats, variance: Floats) -> Iterator[Row]:
    """Compare independent readings, each of a mean and variance of its own."""
    deviation = drawn - mean
    z = deviation.mean() / np.sqrt(variance.mean() / deviation.size)
    yield Row(name, f"mean reading ({unit})", float(mean.mean()), float(drawn.mean()), float(z))
    excess = deviation**2 - variance
    z = excess.sum() / (excess.std() * excess.size**0.5)
    stated, found = float(variance.mean()), float((deviation**2).mean())
    yield Row(name, f"variance of the reading ({unit}²)", stated, found, float(z))
