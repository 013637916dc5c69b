from .counts import count_moments, draw_counts
from .coupled import MEAN_ERROR, VARIANCE_ERROR
from .simulation import (
    AvalancheEffects,
    PixelState,
    SimulatedFrame,
    simulate_counts,
    simulate_events,
    simulate_frame,
)

__all__ = [
    "MEAN_ERROR",
    "VARIANCE_ERROR",
    "AvalancheEffects",
    "PixelState",
    "SimulatedFrame",
    "count_moments",
    "draw_counts",
    "simulate_counts",
    "simulate_events",
    "simulate_frame",
]
