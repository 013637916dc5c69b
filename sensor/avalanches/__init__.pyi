from .counts import (
    count_moments as count_moments,
    draw_counts as draw_counts,
)
from .coupled import (
    MEAN_ERROR as MEAN_ERROR,
    VARIANCE_ERROR as VARIANCE_ERROR,
)
from .running import (
    FreeRunning as FreeRunning,
    running_array as running_array,
)
from .simulation import (
    PixelState as PixelState,
    SimulatedFrame as SimulatedFrame,
    simulate_counts as simulate_counts,
    simulate_events as simulate_events,
    simulate_frame as simulate_frame,
)
from .tables import NODES_PER_DECADE as NODES_PER_DECADE
