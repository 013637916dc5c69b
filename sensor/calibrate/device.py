"""What recordings tell of a device: estimates of its pixels, and what they rest on."""

from dataclasses import dataclass

import numpy as np

from megalopta.core.arrays import Floats, Mask
from megalopta.sensor.calibrate.curve import Curve
from megalopta.sensor.calibrate.level import Adc, Falls, Level
from megalopta.sensor.calibrate.neighbors import Kernel
from megalopta.sensor.calibrate.saturation import MeanCounts

_95 = 1.959964


@dataclass(frozen=True, eq=False)
class Estimate:
    """One quantity of every pixel with its 95 % interval, each (rows, columns); NaN: not known."""

    value: Floats
    low: Floats
    high: Floats

    @classmethod
    def normal(cls, value: Floats, error: Floats, shape: tuple[int, int]) -> "Estimate":
        """Of a value with this standard error."""
        error = np.where(error > 0, error, np.nan)
        value, spread = np.where(np.isfinite(error), value, np.nan), _95 * error
        return cls(*(each.reshape(shape) for each in (value, value - spread, value + spread)))

    def with_relative_error(self, error: Floats) -> "Estimate":
        """The same where a factor of it has this relative standard error too; not below 0."""
        spread = np.hypot((self.high - self.low) / 2, _95 * error * self.value)
        return Estimate(self.value, np.maximum(self.value - spread, 0), self.value + spread)

    def scaled(self, factor: Floats | float) -> "Estimate":
        """In another unit."""
        return Estimate(self.value * factor, self.low * factor, self.high * factor)


@dataclass(frozen=True, eq=False)
class Device:
    """What recordings tell of a device.

    Attributes
    ----------
    offset_v, leak_v_s, step_v, read_noise_v, dark_counts_hz : Estimate
        `offset_v` is the fall of the output below the top of the ADC without events or leak:
        positive lowers it, as events do. `AnalogPixels.offset_v` and the map `offset` of a device
        file, which add to the output, have the opposite sign. `leak_v_s` is unknown where the comb
        is hidden.
    efficiency : Estimate or None
        Events per unit of light; None without flat frames.
    dead_time_s : Estimate or None
    dead_time_kind : str or None
        None where the saturation curve does not tell it.
    kind_ratio : float
        Logarithm of the ratio of likelihoods of the two kinds.
    kernel : Kernel or None
        Of crosstalk; None where the comb is hidden.
    hot : (rows, columns) bool
    method : str
        How steps were found: "comb" or "photon transfer".
    counts : MeanCounts
        Behind the saturation curve.
    falls : Falls
    curve : Curve
        How the step changes over the swing.
    slope_error : float
        Standard error of its slope; infinite where it is not told.
    """

    offset_v: Estimate
    leak_v_s: Estimate
    step_v: Estimate
    read_noise_v: Estimate
    dark_counts_hz: Estimate
    efficiency: Estimate | None
    dead_time_s: Estimate | None
    dead_time_kind: str | None
    kind_ratio: float
    kernel: Kernel | None
    hot: Mask
    method: str
    counts: MeanCounts
    falls: Falls
    curve: Curve
    slope_error: float

    @property
    def is_slope_seen(self) -> bool:
        """Whether the step changes over the swing, beyond 3 standard errors."""
        return abs(self.curve.slope) > 3 * self.slope_error

    @property
    def levels(self) -> tuple[tuple[float, float], ...]:
        """Exposure (s) and light of each."""
        return tuple(zip(self.counts.exposure_s, self.counts.light_hz, strict=True))

    def counts_of(self, level: Level, adc: Adc) -> Floats:
        """Counts, not rounded, from the codes of frames (n, rows, columns)."""
        leak = np.nan_to_num(self.leak_v_s.value) * level.exposure_s
        fall = (adc.top - level.codes) * adc.lsb_v
        steps = (fall - self.offset_v.value - leak) / self.step_v.value
        return self.curve.numbers(steps, self.step_v.value)
