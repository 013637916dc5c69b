"""Base of the parameter models of all effects.

An effect is one field of `Sensor`. Effects act in order of their stages, within a stage in order of
the fields. Default parameters have no effect.

Effects on rates act in `spad/device.py`. One on single avalanches (stage `AVALANCHES`) is also a
field of `AvalancheEffects`, has a part in `spad/kernel.py`, and is simulated where the count
distribution has no closed form. Only files that hold such a form name effects.
"""

from enum import IntEnum, auto
from typing import ClassVar, NamedTuple

from megalopta.core.arrays import Floats
from megalopta.core.record import Record


class Stage(IntEnum):
    """Order of stages: light on the pixels, the device as made, its operation, then events."""

    LIGHT = auto()
    DEVICE = auto()
    OPERATION = auto()
    AVALANCHES = auto()
    READOUT = auto()


class AvalancheMaps(NamedTuple):
    """Differences between pixels: factors on values of a sensor's fields, each (rows, columns)."""

    dead_time: Floats
    """Factor on `dead_time.dead_time_s`"""
    afterpulsing: Floats
    """Factor on `afterpulsing.mean_carriers`"""
    crosstalk: Floats
    """Factor on `crosstalk.mean_fired_neighbors` of avalanches in this pixel"""


class Effect(Record):
    """Parameters of one effect."""

    stage: ClassVar[Stage]
    statement: ClassVar[str]
    """Description for readers"""
    switch: ClassVar[str] = ""
    """Field of which a value other than 0 switches it on; empty: any field that is changed"""

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
