from .dense_flow import (
    charge_of as charge_of,
    likelihood_flow as likelihood_flow,
    stiffness as stiffness,
    times_from_reference as times_from_reference,
)
from .evidence import (
    NODE_PX as NODE_PX,
    Evidence as Evidence,
    Level as Level,
    evidence as evidence,
    finer as finer,
    level_of as level_of,
    levels as levels,
    to_nodes as to_nodes,
)
from .node_system import links as links, most_likely as most_likely
from .shot_noise import root_noise as root_noise, suited_blur_px as suited_blur_px
