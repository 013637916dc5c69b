"""Device model of a comparison: its readings at each level, and their expected moments."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats, Mask
from megalopta.sensor.calibrate.level import Level
from megalopta.sensor.change import changed
from megalopta.sensor.expectations import event_moments, reading_moments
from megalopta.sensor.exposure import expose_adc, expose_rate
from megalopta.sensor.spad.counters import AnalogCounter, counts_of_codes
from megalopta.sensor.spad.device import draw_fixed_pattern
from megalopta.sensor.spad.model import Sensor


def level_of_codes(
    codes: NDArray[Any], device: Sensor, exposure_s: float, light_hz: float = 0.0,
    times_s: Floats | None = None,
) -> Level:  # fmt: skip
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


@dataclass(frozen=True, eq=False)
class Model:
    """Device, and its detection rates (n or 1, rows, columns), Hz, at each level."""

    sensor: Sensor
    rates_hz: Sequence[Floats]

    def drawn(self, like: Sequence[Level], seed: int, stimulus: str = "") -> list[Level]:
        """Draw as many frames of every level as were captured."""
        levels = []
        for level, rate_hz in zip(like, self.rates_hz, strict=True):
            sensor = changed(self.sensor, exposure_s=level.exposure_s)
            stream = f"comparison, {stimulus}{level.exposure_s:g} s, light {level.light_hz:g}"
            rates_hz = np.broadcast_to(rate_hz, level.readings.shape)
            if level.codes is not None:
                codes = expose_adc(rates_hz, sensor, seed=seed, stream=stream, together=64)
                levels.append(
                    level_of_codes(codes, sensor, level.exposure_s, level.light_hz, level.times_s)
                )
            else:
                exposure = expose_rate(rates_hz, sensor, seed=seed, stream=stream)
                # if a capture has no saturation mask, saturated counts are compared as they are
                saturated = None if level.saturated is None else exposure.saturated
                levels.append(replace(level, readings=exposure.counts, saturated=saturated))
        return levels

    def moments(
        self, exposure_s: float, light_hz: Floats, parameter: str = "", size: float = 0.0
    ) -> tuple[Floats, Floats]:
        """Return mean and variance of counts, (rows, columns) each, of a changed device.

        Of an analog counter, those of events: noise and rounding are the same in both recordings.
        Dark counts and efficiency change relatively, dead time (s), afterpulsing and crosstalk by a
        difference.
        """
        sensor = self.sensor
        fields: dict[str, Any] = {}
        match parameter:
            case "dark counts":
                light_hz = light_hz + size * self._dark_hz(light_hz)
            case "efficiency":
                light_hz = light_hz * (1 + size)
            case "dead time":
                kind = sensor.dead_time.kind
                kind = "nonparalyzable" if kind == "ideal" else kind
                seconds = max(sensor.dead_time.dead_time_s + size, 0.0)
                fields["dead_time"] = {"kind": kind, "dead_time_s": seconds}
            case "afterpulsing":
                carriers = max(sensor.afterpulsing.mean_carriers + size, 0.0)
                fields["afterpulsing"] = {"mean_carriers": carriers, "delay_s": self.delay_s}
            case "crosstalk":
                neighbors = max(sensor.crosstalk.mean_fired_neighbors + size, 0.0)
                fields["crosstalk"] = {"mean_fired_neighbors": neighbors}
        moments_of = event_moments if self.volts_per_count else reading_moments
        rates_hz = np.maximum(light_hz, 0)[np.newaxis]
        mean, variance = moments_of(rates_hz, changed(sensor, exposure_s=exposure_s, **fields))
        return mean[0], variance[0]

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
