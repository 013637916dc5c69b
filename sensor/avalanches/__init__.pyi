from .counts import count_moments, draw_counts
from .simulation import AvalancheEffects, simulate_counts, simulate_events

__all__ = [
    "AvalancheEffects",
    "count_moments",
    "draw_counts",
    "simulate_counts",
    "simulate_events",
]
