"""Effects on single avalanches, together: they decide which avalanches occur."""

from functools import cached_property

from pydantic import BaseModel

from megalopta.sensor.effects.afterpulsing import Afterpulsing
from megalopta.sensor.effects.crosstalk import Crosstalk
from megalopta.sensor.effects.dead_time import DeadTime
from megalopta.sensor.effects.gating import Gate


class AvalancheEffects(BaseModel, frozen=True, extra="forbid"):
    """Effects on single avalanches; hashable. Fields are as those of `Sensor`."""

    gate: Gate = Gate()
    dead_time: DeadTime = DeadTime()
    afterpulsing: Afterpulsing = Afterpulsing()
    crosstalk: Crosstalk = Crosstalk()

    @cached_property
    def on(self) -> frozenset[str]:
        """Names of the effects that are on."""
        return frozenset(name for name in type(self).model_fields if getattr(self, name).is_on)

    @property
    def has_law(self) -> bool:
        """True if dead time acts alone, so that counts can be drawn directly."""
        return self.on == {"dead_time"} and self.dead_time.has_law

    @property
    def remembers(self) -> bool:
        """True if an exposure leaves anything in the pixels that affects the next one."""
        return not self.on <= {"gate", "crosstalk"}

    @property
    def memory_s(self) -> float:
        """Time after which a pixel has forgotten its past, s; dead times excluded."""
        return float(sum(getattr(self, name).memory_s for name in self.on))

    @property
    def without_crosstalk(self) -> "AvalancheEffects":
        """The same effects without crosstalk."""
        return self.model_copy(update={"crosstalk": Crosstalk()})
