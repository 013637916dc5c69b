"""Model of a SPAD image sensor, as plain frozen data, and the order of its effects.

Effects up to "telegraph" act on arrival rates, those up to "crosstalk" on avalanches, later ones on
counts. Effects on avalanches interact in time and are simulated together if more than one is on.
"""

from functools import cached_property
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import BaseModel, Field, model_validator

from megalopta.sensor.change import changed
from megalopta.sensor.effects.afterpulsing import Afterpulsing
from megalopta.sensor.effects.base import Effect
from megalopta.sensor.effects.bias import Bias, Temperature
from megalopta.sensor.effects.crosstalk import Crosstalk
from megalopta.sensor.effects.dark_counts import DarkCounts, Telegraph
from megalopta.sensor.effects.dead_time import DeadTime
from megalopta.sensor.effects.gating import Gate, open_fraction
from megalopta.sensor.effects.timing import Jitter, Tcspc
from megalopta.sensor.optics import LagShare, PixelOptics
from megalopta.sensor.spad.counters import AnalogCounter, DigitalCounter
from megalopta.sensor.spad.measured import MeasuredMaps

MOST_OFFSPRING = 0.95
"""Mean number of avalanches caused by one, at most, where no dead time ends the cascade."""


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

    @cached_property
    def is_closed_form(self) -> bool:
        """True if dead time acts alone, so that counts can be drawn directly."""
        return self.on == {"dead_time"} and self.dead_time.is_closed_form

    @cached_property
    def has_memory(self) -> bool:
        """True if an exposure leaves anything in the pixels that affects the next one."""
        return not self.on <= {"gate", "crosstalk"}

    @property
    def memory_s(self) -> float:
        """Time after which a pixel has forgotten its past, s; dead times excluded."""
        carriers_s = self.afterpulsing.memory_s if self.afterpulsing.is_on else 0.0
        return 20 * self.dead_time.recharge_s + carriers_s

    def replaced(self, **parts: Effect) -> "AvalancheEffects":
        """Return the effects with other parts, not checked; a copy would keep what is cached."""
        same = {name: getattr(self, name) for name in type(self).model_fields}
        return AvalancheEffects.model_construct(**(same | parts))


