"""Files of an IMU and of poses, as other programs read them."""

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

import megalopta
from megalopta.config.model import parse
from megalopta.core.errors import UserError

from ..small import made

TURN_DEG = (0, 90, 0)
SETTINGS = f"""
name: flown
scene: {{kind: plane}}
trajectory: {{kind: hover, frames: 3, position_m: [2, 1, 1.5]}}
camera: {{width: 16, height: 12}}
render: {{samples_per_pixel: 1}}
sensors: [ideal]
light_levels: [full_moon]
imu:
  rate_hz: 50
  mount: {{position_m: [0.1, 0, 0], rotation_deg: {[*TURN_DEG]}}}
"""


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    dataset = made(tmp_path_factory.mktemp("imu") / "data", parse(SETTINGS, "test"))
    return megalopta.open_dataset(dataset.root)[0]


def columns(path):
    header, *lines = path.read_text().splitlines()
    rows = [line.split("," if path.suffix == ".csv" else " ") for line in lines]
    assert header.startswith("#")
    return rows


def test_poses_are_stored_as_tum_and_euroc_store_them(flown):
    folder = flown.dataset.imu
    frames = np.array(columns(folder / "groundtruth.txt"), float)
    np.testing.assert_array_equal(frames[:, 0], flown.times_s)
    turns = Rotation.from_quat(frames[:, 4:]).as_matrix()
    np.testing.assert_allclose(turns, flown.poses[:, :3, :3], atol=1e-12)
    states = np.array(columns(folder / "state_groundtruth_estimate0/data.csv"), float)
    assert states.shape == (11, 17)
    np.testing.assert_array_equal(states[:, 0], np.arange(11) * 2e7)  # ns
    camera = yaml.safe_load((folder / "cam0/sensor.yaml").read_text())
    to_body = np.array(camera["T_BS"]["data"]).reshape(4, 4)
    for state, pose in zip(states[::5], flown.poses, strict=True):
        body = np.eye(4)
        body[:3, 3] = state[1:4]
        body[:3, :3] = Rotation.from_quat(state[[5, 6, 7, 4]]).as_matrix()
        # Poses of frames are rounded to float32 near the camera.
        np.testing.assert_allclose(body @ to_body, pose, atol=1e-6)


def test_readings_come_back_with_the_times_of_the_frames(flown):
    times, turns, pushes = flown.imu
    assert turns.shape == pushes.shape == (11, 3)
    np.testing.assert_allclose(times[::5], flown.times_s, atol=1e-9)
    # The IMU looks to the right of a level camera; its y axis is down too. The jitter accelerates
    # by up to 3 m/s².
    np.testing.assert_allclose(pushes.mean(axis=0), [0, -9.8, 0], atol=3)
    stored = [int(row[0]) for row in columns(flown.dataset.imu / "cam0/data.csv")]
    assert stored == [0, 100_000_000, 200_000_000]


def test_too_many_readings_and_damage_are_refused(flown):
    with pytest.raises(UserError, match=r"imu\.rate_hz 1e\+06: 3100001 readings"):
        parse("{trajectory: {frames: 32}, imu: {rate_hz: 1.0e+6}}", "test")
    path = flown.dataset.imu / "imu0/data.csv"
    path.write_text(path.read_text().replace(",", ";", 1).replace("0,", "0;", 1))
    with pytest.raises(UserError, match=r"data\.csv"):
        _ = megalopta.open_dataset(flown.dataset.root)[0].imu
