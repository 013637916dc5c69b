"""Counters in the pixel: digital, or analog, where every event lowers a voltage that an ADC reads.

Readings that may stand for larger numbers are flagged: at capacity if the counter saturates, beyond
it if it wraps. Below capacity, mean and variance are those of the events. Of a sum of exposures,
are flagged if all of its exposures are, or with wrapping any.

The output of an analog counter is at the supply after the reset. Each event removes the pixel's
step; the output leaks downwards at the pixel's rate; it stops at the bottom of its swing. A source
follower adds its pixel's offset and read noise, and an ADC that spans the supply rounds. Three
reference readings per pixel convert volts to counts: the output without events (offset, leak) and
the mean step,

    V     = V_supply + offset − min(F_N + leak·T, swing) + read noise, rounded by the ADC
    count = round((V_supply + offset − leak·T − V) / step)

With `calibrated` off, all pixels use nominal ones, as if only the array's mean were known. A count
at the capacity of its pixel is flagged, as is a pixel that only noise keeps off the bottom.

The step may change over the swing: at a voltage drop F it is step·(1 + slope·(½ − F/swing)), so
that N events cause, with b = slope·step/swing,

    F_N = step·(1 + slope/2)·(1 − (1 − b)^N)/b          N·step without slope

A straight line through the whole swing has R² ≈ 1 − slope²/60: the published R² > 0.99 allows
slopes up to 0.6. Calibration remains a straight line. Each step may also have independent noise of
`step_noise_v`; N of them have √N times as much.
With an incomplete reset, N includes a share of the former exposure's N, up to what fills the swing;
moments take it for whole events, which is right to 0.2 counts and 0.25 counts².

Source: dissertation §2.4.2; that the step changes linearly with the output is assumed.
"""

from typing import Annotated, ClassVar, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from megalopta.core.arrays import Floats, Ints, Mask
from megalopta.core.compiling import compiled
from megalopta.sensor.effects.base import Effect
from megalopta.sensor.sampling.streams import pixel_normals

LARGEST_CAPACITY = 2**32 - 1
"""Counts are stored in at most 32 bits."""

Counts = NDArray[np.uint16] | NDArray[np.uint32]


class DigitalCounter(Effect, frozen=True):
    """Digital counter."""

    kind: Literal["digital"] = "digital"
    """Kind of counter: digital or analog."""
    capacity: Annotated[int, Field(ge=1, le=LARGEST_CAPACITY)] = LARGEST_CAPACITY
    """Largest count: 2ⁿ − 1 for n bits."""
    overflow: Literal["saturate", "wrap"] = "saturate"
    """Behavior at overflow: stay at capacity (saturate) or restart at zero (wrap)."""
    sums: Annotated[int, Field(ge=1, le=65535, exclude_if=lambda sums: sums == 1)] = 1
    """Equal parts of the exposure, after each of which the count is reset, and which the chip adds
    to one reading (1: no sums). With a capacity of 1: sums of binary frames."""

    @property
    def is_on(self) -> bool:
        """True if it can saturate."""
        return self.capacity < LARGEST_CAPACITY


def read_digital(events: Ints, counter: DigitalCounter, out: tuple[Counts, Mask]) -> None:
    """Write counts into `out`, and True where they are unreliable, for events of any shape."""
    counts, saturated = out
    if counter.overflow == "wrap":
        np.remainder(events, counter.capacity + 1, out=counts, casting="unsafe")
        np.greater(events, counter.capacity, out=saturated)
    else:
        np.minimum(events, counter.capacity, out=counts, casting="unsafe")
        np.greater_equal(events, counter.capacity, out=saturated)


_MOST_COUNTS = 65535
# Larger than any value of `pixel_normals`.
_LARGEST_Z = 9


