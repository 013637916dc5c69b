"""Base of the parameter models of all effects; `spad.model` lists them in the order they act."""

from typing import ClassVar, NamedTuple

from megalopta.core.arrays import Floats
from megalopta.core.record import Record


class AvalancheMaps(NamedTuple):
    """Differences between pixels: factors on values of a sensor's fields, each (rows, columns)."""

    dead_time: Floats
    """Factor on `dead_time.dead_time_s`"""
    afterpulsing: Floats
    """Factor on `afterpulsing.mean_carriers`"""
    crosstalk: Floats
    """Factor on `crosstalk.mean_fired_neighbors` of avalanches in this pixel"""


class Effect(Record):
    """Parameters of one effect; default parameters have no effect."""

    switch: ClassVar[str] = ""
    """Field of which a value other than 0 switches it on; empty: any field that is changed"""

    @property
    def is_on(self) -> bool:
        """True if it has any effect."""
        return bool(getattr(self, self.switch)) if self.switch else self != self.off()

    @classmethod
    def off(cls) -> "Effect":
        """Return the same effect switched off (a lens: a perfect one)."""
        return cls()
