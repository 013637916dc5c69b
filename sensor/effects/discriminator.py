"""Discriminator: pulses below its threshold are not counted, though the pixel has fired.

A missed avalanche makes the pixel dead, fills traps and lights neighbors as any other. Counts are
those of the avalanches, each kept with probability 1 − m: of mean N̄ and variance V without,

    mean (1 − m)·N̄          variance (1 − m)²·V + m·(1 − m)·N̄
"""

from typing import Annotated, ClassVar

from pydantic import Field

from megalopta.sensor.effects.base import Effect, Stage


class Discriminator(Effect, frozen=True):
    """Share of the avalanches that is missed; none by default."""

    stage: ClassVar[Stage] = Stage.AVALANCHES
    statement: ClassVar[str] = "pulses below the threshold are not counted"

    missed: Annotated[float, Field(ge=0, lt=1)] = 0.0
    """Probability that an avalanche is not counted (0: all are)."""
