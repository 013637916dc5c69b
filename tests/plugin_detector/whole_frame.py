"""Another package: a detector by the center of light, and a sensor in a YAML file."""

from functools import partial

import numpy as np

from megalopta.flow import BlockDetector
from megalopta.sensor import preset


class CenterOfLight(BlockDetector, frozen=True):
    """The way of the center of light, in every block."""

    name: str = "CL"
    label: str = "Center of light"

    def start(self, shape):
        """Return the responder; see `Detector.start`."""
        from megalopta.flow.detectors.base import in_pairs

        return in_pairs(partial(_ways, self.grid(shape)))

    def scored(self, responses):
        """Return the velocities of the blocks inside."""
        return responses[:, 1:-1, 1:-1]


def _ways(grid, frames):
    y, x = np.indices(grid.shape)
    light = frames.sum(axis=(1, 2)) + 1e-12
    centers = np.stack([(frames * axis).sum(axis=(1, 2)) / light for axis in (x, y)], axis=-1)
    ways = np.diff(centers, axis=0)[:, np.newaxis, np.newaxis]
    return np.broadcast_to(ways, (len(ways), grid.rows, grid.columns, 2))


BROKEN = 5
SENSOR_FILE = __file__.replace("whole_frame.py", "spad.yaml")
NAMESAKE = preset("ideal")
