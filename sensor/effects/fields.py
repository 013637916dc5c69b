"""The effects of a sensor as its fields, each once: `Sensor` derives from these two models.

An effect on rates becomes a field of the first, one on single avalanches a field of the second.
"""

from pydantic import BaseModel

from megalopta.sensor.effects.afterpulsing import Afterpulsing
from megalopta.sensor.effects.bias import Bias
from megalopta.sensor.effects.crosstalk import Crosstalk
from megalopta.sensor.effects.dark_counts import DarkCounts
from megalopta.sensor.effects.dead_time import DeadTime
from megalopta.sensor.effects.gating import Gate
from megalopta.sensor.effects.temperature import Temperature


class RateEffects(BaseModel, frozen=True, extra="forbid", use_attribute_docstrings=True):
    """What changes the rates of the pixels."""

    temperature: Temperature = Temperature()
    """Temperature, which moves dark counts and breakdown; by default that at which they hold."""
    bias: Bias = Bias()
    """Excess bias and breakdown mismatch, which move efficiency and dark counts; off by default."""
    dark_counts: DarkCounts = DarkCounts()
    """Events without light; off by default."""


class AvalancheEffects(BaseModel, frozen=True, extra="forbid", use_attribute_docstrings=True):
    """What decides which avalanches occur; hashable."""

    gate: Gate = Gate()
    """Periodic window of sensitivity; always open by default."""
    dead_time: DeadTime = DeadTime()
    """Recovery after an event; none by default."""
    afterpulsing: Afterpulsing = Afterpulsing()
    """Events fired by carriers of earlier ones; off by default."""
    crosstalk: Crosstalk = Crosstalk()
    """Events fired by those of neighboring pixels; off by default."""

    @property
    def on(self) -> frozenset[str]:
        """Names of those that are on."""
        return frozenset(name for name, effect in self if effect.is_on)

    @property
    def remembers(self) -> bool:
        """Whether an exposure leaves anything in the pixels that the next one may meet."""
        return not self.on <= {"gate", "crosstalk"}

    @property
    def memory_s(self) -> float:
        """Time after which a pixel has forgotten its past, dead times apart, s."""
        return float(sum(effect.memory_s for _, effect in self if effect.is_on))

    @property
    def without_crosstalk(self) -> "AvalancheEffects":
        """The same of pixels that do not know of each other."""
        return self.model_copy(update={"crosstalk": Crosstalk()})
