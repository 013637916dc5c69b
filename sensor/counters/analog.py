"""The analog counter: every event takes a step off a voltage, which an ADC reads.

After the reset the output stands at the supply. Each event removes the pixel's step; the output
leaks downwards at the pixel's rate; it stops at the bottom of its swing. A source follower adds
read noise, an ADC that spans the supply rounds. Two reference readings, per pixel, turn volts back
into counts: the output without events and the step,

    V     = max(V_supply − N·step − leak·T, V_supply − swing) + read noise, rounded by the ADC
    count = round((V_supply − leak·T − V) / step)

With `calibrated` off, the nominal step and leak are used for all pixels, as when only the mean of
the array is known. A count at the capacity of its pixel is flagged, as is a pixel that noise alone
keeps off the bottom.

The error of a reading, before it is rounded to whole counts, has mean 0 and variance
(σ_read² + LSB²/12)/step². There are no counts below 0, so an empty pixel reads
Σ_{k≥1} P(error ≥ k − ½) on average: nothing to speak of where the read noise is a tenth of a step,
0.16 at half a step. The leak between reset and readout is constant and the time to read the array
(12.8 µs) is neglected.

Source: dissertation §2.4.2.
"""

from typing import Annotated, ClassVar, Literal, NamedTuple, Self

import numpy as np
from numba import njit
from numpy.typing import NDArray
from pydantic import Field, model_validator

from megalopta.sensor.counters.digital import DigitalCounter
from megalopta.sensor.effects import Effect, Stage
from megalopta.sensor.sampling import pixel_normals

_LARGEST_CAPACITY = 65535
# More than any `pixel_normals`.
_LARGEST_Z = 9

Floats = NDArray[np.float64]


class AnalogCounter(Effect, frozen=True):
    """A counter that keeps its count as a voltage."""

    stage: ClassVar[Stage] = Stage.READOUT
    statement: ClassVar[str] = (
        "avalanches are counted, as far as the counter goes, and read (frames only)"
    )

    kind: Literal["analog"] = "analog"
    """Counts in volts."""
    step_v: Annotated[float, Field(gt=0)]
    """Mean voltage that one event takes off (V)."""
    step_sigma_v: Annotated[float, Field(ge=0)] = 0.0
    """Standard deviation of the step over the pixels (V)."""
    supply_v: Annotated[float, Field(gt=0)] = 3.3
    """Output after reset, and range of the ADC (V)."""
    swing_v: Annotated[float, Field(gt=0)] = 3.2
    """How far the output can fall (V)."""
    leak_v_s: Annotated[float, Field(ge=0)] = 0.0
    """Mean rate at which the output falls by itself (V/s)."""
    leak_sigma_v_s: Annotated[float, Field(ge=0)] = 0.0
    """Standard deviation of that rate over the pixels (V/s)."""
    read_noise_v: Annotated[float, Field(ge=0)] = 0.0
    """Standard deviation of the noise of one reading (V)."""
    adc_bits: Annotated[int, Field(ge=1, le=24)] | None = None
    """Resolution of the ADC (bits); none: it does not round."""
    calibrated: bool = True
    """Whether step and leak of every pixel are known, or only their means."""

    @model_validator(mode="after")
    def _check_voltages(self) -> Self:
        if self.swing_v > self.supply_v or self.step_v > self.swing_v:
            raise ValueError(
                f"counter: step_v {self.step_v:g}, swing_v {self.swing_v:g}, supply_v "
                f"{self.supply_v:g}; a step must fit into the swing, the swing into the supply"
            )
        for field, mean, sigma in (
            ("step_sigma_v", self.step_v, self.step_sigma_v),
            ("leak_sigma_v_s", self.leak_v_s, self.leak_sigma_v_s),
        ):
            if sigma * _LARGEST_Z > mean:
                raise ValueError(
                    f"counter.{field}: {sigma:g} about a mean of {mean:g}; use at most "
                    f"{mean / _LARGEST_Z:g}, so that no pixel's is negative"
                )
        if self.capacity > _LARGEST_CAPACITY:
            raise ValueError(
                f"counter.step_v: {self.step_v:g} makes {self.capacity} counts; at most "
                f"{_LARGEST_CAPACITY} are stored: make it larger or lower swing_v"
            )
        return self

    @classmethod
    def off(cls) -> DigitalCounter:
        """Return a counter that is practically never full."""
        return DigitalCounter()

    @property
    def capacity(self) -> int:
        """Largest count of a pixel of nominal step without leak."""
        return _capacity(self.swing_v, self.step_v)

    @property
    def lsb_v(self) -> float:
        """Voltage between two codes of the ADC, V; 0 where it does not round."""
        return 0.0 if self.adc_bits is None else self.supply_v / (2**self.adc_bits - 1)


