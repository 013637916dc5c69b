"""What the parameter models of all effects have in common.

An effect is one field of `Sensor`, most of them by `fields`, and acts in the order of its stage;
within a stage effects act in the order of the fields. Default parameters do nothing.

One on rates overrides `act_on_rates`, one that changes with time `act_on_frame`. One on single
avalanches, whose stage is `AVALANCHES`, has a part in `avalanches/kernel.py`; wherever no law of
the counts is known it is simulated. No other file names an effect unless it states a law of it.
"""

from dataclasses import dataclass, field, replace
from enum import IntEnum, auto
from typing import ClassVar, NamedTuple

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.core.record import Record
from megalopta.sensor.sampling.streams import pixel_normals


class Stage(IntEnum):
    """Light on the pixels, a device as it was made, what its operation makes of it, then events."""

    LIGHT = auto()
    DEVICE = auto()
    OPERATION = auto()
    AVALANCHES = auto()
    READOUT = auto()


@dataclass
class PixelRates:
    """What the pixels of a device do to rates; effects on rates change it one after the other."""

    shape: tuple[int, int]
    """Rows and columns"""

    device_seed: int
    active_area_m2: float
    """Light-sensitive area of a pixel"""

    efficiency_factor: Floats
    """Detection efficiency relative to the sensor's curve, (H, W)"""

    dark_counts_hz: Floats
    """Dark count rate, (H, W)"""

    breakdown_offset_v: Floats | None = None
    """Breakdown voltage above the nominal one, (H, W), where it was measured"""

    breakdown_shift_v: float = 0.0
    """Rise of every breakdown voltage since the reference temperature"""

    factors: dict[str, Floats] = field(default_factory=dict)
    """On the values of dead_time, afterpulsing and crosstalk, (H, W); not named: 1"""

    measured: set[str] = field(default_factory=set)
    """What was measured, at the reference bias and temperature"""

    def scale(self, name: str, factor: Floats) -> None:
        """Multiply one of `factors`."""
        self.factors[name] = self.factors.get(name, np.ones(self.shape)) * factor

    def scatter(self, name: str, sigma: float) -> None:
        """Multiply one of `factors` by log-normal numbers of mean 1, unless it was measured."""
        if sigma > 0 and name not in self.measured:
            log_sigma = np.sqrt(np.log1p(sigma**2))
            normals = pixel_normals(self.shape, self.device_seed, f"{name} mismatch")
            self.scale(name, np.exp(log_sigma * normals - log_sigma**2 / 2))


class AvalancheMaps(NamedTuple):
    """How pixels differ: factors on the values of a sensor's fields, (rows, columns) each."""

    dead_time: Floats
    """On `dead_time.dead_time_s`"""
    afterpulsing: Floats
    """On `afterpulsing.mean_carriers`"""
    crosstalk: Floats
    """On `crosstalk.mean_fired_neighbors` of avalanches in this pixel"""

    @classmethod
    def alike(cls, shape: tuple[int, int]) -> "AvalancheMaps":
        """Pixels that do not differ."""
        return cls(*(np.ones(shape) for _ in cls._fields))

    @classmethod
    def of(cls, rates: PixelRates) -> "AvalancheMaps | None":
        """What the effects on rates have found; none where pixels are as the fields say."""
        factors = [rates.factors.get(name, np.ones(rates.shape)) for name in cls._fields]
        return cls(*factors) if any(np.any(factor != 1) for factor in factors) else None


class Frame(NamedTuple):
    """Which exposure it is, for effects that change with time."""

    number: int
    """In its sequence"""
    time_s: float
    """From the start of frame 0"""
    run: int
    """A random number, the same in all frames of a run: what has memory is a function of it"""


@dataclass
class FrameRates:
    """Rates in one frame; effects that change with time change them one after the other."""

    detections_hz: Floats
    """Photons that a pixel would detect if always live, (H, W), or in S parts of the exposure
    (S, H, W)"""

    dark_counts_hz: Floats
    """Dark count rate, (H, W)"""

    device_seed: int

    def with_dark_counts(self, factor: Floats) -> "FrameRates":
        """Return the rates with so many times the dark counts."""
        return replace(self, dark_counts_hz=self.dark_counts_hz * factor)


class Effect(Record):
    """Parameters of one effect."""

    stage: ClassVar[Stage]
    statement: ClassVar[str]
    """What it does, for a reader"""

    @property
    def is_on(self) -> bool:
        """Whether it does anything."""
        return self != self.off()

    @property
    def memory_s(self) -> float:
        """Time after which a pixel has forgotten what the effect left of its past, s."""
        return 0.0

    @classmethod
    def off(cls) -> "Effect":
        """Return an effect in its place that does nothing (a lens: a perfect one)."""
        return cls()

    def act_on_rates(self, rates: PixelRates) -> None:
        """Change the rates of the pixels, in place; by default nothing."""

    def act_on_frame(self, rates: FrameRates, rng: np.random.Generator, frame: Frame) -> None:
        """Change the rates in one frame, in place; by default nothing.

        `rng` is the frame's own. A frame may be drawn before those that precede it: what the effect
        remembers must be a function of `frame`.
        """

    def over_time(self, rates: FrameRates) -> list[tuple[float, FrameRates]]:
        """Return what `act_on_frame` makes of rates in the long run, each with its chance."""
        return [(1.0, rates)]
