from .bodies import (
    ball as ball,
    box as box,
    checkerboard as checkerboard,
)
from .dead_leaves_model import dead_leaves as dead_leaves
from .grating import (
    GratingVariant as GratingVariant,
    Pattern as Pattern,
    bars as bars,
    board as board,
    moving_cycles as moving_cycles,
    open_cylinder as open_cylinder,
    random_dots as random_dots,
    sine_grating as sine_grating,
)
