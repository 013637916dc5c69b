"""What decides which avalanches occur: the effects on single avalanches, together."""

from functools import cached_property

from pydantic import BaseModel

from megalopta.sensor.effects.afterpulsing import Afterpulsing
from megalopta.sensor.effects.crosstalk import Crosstalk
from megalopta.sensor.effects.dead_time import DeadTime
from megalopta.sensor.effects.gating import Gate


class AvalancheEffects(BaseModel, frozen=True, extra="forbid"):
    """The effects on single avalanches; hashable. Fields are as those of `Sensor`."""

    gate: Gate = Gate()
    dead_time: DeadTime = DeadTime()
    afterpulsing: Afterpulsing = Afterpulsing()
    crosstalk: Crosstalk = Crosstalk()

    @cached_property
    def on(self) -> frozenset[str]:
        """Names of those that are on."""
        return frozenset(name for name in type(self).model_fields if getattr(self, name).is_on)

    @property
    def has_law(self) -> bool:
        """Whether dead time acts alone, and the counts have a law that can be drawn from."""
        return self.on == {"dead_time"} and self.dead_time.has_law

    @property
    def remembers(self) -> bool:
        """Whether an exposure leaves anything in the pixels that the next one may meet."""
        return not self.on <= {"gate", "crosstalk"}

    @property
    def memory_s(self) -> float:
        """Time after which a pixel has forgotten its past, dead times apart, s."""
        return float(sum(getattr(self, name).memory_s for name in self.on))

    @property
    def without_crosstalk(self) -> "AvalancheEffects":
        """The same of pixels that do not know of each other."""
        return self.model_copy(update={"crosstalk": Crosstalk()})
