"""Pixels of one device: what its fixed pattern is, in every frame, run and machine.

Patterns are drawn from the device seed or read from measured maps. They hold at the reference bias
and temperature; the operating point scales them.
"""

from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.sensor.effects import bias, dark_counts
from megalopta.sensor.effects.base import AvalancheMaps
from megalopta.sensor.effects.dead_time import MOST_ARRIVALS
from megalopta.sensor.sampling.streams import pixel_normals
from megalopta.sensor.spad.counters import AnalogCounter, AnalogPixels, analog_pixels
from megalopta.sensor.spad.measured import MeasuredMaps
from megalopta.sensor.spad.model import MOST_OFFSPRING, Sensor


@dataclass(frozen=True, eq=False)
class FixedPattern:
    """Pixels of one device, (H, W), at its bias and temperature."""

    efficiency_factor: Floats
    """Detection efficiency relative to the sensor's curve"""
    dark_counts_hz: Floats
    """Dark count rate without active traps"""
    telegraph: dark_counts.Telegraph
    traps: dark_counts.Traps | None
    """Traps that switch dark counts; None without telegraph noise"""
    avalanches: AvalancheMaps | None
    """Differences in dead time, afterpulsing and crosstalk; None if there are none"""
    counters: AnalogPixels | None
    """Steps and leaks of analog counters"""
    stuck: Floats | None
    """Readings of stuck pixels; -1: the pixel works"""

    def repeated(self, frames: int) -> "FixedPattern":
        """Return pixels of frames one below the other."""
        if frames == 1:
            return self

        def tall(values: Floats) -> Floats:
            return np.tile(values, (frames, 1))

        return replace(
            self,
            dark_counts_hz=tall(self.dark_counts_hz),
            avalanches=self.avalanches and AvalancheMaps(*map(tall, self.avalanches)),
            counters=self.counters and AnalogPixels(*map(tall, self.counters)),
        )

    def dark_levels(self) -> list[tuple[float, Floats]]:
        """Return possible dark count rates, Hz, with their probabilities; one without traps."""
        if self.traps is None:
            return [(1.0, self.dark_counts_hz)]
        levels = dark_counts.telegraph_levels(self.telegraph, self.traps)
        return [(chance, self.dark_counts_hz * factor) for chance, factor in levels]


def draw_fixed_pattern(sensor: Sensor, shape: tuple[int, int]) -> FixedPattern:
    """Make the device that a sensor describes, with (rows, columns) pixels.

    Raises ValueError if a measured map does not fit, an efficiency exceeds 1, or dark counts exceed
    the limit.
    """
    # files may change, drawn patterns cannot
    return (_draw_once if sensor.measured == MeasuredMaps() else _draw)(sensor, shape)