class AnalogCounter(Effect, frozen=True):
    """Counter that stores its count as a voltage."""

    sums: ClassVar[int] = 1
    kind: Literal["analog"] = "analog"
    """Kind of counter: digital or analog."""
    step_v: Annotated[float, Field(gt=0)]
    """Mean voltage step of one event (V)."""
    step_sigma_v: Annotated[float, Field(ge=0)] = 0.0
    """Standard deviation of the step over the pixels (V)."""
    supply_v: Annotated[float, Field(gt=0)] = 3.3
    """Output after reset, and range of the ADC (V)."""
    swing_v: Annotated[float, Field(gt=0)] = 3.2
    """Largest voltage drop of the output (V)."""
    step_slope: Annotated[float, Field(ge=-1, le=1)] = 0.0
    """Relative decrease of the step from the top to the bottom of the swing."""
    step_noise_v: Annotated[float, Field(ge=0)] = 0.0
    """Standard deviation of a single step about its pixel's mean step (V)."""
    leak_v_s: Annotated[float, Field(ge=0)] = 0.0
    """Mean leakage rate of the output (V/s)."""
    leak_sigma_v_s: Annotated[float, Field(ge=0)] = 0.0
    """Standard deviation of the leakage rate over the pixels (V/s)."""
    offset_sigma_v: Annotated[float, Field(ge=0)] = 0.0
    """Standard deviation of the offset of the source followers over the pixels (V)."""
    read_noise_v: Annotated[float, Field(ge=0)] = 0.0
    """Standard deviation of the read noise (V)."""
    adc_bits: Annotated[int, Field(ge=1, le=24)] | None = None
    """Resolution of the ADC (bits); null: no rounding."""
    residue_share: Annotated[float, Field(ge=0, le=0.5, exclude_if=lambda share: share == 0)] = 0.0
    """Share of a voltage drop that stays after the reset (0: complete)."""
    calibrated: bool = True
    """True if step, leak and offset of every pixel are known; False: only their means."""

    @model_validator(mode="after")
    def _check_voltages(self) -> Self:
        if self.swing_v > self.supply_v or self.step_v > self.swing_v:
            raise ValueError(
                f"counter: step_v {self.step_v:g}, swing_v {self.swing_v:g}, supply_v "
                f"{self.supply_v:g}; a step must fit into the swing, the swing into the supply"
            )
        for field, mean, sigma in (
            ("step_sigma_v", self.step_v, self.step_sigma_v),
            ("step_noise_v", self.step_v, self.step_noise_v),
            ("leak_sigma_v_s", self.leak_v_s, self.leak_sigma_v_s),
        ):
            if sigma * _LARGEST_Z > mean:
                raise ValueError(
                    f"counter.{field}: {sigma:g} about a mean of {mean:g}; use at most "
                    f"{mean / _LARGEST_Z:g}, so that none is negative"
                )
        if self.capacity > _MOST_COUNTS:
            raise ValueError(
                f"counter.step_v: {self.step_v:g} makes {self.capacity} counts; at most "
                f"{_MOST_COUNTS} are stored: make it larger or lower swing_v"
            )
        return self

    @classmethod
    def off(cls) -> DigitalCounter:
        """Return a counter that practically never saturates."""
        return DigitalCounter()

    @property
    def capacity(self) -> int:
        """Largest count of a pixel with nominal step and no leak."""
        return _capacity(self.swing_v, self.step_v)

    @property
    def lsb_v(self) -> float:
        """Voltage between two codes of the ADC, V; 0 without rounding."""
        return 0.0 if self.adc_bits is None else self.supply_v / (2**self.adc_bits - 1)


class AnalogPixels(NamedTuple):
    """Mean steps, voltage drop by leakage in one exposure, and offsets, (rows, columns) V."""

    step_v: Floats
    leaked_v: Floats
    offset_v: Floats
    """Offset of the source follower: positive raises the output. `AnalogDevice.offset_v`, a
    drop of the output, has the opposite sign."""


def analog_pixels(
    counter: AnalogCounter, shape: tuple[int, int], exposure_s: float, device_seed: int
) -> AnalogPixels:
    """Draw the pixels of a device.

    Raises ValueError if leakage alone empties a counter during the exposure, or a pixel's step is
    so small that its counts cannot be stored.
    """
    step = _scattered(counter.step_v, counter.step_sigma_v, shape, device_seed, "counter step")
    leak = _scattered(counter.leak_v_s, counter.leak_sigma_v_s, shape, device_seed, "counter leak")
    leaked = leak * exposure_s
    if leaked.size and leaked.max() + step.max() > counter.swing_v:
        raise ValueError(
            f"exposure_s: {exposure_s:g}; by then leakage has taken {leaked.max():g} V of the "
            f"counter.swing_v {counter.swing_v:g}; expose for less or lower counter.leak_v_s"
        )
    if step.size and _capacity(counter.swing_v, float(step.min())) > _MOST_COUNTS:
        raise ValueError(
            f"counter.step_v: {step.min():g} in the pixel of the smallest step makes more than "
            f"{_MOST_COUNTS} counts; make it larger or lower counter.step_sigma_v"
        )
    offset = _scattered(0.0, counter.offset_sigma_v, shape, device_seed, "counter offset")
    return AnalogPixels(step, leaked, offset)


def nominal_pixels(counter: AnalogCounter, exposure_s: float) -> AnalogPixels:
    """Return the pixel values assumed without calibration."""
    leaked_v = counter.leak_v_s * exposure_s
    return AnalogPixels(*(np.array(value) for value in (counter.step_v, leaked_v, 0.0)))


def assumed_pixels(counter: AnalogCounter, pixels: AnalogPixels, exposure_s: float) -> AnalogPixels:
    """Return the values that convert volts to counts, in the shape of the pixels."""
    known = pixels if counter.calibrated else nominal_pixels(counter, exposure_s)
    return AnalogPixels(*(np.full(pixels.step_v.shape, value) for value in known))


def _capacity(swing_v: float, step_v: float) -> int:
    return int(swing_v / step_v * (1 + 1e-9))


