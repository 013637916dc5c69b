"""Base of the parameter models of all effects.

An effect is one field of `Sensor`. Effects act in order of their stages, within a stage in order of
the fields. Default parameters have no effect.

An effect on rates overrides `act_on_rates`; one that changes with time, `act_on_frame`. One on
single avalanches (stage `AVALANCHES`) is also a field of `AvalancheEffects`, has a part in
`spad/kernel.py`, and is simulated where the count distribution has no closed form. Only files that
hold such a form name effects.
"""

from dataclasses import dataclass, field, replace
from enum import IntEnum, auto
from typing import ClassVar, NamedTuple

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.core.record import Record
from megalopta.sensor.sampling.streams import pixel_normals


class Stage(IntEnum):
    """Order of stages: light on the pixels, the device as made, its operation, then events."""

    LIGHT = auto()
    DEVICE = auto()
    OPERATION = auto()
    AVALANCHES = auto()
    READOUT = auto()


@dataclass
class PixelRates:
    """Effect of a device's pixels on rates; effects on rates change it in turn."""

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
    """Breakdown voltage above the nominal one, (H, W), if it was measured"""

    breakdown_shift_v: float = 0.0
    """Rise of every breakdown voltage since the reference temperature"""

    factors: dict[str, Floats] = field(default_factory=dict)
    """Factors on the values of dead_time, afterpulsing, crosstalk and telegraph, (H, W); missing: 1
    """

    stuck: Floats | None = None
    """Readings of stuck pixels, (H, W); -1: the pixel works"""

    measured: set[str] = field(default_factory=set)
    """Names of values measured at the reference bias and temperature"""

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
    """Differences between pixels: factors on values of a sensor's fields, each (rows, columns)."""

    dead_time: Floats
    """Factor on `dead_time.dead_time_s`"""
    afterpulsing: Floats
    """Factor on `afterpulsing.mean_carriers`"""
    crosstalk: Floats
    """Factor on `crosstalk.mean_fired_neighbors` of avalanches in this pixel"""

    @classmethod
    def alike(cls, shape: tuple[int, int]) -> "AvalancheMaps":
        """Maps of identical pixels."""
        return cls(*(np.ones(shape) for _ in cls._fields))

    @classmethod
    def of(cls, rates: PixelRates) -> "AvalancheMaps | None":
        """Maps found by the effects on rates; None if pixels are as the fields state."""
        factors = [rates.factors.get(name, np.ones(rates.shape)) for name in cls._fields]
        return cls(*factors) if any(np.any(factor != 1) for factor in factors) else None


class Frame(NamedTuple):
    """Identity of an exposure, for effects that change with time."""

    number: int
    """Frame number in its sequence"""
    time_s: float
    """Time from the start of frame 0"""
    run: int
    """Random number shared by all frames of a run: memory is a function of it"""


@dataclass
class FrameRates:
    """Rates in one frame; effects that change with time change them in turn."""

    detections_hz: Floats
    """Detection rate of always-live pixels, (H, W), or in S parts of the exposure (S, H, W)"""

    dark_counts_hz: Floats
    """Dark count rate, (H, W)"""

    device_seed: int

    telegraph_factor: Floats | None = None
    """Step of a pixel's traps relative to `telegraph.step`, (H, W); 0: none; None: all alike"""

    @property
    def switching(self) -> Floats:
        """That factor, 1 if all are alike."""
        return np.ones(()) if self.telegraph_factor is None else self.telegraph_factor

    def with_dark_counts(self, factor: Floats) -> "FrameRates":
        """Return the rates with dark counts multiplied by a factor."""
        return replace(self, dark_counts_hz=self.dark_counts_hz * factor)


class Effect(Record):
    """Parameters of one effect."""

    stage: ClassVar[Stage]
    statement: ClassVar[str]
    """Description for readers"""
    switch: ClassVar[str] = ""
    """Field of which a value other than 0 switches it on; empty: any field that is changed"""
    scattered: ClassVar[str] = ""
    """Name in `PixelRates.factors` that its `mismatch_sigma` scatters over the pixels"""

    @property
    def is_on(self) -> bool:
        """True if it has any effect."""
        return bool(getattr(self, self.switch)) if self.switch else self != self.off()

    @property
    def memory_s(self) -> float:
        """Time after which a pixel has forgotten the effect's influence, s."""
        return 0.0

    @classmethod
    def off(cls) -> "Effect":
        """Return the same effect switched off (a lens: a perfect one)."""
        return cls()

    def act_on_rates(self, rates: PixelRates) -> None:
        """Change the rates of the pixels, in place; by default by the scatter of `scattered`."""
        if self.is_on:
            rates.scatter(self.scattered, getattr(self, "mismatch_sigma", 0.0))

    def act_on_frame(self, rates: FrameRates, rng: np.random.Generator, frame: Frame) -> None:
        """Change the rates in one frame, in place; by default nothing.

        `rng` belongs to the frame. Frames may be drawn in any order, so an effect's memory must be
        a function of `frame`.
        """

    def over_time(self, rates: FrameRates) -> list[tuple[float, FrameRates]]:
        """Return the long-run outcomes of `act_on_frame`, each with its probability."""
        return [(1.0, rates)]
