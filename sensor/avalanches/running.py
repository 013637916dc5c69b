"""Arrays that run freely: every exposure goes on where the one before ended, without a gap."""

from dataclasses import dataclass

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.sensor.avalanches.simulation import PixelState, SimulatedFrame, simulate_frame
from megalopta.sensor.effects.fields import AvalancheEffects
from megalopta.sensor.effects.mismatch import AvalancheMaps


@dataclass
class FreeRunning:
    """An array between two exposures; `FreeRunning()` has not begun.

    Attributes
    ----------
    state : PixelState, optional
        What its pixels remember; replaced by every exposure.
    """

    state: PixelState | None = None

    def expose(
        self,
        rng: np.random.Generator,
        rate_hz: Floats,
        exposure_s: float,
        effects: AvalancheEffects,
        maps: AvalancheMaps | None = None,
        *,
        keep_events: bool = True,
    ) -> SimulatedFrame:
        """Simulate the next exposure; parameters as for `simulate_frame`.

        Raises
        ------
        ValueError
            When the array had another number of pixels before.
        """
        rows, columns = rate_hz.shape[-2:]
        if self.state is not None and self.state.blind_until_s.size != rows * columns:
            raise ValueError(
                f"free_running: the array had {self.state.blind_until_s.size} pixels before and "
                f"has {rows} × {columns} now; give the same frames, or begin anew"
            )
        frame = simulate_frame(
            rng, rate_hz, exposure_s, effects, maps=maps, state=self.state, keep_events=keep_events
        )
        self.state = frame.state
        return frame


def running_array(
    free_running: bool | FreeRunning, effects: AvalancheEffects
) -> FreeRunning | None:
    """The array that goes on, a new one for True; none where frames do not depend on each other."""
    if not free_running or not effects.remembers:
        return None
    return FreeRunning() if free_running is True else free_running