def _scattered(
    mean: float, sigma: float, shape: tuple[int, int], device_seed: int, purpose: str
) -> Floats:
    if sigma == 0:
        return np.full(shape, mean)
    return mean + sigma * pixel_normals(shape, device_seed, purpose)


def read_analog(
    rng: np.random.Generator,
    events: Ints,
    counter: AnalogCounter,
    pixels: AnalogPixels,
    exposure_s: float,
) -> tuple[Ints, Mask]:
    """Counts of a (rows, columns) frame of events, and True where they are a lower bound."""
    output_v, is_empty = _outputs(rng, events, counter, pixels)
    counts, is_full = _counts(output_v, counter, assumed_pixels(counter, pixels, exposure_s))
    return counts.astype(np.int64), is_empty | is_full


def sample_analog(
    rng: np.random.Generator, events: Ints, counter: AnalogCounter, pixels: AnalogPixels
) -> NDArray[np.uint16]:
    """ADC codes of a (rows, columns) frame of events; uses the same draws as `read_analog`.

    Raises ValueError if the counter has no ADC, or one of more than 16 bits.
    """
    if counter.adc_bits is None or counter.adc_bits > 16:
        raise ValueError(f"counter.adc_bits: {counter.adc_bits}; give 1 to 16 to sample its output")
    output_v, _ = _outputs(rng, events, counter, pixels)
    return np.rint(output_v / counter.lsb_v).astype(np.uint16)


def counts_of_codes(
    codes: NDArray[np.uint16], counter: AnalogCounter, known: AnalogPixels
) -> tuple[NDArray[np.uint16], Mask]:
    """Convert ADC codes (…, rows, columns) to counts, with True where they are a lower bound.

    `known`: known pixel values: measured ones, or `nominal_pixels`.
    """
    counts, is_full = _counts(np.asarray(codes * counter.lsb_v), counter, known)
    return counts.astype(np.uint16), is_full


def _counts(output_v: Floats, counter: AnalogCounter, known: AnalogPixels) -> tuple[Floats, Mask]:
    """Counts for an output, and True where it is at the capacity of its pixel."""
    reference = counter.supply_v + known.offset_v - known.leaked_v
    counts = np.maximum(np.rint((reference - output_v) / known.step_v), 0)
    # As `largest_count`.
    capacity = np.floor((counter.swing_v - known.leaked_v) / known.step_v * (1 + 1e-9))
    return np.minimum(counts, capacity), counts >= capacity


def _outputs(
    rng: np.random.Generator, events: Ints, counter: AnalogCounter, pixels: AnalogPixels
) -> tuple[Floats, Mask]:
    """Output of a (rows, columns) frame, V, and True where the counter is at its bottom."""
    output_v, is_empty = np.empty(events.shape), np.empty(events.shape, np.bool_)
    _fill_outputs(rng, events, pixels, voltages(counter), output_v, is_empty)
    return output_v, is_empty


def voltages(counter: AnalogCounter) -> tuple[float, float, float, float, float, float]:
    """Supply, swing, slope of the step, its noise, read noise and one code, V except the slope."""
    steps = counter.step_slope, counter.step_noise_v
    return counter.supply_v, counter.swing_v, *steps, counter.read_noise_v, counter.lsb_v


@compiled
def fall(events: float, step_v: float, slope: float, swing_v: float) -> float:
    """Mean drop of the output after a number of events, V, without a bottom."""
    change = slope * step_v / swing_v
    if change == 0:
        return events * step_v
    first_v = step_v * (1 + slope / 2)
    return float(-first_v / change * np.expm1(events * np.log1p(-change)))


@compiled
def fall_deviation(events: float, step_noise_v: float, step_v: float, swing_v: float) -> float:
    """Standard deviation of that drop, V; at twice the swing nothing remains to be removed."""
    return float(step_noise_v * np.sqrt(min(events, 2 * swing_v / step_v)))


@compiled
def largest_count(step_v: float, leaked_v: float, swing_v: float) -> float:
    """Capacity of a pixel with these values."""
    return float(np.floor((swing_v - leaked_v) / step_v * (1 + 1e-9)))


@compiled
def _fill_outputs(rng, events, pixels, volts, output_v, is_empty):  # type: ignore[no-untyped-def]
    supply, swing, slope, step_noise, read_noise, lsb = volts
    for at in np.ndindex(events.shape):
        step_v = pixels.step_v[at]
        fallen = fall(events[at], step_v, slope, swing) + pixels.leaked_v[at]
        if step_noise > 0:
            fallen += fall_deviation(events[at], step_noise, step_v, swing) * rng.standard_normal()
        output = supply + pixels.offset_v[at] - min(fallen, swing)
        if read_noise > 0:
            output += read_noise * rng.standard_normal()
        if lsb > 0:
            output = min(max(np.rint(output / lsb), 0.0), np.rint(supply / lsb)) * lsb
        output_v[at], is_empty[at] = output, fallen > swing
