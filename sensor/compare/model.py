"""Device model of a comparison: its readings at each level, and their expected moments."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats, Mask
from megalopta.sensor.calibrate.level import Level
from megalopta.sensor.change import changed
from megalopta.sensor.expectations import reading_moments
from megalopta.sensor.exposure import expose_adc, expose_rate
from megalopta.sensor.spad.counters import AnalogCounter, counts_of_codes
from megalopta.sensor.spad.device import draw_fixed_pattern
from megalopta.sensor.spad.model import Sensor

_FEWEST_FRAMES = 64
_MOST_CAUSED = 0.5
"""Most events that one may cause."""


def level_of_codes(
    codes: NDArray[Any],
    device: Sensor,
    exposure_s: float,
    light_hz: float = 0.0,
    times_s: Floats | None = None,
) -> Level:
    """Return counts of ADC codes (n, rows, columns), by the steps, leaks and offsets of a device.

    Raises ValueError if its counters are not analog.
    """
    counter, shape = device.counter, (codes.shape[1], codes.shape[2])
    known = draw_fixed_pattern(changed(device, exposure_s=exposure_s), shape).counters
    if not isinstance(counter, AnalogCounter) or known is None:
        raise ValueError(f"counter.kind: {counter.kind!r}; only an analog counter has codes")
    counts, _ = counts_of_codes(codes, counter, known)
    full = 0.98 * (counter.swing_v - known.leaked_v) / known.step_v
    reference = counter.supply_v + known.offset_v - known.leaked_v
    unrounded = (reference - codes * counter.lsb_v) / known.step_v
    return Level(
        counts, exposure_s, light_hz, counts >= full, times_s, codes, unrounded.astype(np.float32)
    )


def one_by_one(level: Level) -> Level:
    """Return the first frames of a level, at most 2²⁴ readings but 64 frames or more."""
    most = max(2**24 // max(level.readings[0].size, 1), _FEWEST_FRAMES)
    return level if len(level.readings) <= most else level.at(np.s_[:most])


def _frames_of(level: Level, rate_hz: Floats) -> int:
    """Number of frames that make what is expected surer than what is captured."""
    # up to 2²⁰ readings, more frames are drawn than captured
    frames, most = len(level.readings), 2**20 // max(level.readings[0].size, 1)
    return frames if len(rate_hz) > 1 else int(min(max(most, frames), 3 * frames))


@dataclass(frozen=True, eq=False)
class Model:
    """Device, and its detection rates (n or 1, rows, columns), Hz, at each level."""

    sensor: Sensor
    rates_hz: Sequence[Floats]

    def drawn(self, like: Sequence[Level], seed: int, stimulus: str = "") -> list[Level]:
        """Draw as many frames of every level as were captured, or more of few pixels."""
        levels = like if self.is_moving else [one_by_one(level) for level in like]
        return [
            self.draw(level, rate_hz, seed, stimulus, frames=_frames_of(level, rate_hz))
            for level, rate_hz in zip(levels, self.rates_hz, strict=True)
        ]

    @property
    def is_moving(self) -> bool:
        """True if the light changes from frame to frame."""
        return any(len(rate_hz) > 1 for rate_hz in self.rates_hz)

    def draw(
        self, level: Level, rate_hz: Floats, seed: int, stimulus: str = "",
        changes: Mapping[str, float] = MappingProxyType({}), frames: int = 0,
    ) -> Level:  # fmt: skip
        """Draw as many frames as a level has, or so many, of a device changed as in `moments`.

        Its exposure and step change relatively, its offset by counts, the variance of its read
        noise by counts².
        """
        shape = (frames or len(level.readings), *level.readings.shape[1:])
        if frames and frames != len(level.readings):
            level = replace(level, times_s=None)
        scale = 1 + changes.get("exposure", 0.0)
        sensor = changed(self._changed(changes), exposure_s=level.exposure_s * scale)
        rates_hz = rate_hz * (1 + changes.get("efficiency", 0.0)) + changes.get("light leak", 0.0)
        if size := changes.get("dark counts", 0.0):
            rates_hz = rates_hz + (1 + size) * self._dark_hz(level.readings[0])
            none = dict.fromkeys(type(sensor.dark_counts).model_fields, 0.0)
            sensor = changed(sensor, dark_counts=none, measured={"dark_counts": None})
        rates_hz = np.broadcast_to(np.maximum(rates_hz, 0.0), shape)
        stream = f"comparison, {stimulus}{level.exposure_s:g} s, light {level.light_hz:g}"
        if level.codes is not None:
            codes = expose_adc(rates_hz, sensor, seed=seed, stream=stream, together=64)
            conditions = level.exposure_s, level.light_hz, level.times_s
            drawn = level_of_codes(codes, self.sensor, *conditions)
        else:
            exposure = expose_rate(rates_hz, sensor, seed=seed, stream=stream)
            # if a capture has no saturation mask, saturated counts are compared as they are
            saturated = None if level.saturated is None else exposure.saturated
            drawn = replace(level, readings=exposure.counts, saturated=saturated)
            gain = 1 + changes.get("step", 0.0)
            drawn = drawn if gain == 1 else drawn.moved(lambda counts: counts * gain)
        offset = changes.get("offset", 0.0)
        return drawn.moved(lambda counts: counts + offset) if offset else drawn

    def _changed(self, changes: Mapping[str, float]) -> Sensor:
        """Device with another dead time, afterpulsing, crosstalk, step or read noise."""
        sensor, counter = self.sensor, self.sensor.counter
        fields: dict[str, Any] = {}
        if "dead time" in changes:
            kind = sensor.dead_time.kind
            kind = "nonparalyzable" if kind == "ideal" else kind
            seconds = max(sensor.dead_time.dead_time_s + changes["dead time"], 0.0)
            fields["dead_time"] = (
                {"kind": kind, "dead_time_s": seconds}
                if seconds >= 1e-15  # s; shorter is none
                else {"kind": "ideal", "dead_time_s": 0.0}
            )
        if "afterpulsing" in changes:
            carriers = sensor.afterpulsing.mean_carriers + changes["afterpulsing"]
            carriers = min(max(carriers, 0.0), _MOST_CAUSED)
            fields["afterpulsing"] = {"mean_carriers": carriers, "delay_s": self.delay_s}
        if "crosstalk" in changes:
            neighbors = sensor.crosstalk.mean_fired_neighbors + changes["crosstalk"]
            neighbors = min(max(neighbors, 0.0), _MOST_CAUSED)
            fields["crosstalk"] = {"mean_fired_neighbors": neighbors}
        if isinstance(counter, AnalogCounter) and {"step", "read noise"} & changes.keys():
            noise = counter.read_noise_v**2 + changes.get("read noise", 0.0) * counter.step_v**2
            step_v = counter.step_v * (1 + changes.get("step", 0.0))
            fields["counter"] = {"step_v": step_v, "read_noise_v": max(noise, 0.0) ** 0.5}
        return changed(sensor, **fields)

    def moments(
        self, exposure_s: float, light_hz: Floats, parameter: str = "", size: float = 0.0
    ) -> tuple[Floats, Floats]:
        """Return mean and variance of counts, (rows, columns) each, of a changed device.

        Of an analog counter, those of events: noise and rounding are the same in both recordings.
        Dark counts, efficiency and exposure change relatively, a light leak by Hz, dead time (s),
        afterpulsing and crosstalk by a difference.
        """
        if not parameter:
            known = self._unchanged.get((exposure_s, id(light_hz)))
            if known:
                return known[1:]
        sensor = self.sensor
        match parameter:
            case "dark counts":
                light_hz = light_hz + size * self._dark_hz(light_hz)
            case "efficiency":
                light_hz = light_hz * (1 + size)
            case "light leak":
                light_hz = light_hz + size
            case "exposure":
                exposure_s = exposure_s * (1 + size)
            case "":
                pass
            case _:
                sensor = self._changed({parameter: size})
        if self.volts_per_count:
            sensor = changed(sensor, counter={"kind": "digital"})
        rates_hz = np.maximum(light_hz, 0)[np.newaxis]
        mean, variance = reading_moments(rates_hz, changed(sensor, exposure_s=exposure_s))
        if not parameter:  # with the rates, whose identity is the key
            self._unchanged[exposure_s, id(light_hz)] = light_hz, mean[0], variance[0]
        return mean[0], variance[0]

    @cached_property
    def _unchanged(self) -> dict[tuple[float, int], tuple[Floats, Floats, Floats]]:
        """Light, mean and variance by exposure and light."""
        return {}

    def dark_hz(self, pixels: Mask) -> float:
        """Return the mean dark count rate of pixels, Hz."""
        return float(self._dark_hz(pixels)[pixels].mean())

    def _dark_hz(self, like: NDArray[Any]) -> Floats:
        shape = like.shape[0], like.shape[1]
        return np.asarray(draw_fixed_pattern(self.sensor, shape).dark_counts_hz, np.float64)

    @cached_property
    def delay_s(self) -> float:
        """Delay of afterpulses, s: the device's, or one that dead time does not hide."""
        return max(self.sensor.afterpulsing.delay_s, 5 * self.sensor.dead_time.dead_time_s)

    @property
    def volts_per_count(self) -> float:
        """Step of an analog counter, V; 0 without one."""
        return self.sensor.counter.step_v if isinstance(self.sensor.counter, AnalogCounter) else 0.0

    @property
    def counts_per_code(self) -> float:
        """Counts between two codes of the ADC; 0 without one."""
        counter = self.sensor.counter
        return counter.lsb_v / counter.step_v if isinstance(counter, AnalogCounter) else 0.0
