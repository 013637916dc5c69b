"""Everything that describes one image sensor, as plain frozen data."""

from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from megalopta.sensor.effects.fields import AvalancheEffects, RateEffects
from megalopta.sensor.effects.gating import open_fraction
from megalopta.sensor.effects.jitter import Jitter
from megalopta.sensor.optics.pixels import PixelOptics
from megalopta.sensor.spad.analog import AnalogCounter
from megalopta.sensor.spad.digital import DigitalCounter
from megalopta.sensor.spad.measured import MeasuredMaps

MOST_OFFSPRING = 0.95
"""Avalanches that one may cause, on average, where no dead time ends the cascade."""


class Device(RateEffects, PixelOptics, frozen=True):
    """What makes the rates of the pixels what they are."""

    measured: MeasuredMaps = MeasuredMaps()
    """Measured maps of the pixels of one device, in place of drawn ones; none by default."""


class Sensor(AvalancheEffects, Device, frozen=True):
    """A single-photon image sensor behind a lens; the number of pixels is that of the image."""

    unit: ClassVar[str] = "counts"
    """What its readings are in."""

    kind: Literal["spad"] = "spad"
    """Names this kind of image sensor."""
    jitter: Jitter = Jitter()
    """Scatter of the time stamps of events; none by default."""
    counter: Annotated[DigitalCounter | AnalogCounter, Field(discriminator="kind")] = (
        DigitalCounter()
    )
    """What counts the events in the pixel; by default one that is practically never full."""
    device_seed: int = 0
    """Which device of this kind: fixes the pattern of its pixels (any integer, 0 included). Where
    two sensors share it, pixels at the same place rank alike in each of their patterns."""

    @model_validator(mode="after")
    def _check_gate(self) -> Self:
        if open_fraction(self.gate, self.exposure_s) == 0:
            raise ValueError(
                f"gate: it does not open in an exposure_s of {self.exposure_s:g}; lower phase_s "
                f"{self.gate.phase_s:g} or expose for longer"
            )
        return self

    @model_validator(mode="after")
    def _check_breakdown(self) -> Self:
        per_k = self.temperature.breakdown_v_per_k
        if self.temperature.is_on and per_k > 0 and not self.bias.matters:
            raise ValueError(
                f"temperature.breakdown_v_per_k: {per_k:g}, but nothing depends on bias; give "
                "bias.efficiency_scale_v, dark_efold_v, afterpulsing_slope or crosstalk_slope"
            )
        return self

    @model_validator(mode="after")
    def _check_cascade(self) -> Self:
        carriers, fired = self.afterpulsing.mean_carriers, self.crosstalk.mean_fired_neighbors
        if not self.dead_time.is_on and carriers + fired > MOST_OFFSPRING:
            raise ValueError(
                f"afterpulsing.mean_carriers: {carriers:g} and crosstalk.mean_fired_neighbors "
                f"{fired:g} are together above {MOST_OFFSPRING:g}, so that avalanches without dead "
                "time never end; lower them or give dead_time"
            )
        return self

    @model_validator(mode="after")
    def _check_relative_maps(self) -> Self:
        for name in self.measured.relative:
            if getattr(self.measured, name) and not getattr(self, name).is_on:
                raise ValueError(
                    f"measured.{name}: a map of factors on {name}, which is off; give {name} its "
                    "values or remove the map"
                )
        return self

    @property
    def counter_capacity(self) -> int:
        """Largest count a pixel can hold."""
        return self.counter.capacity

    @property
    def avalanche_effects(self) -> AvalancheEffects:
        """What decides which avalanches occur."""
        names = AvalancheEffects.model_fields
        return AvalancheEffects(**{name: getattr(self, name) for name in names})
