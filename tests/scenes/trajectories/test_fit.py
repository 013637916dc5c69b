import itertools

import numpy as np
import pytest

from megalopta.scenes import EquirectangularCamera, PerspectiveCamera
from megalopta.scenes.trajectories.orbit import Fit


@pytest.mark.parametrize(
    "camera",
    [
        PerspectiveCamera(width=64, height=48, fov_deg=60),
        PerspectiveCamera(width=40, height=200, fov_deg=1),
        EquirectangularCamera(width=128, height=64),
    ],
)
@pytest.mark.parametrize(
    "bounds", [[[-1, -1, -1], [1, 1, 1]], [[1e3, 5, 0], [1.01e3, 5.001, 0.02]]]
)
def test_a_fitted_camera_sees_all_of_a_box_and_is_not_too_far(camera, bounds):
    bounds = np.array(bounds, float)
    path = Fit(frames=40, rate_deg_s=90, elevation_deg=30).around(bounds, camera)
    corners = np.array(list(itertools.product(*bounds.T)))
    spans = []
    for pose in path.poses():
        image = camera.project((corners - pose[:3, 3]) @ pose[:3, :3])
        assert ((image > 0) & (image < [camera.width, camera.height])).all()
        spans.append((np.ptp(image, axis=0) / [camera.width, camera.height]).max())
    assert max(spans) > 0.4


def test_a_path_that_is_not_fitted_yet_says_so():
    with pytest.raises(ValueError, match="load the configuration"):
        Fit().poses()
