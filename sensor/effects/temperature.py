"""Temperature: thermal dark counts double every few kelvin; the breakdown voltage rises.

    DCR(T) = DCR(T_ref)·2^((T − T_ref)/ΔT)

Thermal generation through traps only; tunneling, which sets the floor in deep sub-micron processes,
hardly depends on temperature. The breakdown voltage rises linearly, as hot carriers lose more
energy to the lattice, by 0.02 to 0.06 V/K in silicon diodes that break down at 15 to 40 V. So the
excess bias falls at a constant bias (`bias`). Cooling by 30 to 40 K lowers the rate by one to two
decades (dissertation §2.3.1), that is ΔT of 6 to 9 K; 8 to 10 K is usual for silicon.
"""

from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from megalopta.sensor.effects.base import Effect, PixelRates, Stage


class Temperature(Effect, frozen=True):
    """Temperature of the chip; by default that at which the dark counts hold."""

    stage: ClassVar[Stage] = Stage.OPERATION
    statement: ClassVar[str] = "temperature scales the dark counts and moves the breakdown voltage"

    celsius: Annotated[float, Field(gt=-273.15, le=1000)] = 20.0
    """Temperature of the chip (°C)."""
    reference_celsius: Annotated[float, Field(gt=-273.15, le=1000)] = 20.0
    """Temperature at which the dark count rates hold (°C)."""
    dcr_doubling_k: Annotated[float, Field(gt=0)] = 9.0
    """Rise in temperature that doubles the dark count rate (K)."""
    breakdown_v_per_k: Annotated[float, Field(ge=0, le=1)] = 0.0
    """Rise of the breakdown voltage per kelvin (V/K), by which the excess bias falls."""

    @property
    def is_on(self) -> bool:
        """True if it differs from the temperature at which the dark counts hold."""
        return self.celsius != self.reference_celsius

    def act_on_rates(self, rates: PixelRates) -> None:
        """Scale the dark counts and shift the breakdown voltage."""
        rise = self.celsius - self.reference_celsius
        rates.breakdown_shift_v += self.breakdown_v_per_k * rise
        with np.errstate(invalid="ignore"):
            rates.dark_counts_hz *= dark_count_factor(self)


def dark_count_factor(temperature: Temperature) -> float:
    """Dark count rate relative to that at the reference temperature."""
    rise = temperature.celsius - temperature.reference_celsius
    with np.errstate(over="ignore"):  # `draw_fixed_pattern` rejects values that are not finite
        return float(np.exp2(rise / temperature.dcr_doubling_k))
