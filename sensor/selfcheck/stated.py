"""Stated variances against sums and integrals of their own; nothing is drawn, no chance is left.

dead time       Σ (2n − 1)·P(N >= n) − E[N]², with P the incomplete gamma function
crosstalk       N̄·(1 − Σ w²)·mean over all waves of 1/(1 − ŵ)², ŵ the kernel's transform
    analog counter  Σ P(reading >= n), n − ½ steps being passed by a normal fall, held at the bottom
                    of the swing, and normal read noise
"""

from collections.abc import Iterator

import numpy as np
from scipy.integrate import quad
from scipy.special import gammainc, ndtr

from megalopta.sensor.counters import (
    AnalogCounter,
    AnalogPixels,
    analog_pixels,
    counter_moments,
)
from megalopta.sensor.effects import (
    Crosstalk,
    DeadTime,
    crosstalk,
    dead_time,
)
from megalopta.sensor.sampling import generator
from megalopta.sensor.selfcheck.comparison import Row, exact_row

_TAU_S = 1e-6
_RELATIVE_ERROR = 1e-6
_NORMAL_NODES = np.linspace(-8, 8, 20_001)
_NORMAL_WEIGHTS = np.exp(-(_NORMAL_NODES**2) / 2) / np.exp(-(_NORMAL_NODES**2) / 2).sum()


def check_stated_dead_time() -> Iterator[Row]:
    """Non-paralyzable, settled and not yet, from a live start and running."""
    for a, dead_times in ((0.1, 5.5), (0.1, 60.5), (1.0, 5.5), (1.0, 60.5)):
        rate, exposure = a / _TAU_S, dead_times * _TAU_S
        live = DeadTime(kind="nonparalyzable", dead_time_s=_TAU_S)
        running = live.model_copy(update={"start": "stationary"})
        mean, square = _live_sums(a * dead_times, a)
        # after a count at any time, those of a live start a dead time later
        later, _ = quad(
            lambda left, a=a: _live_sums(left, a)[0],
            0,
            a * (dead_times - 1),
            points=[a * n for n in range(1, int(dead_times) - 1)],
            limit=1000,
        )
        steady = a * dead_times / (1 + a)
        for name, law, expected in (
            ("live", live, (mean, square - mean**2)),
            ("running", running, (steady, 2 * later / (1 + a) + steady - steady**2)),
        ):
            stated = dead_time.moments([rate], exposure, law)
            for moment, right, found in zip(("mean", "variance"), expected, stated, strict=True):
                quantity = f"{moment}, r·τ {a:g}, T/τ {dead_times:g}, {name}"
                yield exact_row(
                    "non-paralyzable, stated",
                    quantity,
                    right,
                    float(found[0]),
                    _RELATIVE_ERROR * right,
                )


