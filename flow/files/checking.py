"""What every writer of flow asks of an array."""

import numpy as np
from numpy.typing import NDArray


def check_flow(flow: NDArray[np.floating]) -> None:
    """Refuse, with ValueError, what is no flow (H, W, 2) of one pixel or more."""
    if flow.ndim != 3 or flow.shape[-1] != 2 or 0 in flow.shape:
        raise ValueError(f"flow of shape {flow.shape}: give (H, W, 2)")