class AnalogPixels(NamedTuple):
    """Steps, V, and fall of the output by leakage in one exposure, V, both (rows, columns)."""

    step_v: Floats
    leaked_v: Floats


def analog_pixels(
    counter: AnalogCounter, shape: tuple[int, int], exposure_s: float, device_seed: int
) -> AnalogPixels:
    """Draw the pixels of a device.

    Raises
    ------
    ValueError
        When leakage alone empties a counter during the exposure, or a pixel's step is so small
        that its counts cannot be stored.
    """
    step = _scattered(counter.step_v, counter.step_sigma_v, shape, device_seed, "counter step")
    leak = _scattered(counter.leak_v_s, counter.leak_sigma_v_s, shape, device_seed, "counter leak")
    leaked = leak * exposure_s
    if leaked.size and leaked.max() + step.max() > counter.swing_v:
        raise ValueError(
            f"exposure_s: {exposure_s:g}; by then leakage has taken {leaked.max():g} V of the "
            f"counter.swing_v {counter.swing_v:g}; expose for less or lower counter.leak_v_s"
        )
    if step.size and _capacity(counter.swing_v, float(step.min())) > _LARGEST_CAPACITY:
        raise ValueError(
            f"counter.step_v: {step.min():g} in the pixel of the smallest step makes more than "
            f"{_LARGEST_CAPACITY} counts; make it larger or lower counter.step_sigma_v"
        )
    return AnalogPixels(step, leaked)


def nominal_pixels(counter: AnalogCounter, exposure_s: float) -> AnalogPixels:
    """Return what is assumed of every pixel without calibration."""
    return AnalogPixels(np.array([[counter.step_v]]), np.array([[counter.leak_v_s * exposure_s]]))


def read_analog(
    rng: np.random.Generator,
    events: NDArray[np.int64],
    counter: AnalogCounter,
    pixels: AnalogPixels,
    exposure_s: float,
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Counts, and where they are a lower bound, of a (rows, columns) frame of events."""
    assumed = pixels if counter.calibrated else nominal_pixels(counter, exposure_s)
    counts = np.empty(events.shape, np.int64)
    saturated = np.empty(events.shape, np.bool_)
    _read(rng, events, pixels, *_spread(assumed, events.shape), _volts(counter), counts, saturated)
    return counts, saturated


def error_variance(counter: AnalogCounter) -> float:
    """Variance, counts², of a calibrated reading before it is rounded to whole counts."""
    return (counter.read_noise_v**2 + counter.lsb_v**2 / 12) / counter.step_v**2


def _capacity(swing_v: float, step_v: float) -> int:
    return int(swing_v / step_v * (1 + 1e-9))


def _scattered(
    mean: float, sigma: float, shape: tuple[int, int], device_seed: int, purpose: str
) -> Floats:
    if sigma == 0:
        return np.full(shape, mean)
    return mean + sigma * pixel_normals(shape, device_seed, purpose)


def _spread(pixels: AnalogPixels, shape: tuple[int, ...]) -> tuple[Floats, Floats]:
    return np.broadcast_to(pixels.step_v, shape), np.broadcast_to(pixels.leaked_v, shape)


def _volts(counter: AnalogCounter) -> tuple[float, float, float, float]:
    return counter.supply_v, counter.swing_v, counter.read_noise_v, counter.lsb_v


@njit(cache=True, nogil=True)
def _read(  # type: ignore[no-untyped-def]
    rng, events, pixels, assumed_step_v, assumed_leaked_v, volts, counts, saturated
):
    supply, swing, read_noise, lsb = volts
    for row in range(events.shape[0]):
        for column in range(events.shape[1]):
            at = row, column
            fallen = events[at] * pixels.step_v[at] + pixels.leaked_v[at]
            is_empty = fallen > swing
            output = supply - min(fallen, swing)
            if read_noise > 0:
                output += read_noise * rng.standard_normal()
            if lsb > 0:
                output = min(max(np.rint(output / lsb), 0.0), np.rint(supply / lsb)) * lsb
            step, leaked = assumed_step_v[at], assumed_leaked_v[at]
            capacity = np.floor((swing - leaked) / step * (1 + 1e-9))
            count = max(np.rint((supply - leaked - output) / step), 0.0)
            counts[at] = min(count, capacity)
            saturated[at] = is_empty or count >= capacity