def check_stated_crosstalk() -> Iterator[Row]:
    """The middle of an even frame, far from its border; uneven pixels, by matrices."""
    yield _uneven_crosstalk()
    side, light = 61, 5.0
    for talk in (
        Crosstalk(mean_fired_neighbors=0.6),
        Crosstalk(mean_fired_neighbors=0.6, diagonal=0.3, distance_two=0.2, distance_three=0.1),
    ):
        kernel = crosstalk.neighborhood(talk)
        size = len(kernel)
        padded = np.zeros((4 * side, 4 * side))
        padded[:size, :size] = kernel
        waves = np.fft.fft2(np.roll(padded, (-(size // 2), -(size // 2)), (0, 1))).real
        mean = light / (1 - talk.mean_fired_neighbors)
        variance = mean * (1 - float((kernel**2).sum())) * float(np.mean((1 - waves) ** -2.0))
        stated = crosstalk.variance(np.full((side, side), light), talk)
        yield exact_row(
            "crosstalk, stated",
            f"variance, {np.count_nonzero(kernel)} pixels fired by one",
            variance,
            float(stated[side // 2, side // 2]),
            _RELATIVE_ERROR * variance,
        )


def _uneven_crosstalk() -> Row:
    """Frame of pixels that differ in light and in what they send, as one matrix."""
    rng, shape = generator(33), (4, 5)
    light, strength = rng.uniform(1, 9, shape), rng.uniform(0.5, 1.5, shape)
    talk = Crosstalk(mean_fired_neighbors=0.5, diagonal=0.3)
    y, x = np.indices(shape).reshape(2, -1)
    squared = (y[:, None] - y) ** 2 + (x[:, None] - x) ** 2
    shares = np.select([squared == 1, squared == 2], [1.0, 0.3]) / (4 * 1.3)
    chances = 0.5 * shares * strength.ravel()
    response = np.linalg.inv(np.eye(y.size) - chances)
    means = response @ light.ravel()
    noise = light.ravel() + (chances - chances**2) @ means
    expected = (response**2 @ noise).reshape(shape)
    stated = crosstalk.variance(light, talk, strength)
    off = float(np.abs(stated / expected - 1).max())
    quantity = "variance of uneven pixels, largest error"
    return exact_row("crosstalk, stated", quantity, 0.0, off, _RELATIVE_ERROR)


def check_stated_analog() -> Iterator[Row]:
    """Noisy steps and read noise about the bottom of the swing, for known numbers of events."""
    step, capacity, read_noise, step_noise = 0.1, 16, 0.05, 0.01
    counter = AnalogCounter(
        step_v=step, swing_v=1.6, read_noise_v=read_noise, step_noise_v=step_noise
    )
    thresholds = (np.arange(capacity) + 0.5) * step
    for events in (12, 15, 18):
        fall = events * step + step_noise * events**0.5 * _NORMAL_NODES
        passed = ndtr((np.minimum(fall, 1.6)[:, None] - thresholds) / read_noise)
        reached = _NORMAL_WEIGHTS @ passed
        mean = float(reached.sum())
        square = float(((2 * np.arange(capacity) + 1) * reached).sum())
        pixels = analog_pixels(counter, (1, 1), 0.1, 3)
        flat = AnalogPixels(*(each.ravel() for each in pixels))
        stated = counter_moments(counter, flat, 0.1, np.array([events]), np.ones((1, 1)))
        for quantity, expected, found in zip(
            ("mean", "variance"), (mean, square - mean**2), stated, strict=True
        ):
            yield exact_row(
                "analog counter, stated",
                f"{quantity} of readings of {events} events",
                expected,
                float(found[0]),
                _RELATIVE_ERROR * expected,
            )


def check_stated_conversion() -> Iterator[Row]:
    """A coarse ADC after noisy steps: the law of its codes, turned into counts one by one."""
    step, read_noise, step_noise, supply = 0.1, 0.02, 0.01, 3.3
    counter = AnalogCounter(
        step_v=step,
        swing_v=1.6,
        supply_v=supply,
        adc_bits=6,
        read_noise_v=read_noise,
        step_noise_v=step_noise,
    )
    lsb = supply / 63
    codes = np.arange(64)
    counts = np.clip(np.rint((supply - codes * lsb) / step), 0, 16)
    pixels = analog_pixels(counter, (1, 1), 0.1, 3)
    flat = AnalogPixels(*(each.ravel() for each in pixels))
    for events in (3, 10, 16):
        fall = events * step + step_noise * events**0.5 * _NORMAL_NODES
        output = supply - np.minimum(fall, 1.6)
        below = ndtr(((codes[:-1] + 0.5) * lsb - output[:, None]) / read_noise)
        law = np.diff(_NORMAL_WEIGHTS @ below, prepend=0.0, append=1.0)
        mean = float(law @ counts)
        expected = mean, float(law @ (counts - mean) ** 2)
        found = counter_moments(counter, flat, 0.1, np.array([events]), np.ones((1, 1)))
        for quantity, right, got in zip(("mean", "variance"), expected, found, strict=True):
            quantity = f"{quantity} of {events} events through an ADC"
            tolerance = _RELATIVE_ERROR * right
            yield exact_row("analog counter, stated", quantity, right, float(got[0]), tolerance)


def _live_sums(arrivals: float, a: float) -> tuple[float, float]:
    """Mean and mean square of the counts from a live start, summed over P(N >= n)."""
    n = np.arange(1, int(arrivals / a) + 2)
    reached = gammainc(n, np.maximum(arrivals - (n - 1) * a, 0.0))
    return float(reached.sum()), float(((2 * n - 1) * reached).sum())