def _draw(sensor: Sensor, shape: tuple[int, int]) -> FixedPattern:
    seed, operating, warm = sensor.device_seed, sensor.bias, sensor.temperature
    maps = sensor.measured.load(shape)

    # as made, at the reference bias and temperature
    efficiency = maps.get("efficiency", np.ones(shape))
    dark_hz = maps.get("dark_counts")
    if dark_hz is None:
        area_um2 = sensor.active_area_m2 * 1e12
        dark_hz = dark_counts.dark_count_density(sensor.dark_counts, shape, seed) * area_um2
    breakdown_v = maps.get("breakdown")  # above the nominal one
    if breakdown_v is None:
        breakdown_v = bias.breakdown_offset(operating, shape, seed)

    # at the operating point
    breakdown_rise_v = warm.breakdown_v_per_k * (warm.celsius - warm.reference_celsius)
    now = operating.model_copy(update={"excess_v": operating.excess_v - breakdown_rise_v})

    def bias_factor(name: str, factor: bias.Dependence) -> Floats:
        dependence = partial(bias.since_measurement, factor) if name in maps else factor
        return dependence(now, breakdown_v)

    efficiency = efficiency * bias_factor("efficiency", bias.efficiency_factor)
    with np.errstate(over="ignore", invalid="ignore"):  # refused below
        dark_hz = dark_hz * warm.dark_count_factor
        dark_hz = dark_hz * bias_factor("dark_counts", bias.dark_count_factor)

    # differences between pixels in what avalanches do
    factors = {name: maps.get(name, np.ones(shape)) for name in AvalancheMaps._fields}
    for name, slope in (
        ("afterpulsing", operating.afterpulsing_slope),
        ("crosstalk", operating.crosstalk_slope),
    ):
        if slope > 0:
            factors[name] = factors[name] * bias_factor(name, partial(bias.charge_factor, slope))
    for name in factors:
        effect = getattr(sensor, name)
        if effect.is_on and effect.mismatch_sigma > 0 and name not in maps:
            log_sigma = np.sqrt(np.log1p(effect.mismatch_sigma**2))
            normals = pixel_normals(shape, seed, f"{name} mismatch")
            factors[name] = factors[name] * np.exp(log_sigma * normals - log_sigma**2 / 2)
    are_alike = all(np.all(factor == 1) for factor in factors.values())

    traps, counters = None, None
    if sensor.telegraph.is_on:
        traps = dark_counts.draw_traps(sensor.telegraph, shape, seed, maps.get("telegraph"))
    if isinstance(sensor.counter, AnalogCounter):
        drawn = analog_pixels(sensor.counter, shape, sensor.exposure_s, seed)
        leaked_v = maps["leak"] * sensor.exposure_s if "leak" in maps else drawn.leaked_v
        step_v, offset_v = maps.get("step", drawn.step_v), maps.get("offset", drawn.offset_v)
        counters = AnalogPixels(step_v, leaked_v, offset_v)
    device = FixedPattern(
        efficiency,
        dark_hz,
        sensor.telegraph,
        traps,
        None if are_alike else AvalancheMaps(**factors),
        counters,
        maps.get("stuck"),
    )
    for pattern in (efficiency, dark_hz, *(counters or ()), *(device.avalanches or ())):
        pattern.flags.writeable = False
    _check(device, sensor)
    return device


_draw_once = lru_cache(maxsize=8)(_draw)


def _check(device: FixedPattern, sensor: Sensor) -> None:
    """Raise ValueError for pixels that cannot be or cannot be drawn."""
    dark_hz, most_hz = device.dark_counts_hz, MOST_ARRIVALS / sensor.exposure_s
    efficiency = device.efficiency_factor * max(sensor.efficiency.values)
    limits = [("efficiency", efficiency, 1.0), ("dark_counts in Hz", dark_hz, most_hz)]
    if device.traps is not None:
        rise = 1 + sensor.telegraph.traps * sensor.telegraph.step * device.traps.step
        limits.append(("telegraph.step in Hz", dark_hz * rise, most_hz))
    if device.avalanches is not None:
        for field, mean, factor in (
            ("afterpulsing.mean_carriers", sensor.afterpulsing.mean_carriers, "afterpulsing"),
            ("crosstalk.mean_fired_neighbors", sensor.crosstalk.most_fired, "crosstalk"),
        ):
            limits.append((field, mean * getattr(device.avalanches, factor), MOST_OFFSPRING))
    for field, values, most in limits:
        largest = float(np.max(values, initial=0))
        if not largest <= most:
            raise ValueError(
                f"{field}: {largest:g} in the worst pixel; lower it, its spread, bias.excess_v "
                f"{sensor.bias.excess_v:g} or temperature.celsius {sensor.temperature.celsius:g}, "
                f"to {most:g} at most"
            )
    if device.stuck is not None:
        stuck, capacity = device.stuck, sensor.largest
        wrong = stuck[(stuck > capacity) | (stuck != np.rint(stuck))]
        if len(wrong):
            raise ValueError(
                f"measured.stuck: {wrong[0]:g} is no reading of this counter; give whole numbers "
                f"from 0 to {capacity}, or -1 for pixels that work"
            )
