from .counts import count_moments, draw_counts
from .coupled import MEAN_ERROR, VARIANCE_ERROR
from .simulation import (
    PixelState,
    SimulatedFrame,
    simulate_counts,
    simulate_events,
    simulate_frame,
)

__all__ = [
    "MEAN_ERROR",
    "VARIANCE_ERROR",
    "PixelState",
    "SimulatedFrame",
    "count_moments",
    "draw_counts",
    "simulate_counts",
    "simulate_events",
    "simulate_frame",
]
