"""Hum of the mains: lamps make the light swing at twice the frequency of the mains."""

from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from megalopta.sensor.effects.base import Effect, Frame, FrameRates, Stage


class Hum(Effect, frozen=True):
    """Light that swings from frame to frame; off by default."""

    stage: ClassVar[Stage] = Stage.OPERATION
    statement: ClassVar[str] = "light swings with the mains"

    depth: Annotated[float, Field(ge=0, le=1)] = 0.0
    """Amplitude over the mean."""
    frequency_hz: Annotated[float, Field(gt=0)] = 100.0
    """Of the swing (Hz)."""

    def act_on_frame(self, rates: FrameRates, rng: np.random.Generator, frame: Frame) -> None:
        """Scale the light."""
        phase = 2 * np.pi * self.frequency_hz * frame.time_s
        rates.detections_hz *= 1 + self.depth * np.sin(phase)
