"""Flow as color: hue is direction, saturation is speed, as on the Middlebury wheel.

The hues are those of Baker et al. (IJCV 92, 2011), spaced to look even: motion to the right is red,
down yellow, left cyan, up violet. No motion is white; at `max_speed` a color is pure; above it is
darkened to three quarters, so that values beyond the scale show. Undefined flow is mid gray.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Rgb = NDArray[np.uint8]

# The corners of the RGB cube around the wheel, red first, and the steps from each to the next.
_CORNERS = np.array([(1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 1, 1), (0, 0, 1), (1, 0, 1), (1, 0, 0)])
_STEPS = np.array([15, 6, 4, 11, 13, 6])
_TURN = np.concatenate(([0.0], np.cumsum(_STEPS) / _STEPS.sum()))


def flow_to_rgb(flow: NDArray[np.floating[Any]], max_speed: float) -> Rgb:
    """Return a picture (..., 3) of flows (..., 2), +x right, +y down, NaN where undefined.

    A speed of `max_speed`, in the unit of the flow, has the pure color. Raises ValueError if it is
    not positive, or the flow does not have two components.

    Examples
    --------
    >>> flow_to_rgb(np.array([[2.0, 0.0], [np.nan, 0.0]]), max_speed=2)
    array([[255,   0,   0],
           [128, 128, 128]], dtype=uint8)
    """
    if not 0 < max_speed < np.inf:
        raise ValueError(f"max_speed {max_speed!r}: give a positive speed")
    if flow.shape[-1:] != (2,):
        raise ValueError(f"flow of shape {flow.shape}: give (..., 2)")
    undefined = np.isnan(flow).any(axis=-1)
    x, y = np.moveaxis(np.where(undefined[..., np.newaxis], 0, flow).astype(np.float64), -1, 0)
    speed = np.hypot(x, y)[..., np.newaxis] / max_speed
    turn = np.arctan2(y, x) / (2 * np.pi) % 1.0
    channels = [np.interp(turn, _TURN, _CORNERS[:, channel]) for channel in range(3)]
    hue = np.stack(channels, axis=-1)
    color = np.where(speed <= 1, 1 - speed * (1 - hue), 0.75 * hue)
    picture = np.round(255 * color).astype(np.uint8)
    picture[undefined] = 128
    return picture


def wheel_legend(side_px: int) -> Rgb:
    """Return the wheel as a picture (side, side, 3): each point has the color of its direction.

    The rim is the maximum speed, the center is no motion; outside is white.
    """
    position = (2 * np.arange(side_px) + 1 - side_px) / side_px
    flow = np.stack(np.meshgrid(position, position), axis=-1)
    outside = np.hypot(flow[..., 0], flow[..., 1]) > 1
    picture = flow_to_rgb(flow, 1.0)
    picture[outside] = 255
    return picture
