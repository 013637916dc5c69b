"""Neutral filter over the pixels: light of all wavelengths falls to 10^(−D), dark counts stay."""

from typing import Annotated, ClassVar

from pydantic import Field

from megalopta.sensor.effects.base import Effect, PixelRates, Stage


class NeutralFilter(Effect, frozen=True):
    """A filter that is gray; none by default."""

    stage: ClassVar[Stage] = Stage.OPERATION
    statement: ClassVar[str] = "a neutral filter takes its share of the light"

    optical_density: Annotated[float, Field(ge=0, le=20)] = 0.0
    """Negative decadic logarithm of the transmission (0: no filter)."""

    def act_on_rates(self, rates: PixelRates) -> None:
        """Let a share of the light through."""
        rates.efficiency_factor *= 10**-self.optical_density
