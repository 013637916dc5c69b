"""Fixed pattern of a device's pixels, the same in every frame, run and machine.

The effects on rates draw it from the device seed, or read it from measured maps, in turn
(`Effect.act_on_rates`): they describe pixels, not exposures.
"""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from megalopta.core.arrays import Floats
from megalopta.core.compiling import compiled
from megalopta.sensor.effects.base import AvalancheMaps, Effect, FrameRates, PixelRates
from megalopta.sensor.effects.dead_time import MOST_ARRIVALS
from megalopta.sensor.optics.pixels import check_brightness, detected_rate
from megalopta.sensor.spad.counters import AnalogCounter, AnalogPixels, analog_pixels
from megalopta.sensor.spad.model import MOST_OFFSPRING, Sensor, effects_of


@dataclass(eq=False)
class FixedPattern(PixelRates):
    """Pixels of one device: their rates at its bias and temperature, and what else differs."""

    counters: AnalogPixels | None = None
    """Steps and leaks of analog counters"""

    avalanches: AvalancheMaps | None = None
    """Differences in dead time, afterpulsing and crosstalk; None if there are none"""

    in_time: tuple[tuple[str, Effect], ...] = ()
    """Effects that change from frame to frame, by name"""

    def rates(self, detections_hz: Floats) -> FrameRates:
        """Rates of a frame, before the effects that change with time."""
        telegraph = self.factors.get("telegraph")
        return FrameRates(detections_hz, self.dark_counts_hz, self.device_seed, telegraph)

    def over_time(self, detections_hz: Floats) -> list[tuple[float, FrameRates]]:
        """Possible rates of a frame with their probabilities: one, if none change with time."""
        rates = [(1.0, self.rates(detections_hz))]
        for _, effect in self.in_time:
            rates = [
                (chance * share, changed)
                for chance, each in rates
                for share, changed in effect.over_time(each)
            ]
        return rates


def draw_fixed_pattern(sensor: Sensor, shape: tuple[int, int]) -> FixedPattern:
    """Make the device that a sensor describes, with (rows, columns) pixels.

    Raises ValueError if a measured map does not fit, an efficiency exceeds 1, or dark counts exceed
    the limit.
    """
    # files may change, drawn patterns cannot
    return (_draw if sensor.measured.is_on else _draw_once)(sensor, shape)


def _draw(sensor: Sensor, shape: tuple[int, int]) -> FixedPattern:
    seed = sensor.device_seed
    rates = PixelRates(shape, seed, sensor.active_area_m2, np.ones(shape), np.zeros(shape))
    for name in effects_of(type(sensor)):
        getattr(sensor, name).act_on_rates(rates)
    largest = float(rates.efficiency_factor.max(initial=0)) * max(sensor.efficiency.values)
    if largest > 1:
        raise ValueError(
            f"efficiency: {largest:g} in the best pixel; lower efficiency.values, "
            "measured.efficiency or bias.excess_v so that it is at most 1"
        )
    largest, most_hz = float(rates.dark_counts_hz.max(initial=0)), MOST_ARRIVALS / sensor.exposure_s
    if not largest <= most_hz:
        raise ValueError(
            f"dark_counts: {largest:g} Hz in the worst pixel at bias.excess_v "
            f"{sensor.bias.excess_v:g} and temperature.celsius {sensor.temperature.celsius:g}; "
            f"lower these, at most {most_hz:g} Hz can be drawn"
        )
    for kind, field in (("afterpulsing", "mean_carriers"), ("crosstalk", "mean_fired_neighbors")):
        factor = float(rates.factors.get(kind, np.zeros(1)).max(initial=0))
        most = sensor.crosstalk.most_fired if kind == "crosstalk" else None
        largest = factor * (most or getattr(getattr(sensor, kind), field))
        if largest > MOST_OFFSPRING:
            raise ValueError(
                f"{kind}.{field}: {largest:g} in the worst pixel; lower it, {kind}."
                f"mismatch_sigma or bias.excess_v so that it is at most {MOST_OFFSPRING:g}"
            )
    capacity, stuck = sensor.counter.capacity, rates.stuck
    wrong = [] if stuck is None else stuck[(stuck > capacity) | (stuck != np.rint(stuck))]
    if len(wrong):
        raise ValueError(
            f"measured.stuck: {wrong[0]:g} is no reading of this counter; give whole numbers from "
            f"0 to counter.capacity {capacity}, or -1 for pixels that work"
        )
    if sensor.telegraph.is_on:
        steps = sensor.telegraph.traps * sensor.telegraph.step
        relative = rates.factors.get("telegraph", np.ones(1))
        largest = float((rates.dark_counts_hz * (1 + steps * relative)).max(initial=0))
        if not largest <= most_hz:
            raise ValueError(
                f"telegraph.step: {largest:g} Hz of dark counts in the worst pixel when its traps "
                f"are active; lower it or measured.telegraph, at most {most_hz:g} Hz can be drawn"
            )
    counters = (
        sensor.measured.of_counters(
            analog_pixels(sensor.counter, shape, sensor.exposure_s, seed), sensor.exposure_s
        )
        if isinstance(sensor.counter, AnalogCounter)
        else None
    )
    maps = AvalancheMaps.of(rates)
    patterns = rates.efficiency_factor, rates.dark_counts_hz, *(counters or ()), *(maps or ())
    for pattern in patterns:
        pattern.flags.writeable = False
    effects = ((name, getattr(sensor, name)) for name in effects_of(type(sensor)))
    in_time = tuple(
        (name, effect)
        for name, effect in effects
        if effect.is_on and type(effect).act_on_frame is not Effect.act_on_frame
    )
    return FixedPattern(**vars(rates), counters=counters, avalanches=maps, in_time=in_time)


