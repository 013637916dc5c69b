"""What `sense` cannot know of light."""

import numpy as np
import pytest

from megalopta.sensor import changed, preset
from megalopta.sensor.sampling.streams import Draw
from megalopta.sensor.shot import NextFrames, Shot


def test_light_is_not_known_beyond_the_next_frame():
    following = NextFrames(
        radiance=np.ones((1, 2, 2, 1)),
        flow=np.zeros((1, 2, 2, 2)),
        hidden=np.zeros((1, 2, 2), bool),
    )
    sensor = changed(preset("ideal"), exposure_s=0.02)
    with pytest.raises(ValueError, match="exposure_s: 0.02 is longer than a frame, 0.01 s"):
        Shot(
            radiance=np.ones((1, 2, 2, 1)), bands_nm=[(450.0, 550.0)], sensor=sensor,
            draw=Draw(0, "s", 0, 0.01), following=following,
        )  # fmt: skip
