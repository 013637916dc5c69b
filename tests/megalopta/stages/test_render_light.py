"""Light, noise and panoramas as a user of the stages meets them."""

import json

import numpy as np
import OpenEXR
import pytest
import trimesh

from megalopta.config.model import Configuration, load, parse
from megalopta.core.errors import UserError
from megalopta.render.exr import read_headers
from megalopta.scenes.cameras.panoramic import CylindricalCamera
from megalopta.scenes.material import Material
from megalopta.scenes.scene import Asset, Placement, Scene
from megalopta.scenes.spectra.spectrum import flat
from megalopta.stages.run import run_stage

from ..small import TINY, small

SMALL = small(24, 24, 3, samples=4, sensors="ideal", levels="twilight") | {
    "render.bands_nm": "[[450, 550], [550, 650]]",
    "render.max_depth": "2",
}


@pytest.fixture
def instead(monkeypatch):
    """Puts a gray mesh under the light in place of the forest, which takes long to grow."""

    def put(mesh):
        def build(description, light, camera, trajectory, objects):
            placement = Placement("thing", "ground", np.eye(4))
            materials, assets = {"gray": Material(flat(0.5))}, {"thing": Asset({"gray": mesh})}
            return Scene(materials, assets, (placement,), light.lighting())

        monkeypatch.setattr("megalopta.stages.render.build_scene", build)

    return put


@pytest.fixture
def sky(picture):
    """Settings of a panorama of rough light."""

    def write(seed):
        values = np.random.default_rng(seed).gamma(0.5, size=(16, 32, 3))
        path = picture(values, "sky.exr")
        return parse(f"scene: {{kind: panorama, file: {path}}}", "test", SMALL)

    return write


def test_a_panorama_renders_with_the_requested_light(sky, tmp_path, capsys):
    dataset = run_stage(tmp_path / "data", sky(1), "render")
    record = json.loads(dataset.scene_record.read_text())
    # The measuring rays cross texels of a very rough picture.
    assert record["illuminance"]["unshaded_lux"] == pytest.approx(1.0, rel=0.01)
    assert record["monte_carlo"]["median_relative"] == 0
    assert "takes more hits" not in capsys.readouterr().err
    run_stage(tmp_path / "data", dataset.configuration, "sense")


def test_light_that_takes_too_many_hits_is_recorded_and_told(instead, tmp_path, capsys):
    hollow = trimesh.creation.icosphere(subdivisions=3, radius=50.0)
    hollow.update_faces(hollow.triangles_center[:, 2] < 12.5)  # five eighths of a sphere
    instead(hollow)
    dataset = run_stage(tmp_path / "data", load("demo", SMALL), "render")
    told = " ".join(capsys.readouterr().err.split())
    assert "takes more hits than render.max_depth 2 allows and is missing" in told
    shares = json.loads(dataset.scene_record.read_text())["light_left_out"]
    # half of five eighths comes back from a hit; some 2000 paths know it to 3 % (σ)
    assert shares == pytest.approx([0.5 * 0.625] * 2, rel=0.2)


PANORAMA = small(96, 40, 6, sensors="ideal", levels="full_moon") | {
    "camera.kind": "cylindrical",
    "scene.cycles_per_frame": "6",
    "trajectory.rotation_deg_s": "75",  # two columns a frame at 10 frames per second
}


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    configuration = load("grating", {**TINY, **PANORAMA})
    return run_stage(tmp_path_factory.mktemp("panorama") / "data", configuration, "render")


def test_all_pictures_in_radiance_have_one_exposure(finished):
    assert len({read_headers(finished.frame("radiance", n))[0]["EV"] for n in range(6)}) == 1


def test_a_panorama_has_no_distances_for_a_lens(sky):
    values = sky(1).model_dump() | {
        "camera": {"kind": "perspective", "aperture_mm": 9, "focus_m": 1}
    }
    with pytest.raises(ValueError, match=r"camera\.aperture_mm: a scene of kind 'panorama'"):
        Configuration.model_validate(values)


def test_camera_and_pose_stand_in_the_truth_and_no_pinhole_file_pretends(finished):
    assert not (finished.root / "training/camdata_left").exists()
    with OpenEXR.File(str(finished.frame("truth", 4))) as file:
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
    assert not list(tmp_path.iterdir())