_draw_once = lru_cache(maxsize=8)(_draw)


def detection_rate(radiance: ArrayLike, bands_nm: ArrayLike, sensor: Sensor) -> Floats:
    """Detection rate of always-live pixels, (T, H, W), Hz; parameters as for `expose`."""
    _check_sensor(sensor)
    rate = detected_rate(radiance, bands_nm, sensor)
    _, rows, columns = rate.shape
    rate *= draw_fixed_pattern(sensor, (rows, columns)).efficiency_factor
    return check_brightness(rate, sensor.exposure_s)


def checked_rate(detections_hz: ArrayLike, sensor: Sensor) -> tuple[Floats, FixedPattern]:
    """Validated rate as (frames, [parts,] rows, columns), and the device.

    Raises ValueError if the rate has another shape, is negative, not finite or too high to be
    drawn.
    """
    _check_sensor(sensor)
    rate = np.asarray(detections_hz, np.float64)
    if rate.ndim not in (3, 4):
        raise ValueError(
            f"detections_hz: shape {rate.shape}; give (frames, rows, columns), or with parts of "
            "the exposure (frames, parts, rows, columns)"
        )
    most = MOST_ARRIVALS / sensor.exposure_s
    if not _are_within(rate.ravel(), most):
        raise ValueError(
            f"detections_hz: from {rate.min():g} to {rate.max():g}; must be finite, not negative "
            f"and at most {most:g} Hz ({MOST_ARRIVALS:g} per exposure)"
        )
    *_, rows, columns = rate.shape
    return rate, draw_fixed_pattern(sensor, (rows, columns))


@compiled
def _are_within(values: Floats, most: float) -> bool:
    """True if all values are from 0 to `most`, in one pass."""
    within = np.int64(0)
    for pixel in range(values.size):  # summed, which vectorizes
        within += np.int64(values[pixel] >= 0) & np.int64(values[pixel] <= most)
    return bool(within == values.size)


def _check_sensor(sensor: Sensor) -> None:
    if not isinstance(sensor, Sensor):
        raise TypeError(f"sensor: {sensor!r} is not a Sensor; give one, such as preset('spadcam')")


def over_frames(task: Callable[[int], None], frames: int, in_turn: bool = False) -> None:
    """Run a task for every frame number, in threads unless in turn.

    Each task must write to its own places.
    """
    workers = min(os.cpu_count() or 1, frames)
    if in_turn or workers <= 1:
        for frame in range(frames):
            task(frame)
        return
    with ThreadPoolExecutor(workers) as pool:
        for _ in pool.map(task, range(frames)):
            pass
