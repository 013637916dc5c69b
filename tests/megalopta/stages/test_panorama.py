"""Truth of a rendered panorama."""

import numpy as np
import OpenEXR
import pytest

from megalopta.config.model import load
from megalopta.core.errors import UserError
from megalopta.render import read_truth
from megalopta.scenes.cameras.panoramic import CylindricalCamera
from megalopta.stages.pipeline import run_stage

from ..conftest import TINY

PANORAMA = {
    "camera.kind": "cylindrical",
    "camera.width": "96",
    "camera.height": "40",
    "scene.cycles_per_frame": "6",
    "trajectory.rotation_deg_s": "75",  # two columns a frame at 10 frames per second
    "sensors": "[ideal]",
    "light_levels": "[full_moon]",
}


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    configuration = load("grating", {**TINY, **PANORAMA})
    return run_stage(tmp_path_factory.mktemp("panorama") / "data", configuration, "render")


def test_a_turning_panorama_moves_by_whole_columns_everywhere(finished):
    truth = read_truth(finished.truth(4))
    np.testing.assert_allclose(truth.flow_forward[..., 0], 2, atol=1e-5)
    np.testing.assert_allclose(truth.flow_forward[..., 1], 0, atol=1e-5)
    # Nothing leaves an image without left and right edge.
    mask = finished.frame("training/occlusions", 4, "png").read_bytes()
    assert mask == finished.frame("training/invalid", 4, "png").read_bytes()


def test_camera_and_pose_stand_in_the_truth_and_no_pinhole_file_pretends(finished):
    assert not (finished.root / "training/camdata_left").exists()
    with OpenEXR.File(str(finished.truth(4))) as file:
        header = dict(file.header())
    camera = CylindricalCamera.model_validate_json(header["camera"])
    assert camera == finished.configuration.camera
    pose = np.array(header["cameraToWorld"].split(), dtype=float).reshape(4, 4)
    np.testing.assert_array_equal(pose, finished.configuration.trajectory.poses()[4])
    assert header["depthMeaning"] == "along the ray"


def test_a_grating_is_refused_to_a_camera_that_sees_the_zenith(tmp_path):
    configuration = load("grating", {"camera.kind": "equirectangular"})
    with pytest.raises(UserError, match=r"scene: .* camera.lower_deg -75 and camera.upper_deg 75"):
        run_stage(tmp_path / "data", configuration, "render")
