"""Shading: the efficiency falls from the middle of the array to its corners."""

from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from megalopta.sensor.effects.base import Effect, PixelRates, Stage


class Shading(Effect, frozen=True):
    """Fall of the efficiency toward the corners of the array; none by default."""

    stage: ClassVar[Stage] = Stage.DEVICE
    statement: ClassVar[str] = "microlenses lose light toward the corners"

    loss: Annotated[float, Field(ge=0, lt=1)] = 0.0
    """Share of the light that is lost in the corners."""

    def act_on_rates(self, rates: PixelRates) -> None:
        """Lower the efficiency with the square of the distance from the middle."""
        y, x = (np.linspace(-1, 1, max(size, 2))[:size] for size in rates.shape)
        rates.efficiency_factor *= 1 - self.loss * (x**2 + y[:, np.newaxis] ** 2) / 2