class Sensor(PixelOptics, frozen=True):
    """Single-photon image sensor behind a lens; the image sets the number of pixels."""

    unit: ClassVar[str] = "counts"
    """Unit of its readings."""

    kind: Literal["spad"] = "spad"
    """Kind of image sensor."""
    temperature: Temperature = Temperature()
    """Temperature, which affects dark counts and breakdown; by default that at which they hold."""
    bias: Bias = Bias()
    """Excess bias and breakdown mismatch, acting on efficiency and dark counts; default: off."""
    dark_counts: DarkCounts = DarkCounts()
    """Events without light; off by default."""
    measured: MeasuredMaps = MeasuredMaps()
    """Measured maps of a device's pixels, in place of drawn ones; none by default."""
    telegraph: Telegraph = Telegraph()
    """Dark counts that switch between levels; off by default."""
    lag_share: Annotated[LagShare, Field(exclude_if=lambda share: share == 0)] = 0.0
    """Share of the detections that come in the next exposure, or a later one (0: no image lag)."""
    gate: Gate = Gate()
    """Periodic window of sensitivity; always open by default."""
    dead_time: DeadTime = DeadTime()
    """Recovery after an event; none by default."""
    afterpulsing: Afterpulsing = Afterpulsing()
    """Events fired by trapped carriers of earlier ones; off by default."""
    crosstalk: Crosstalk = Crosstalk()
    """Events fired by avalanches of neighboring pixels; off by default."""
    jitter: Jitter = Jitter()
    """Scatter of the time stamps of events; none by default."""
    tcspc: Tcspc = Field(default=Tcspc(), exclude_if=lambda tcspc: not tcspc.is_on)
    """Pulsed light whose photons are counted by their time (histograms only); off by default."""
    counter: Annotated[DigitalCounter | AnalogCounter, Field(discriminator="kind")] = (
        DigitalCounter()
    )
    """Counter in the pixel; by default one that practically never saturates."""
    device_seed: int = 0
    """Device seed: fixes the pattern of its pixels (any integer, including 0). In two sensors with
    the same seed, pixels at the same place have the same rank in each pattern."""

    @model_validator(mode="after")
    def _check_effects(self) -> Self:
        """Refuse effects that contradict each other or that nothing would show."""
        if open_fraction(self.gate, self.counted_s) == 0:
            raise ValueError(
                f"gate: it does not open in an exposure_s of {self.counted_s:g}; lower phase_s "
                f"{self.gate.phase_s:g} or expose for longer"
            )
        per_k = self.temperature.breakdown_v_per_k
        if self.temperature.is_on and per_k > 0 and not self.bias.matters:
            raise ValueError(
                f"temperature.breakdown_v_per_k: {per_k:g}, but nothing depends on bias; give "
                "bias.efficiency_scale_v, dark_efold_v, afterpulsing_slope or crosstalk_slope"
            )
        if self.telegraph.is_on and not (self.dark_counts.is_on or self.measured.dark_counts):
            raise ValueError(
                f"telegraph.share: {self.telegraph.share:g}, but there are no dark counts that "
                "could switch; give dark_counts"
            )
        carriers, fired = self.afterpulsing.mean_carriers, self.crosstalk.most_fired
        if not self.dead_time.is_on and carriers + fired > MOST_OFFSPRING:
            raise ValueError(
                f"afterpulsing.mean_carriers: {carriers:g} and crosstalk.mean_fired_neighbors "
                f"{fired:g} are together above {MOST_OFFSPRING:g}, so that avalanches without dead "
                "time never end; lower them or give dead_time"
            )
        return self

    @model_validator(mode="after")
    def _check_maps(self) -> Self:
        if self.measured.stuck and self.counter.kind != "digital":
            raise ValueError(
                "measured.stuck: readings of an analog counter are not given by a count; remove "
                "the map, or use a digital counter"
            )
        of_map = getattr(self.measured.efficiency, "fill_factor", None) or self.fill_factor
        if of_map != self.fill_factor:
            raise ValueError(
                f"fill_factor: {self.fill_factor:g}, but measured.efficiency was calibrated with "
                f"{of_map:g}, as a factor on whole pixels; leave {of_map:g}, or state yours in the "
                "--preset file of spadcam calibrate"
            )
        for name in self.measured.relative:
            if getattr(self.measured, name) and not getattr(self, name).is_on:
                raise ValueError(
                    f"measured.{name}: a map of factors on {name}, which is off; give {name} its "
                    "values or remove the map"
                )
        return self

    @cached_property
    def avalanche_effects(self) -> AvalancheEffects:
        """Effects that decide which avalanches occur."""
        names = AvalancheEffects.model_fields
        return AvalancheEffects(**{name: getattr(self, name) for name in names})

    @property
    def counted_s(self) -> float:
        """Time after which the counter is reset, s: the exposure, or its part of a sum."""
        return self.exposure_s / self.counter.sums

    @property
    def largest(self) -> int:
        """Largest reading."""
        return self.counter.sums * self.counter.capacity

    @property
    def has_plain_bits(self) -> bool:
        """True if a pixel's chance of an event depends on its own rate alone: 1 − exp(−r·T)."""
        is_live = self.dead_time.start == "live" or not self.avalanche_effects.has_memory
        return is_live and not self.crosstalk.is_on

    @cached_property
    def count_distribution(self) -> Literal["Poisson", "crosstalk", "dead time", "simulated"]:
        """Distribution of the counts of an exposure in steady light."""
        on = self.avalanche_effects.on
        if not on:
            return "Poisson"
        if on <= {"gate", "crosstalk"}:
            return "crosstalk"
        return "dead time" if self.avalanche_effects.is_closed_form else "simulated"


ORDER_OF_EFFECTS = (
    *("lens", "efficiency", "filters", "lag_share"),  # light on the pixels
    *("dark_counts", "measured"),  # the device as made
    *("temperature", "bias", "telegraph"),  # its operation
    *("gate", "dead_time", "afterpulsing", "crosstalk"),  # avalanches
    *("jitter", "tcspc", "counter"),  # readout
)
"""Effect fields of `Sensor`, first to last."""


def without(sensor: Sensor, field: str) -> Sensor:
    """Return the sensor with one effect switched off.

    Without "efficiency", every photon on the active area is detected if the pixel's bias is above
    the onset. Without "dark_counts", measured and switching dark counts are off too.

    Raises ValueError if there is no effect of this name.
    """
    if field not in ORDER_OF_EFFECTS:
        known = ", ".join(ORDER_OF_EFFECTS)
        raise ValueError(f"effect {field!r}: no such effect; choose from {known}")
    changes: dict[str, Any] = {field: 0.0}
    if field != "lag_share":
        changes = {field: getattr(sensor, field).off()}
    if field in MeasuredMaps.of_effect:
        changes["measured"] = {MeasuredMaps.of_effect[field]: None}
    if field in MeasuredMaps.relative:
        changes["measured"] = {field: None}
    if field == "dark_counts":
        changes["telegraph"] = Telegraph.off()
    if field == "efficiency":
        bias = sensor.bias.model_copy(update={"efficiency_scale_v": None})
        changes["bias"] = bias if bias.matters else Bias()
    return changed(sensor, **changes)
