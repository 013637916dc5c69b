"""Readings of an IMU with poses, in the layouts of EuRoC and TUM (docs/how-to/imu.md lists them).

Times count from the first frame: in ns in EuRoC's files, in s in TUM's. Sources: Burri et al., IJRR
35, 2016, and Sturm et al., IROS 2012.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from megalopta.config.model import Configuration
from megalopta.core import bounded, files, strict_yaml
from megalopta.core.errors import UserError
from megalopta.scenes.imu import Imu
from megalopta.sensor import generator

Float64 = NDArray[np.float64]

_READING = (
    "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
    "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]"
)
_STATE = (
    "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],"
    "q_RS_z [],v_RS_R_x [m s^-1],v_RS_R_y [m s^-1],v_RS_R_z [m s^-1],b_w_RS_S_x [rad s^-1],"
    "b_w_RS_S_y [rad s^-1],b_w_RS_S_z [rad s^-1],b_a_RS_S_x [m s^-2],b_a_RS_S_y [m s^-2],"
    "b_a_RS_S_z [m s^-2]"
)
_TUM = "# timestamp tx ty tz qx qy qz qw"


class ImuReadings(NamedTuple):
    """Readings of an IMU at n times."""

    times_s: Float64
    """(n,), from the first frame."""
    angular_velocities: Float64
    """(n, 3), rad/s, along the IMU's axes."""
    specific_forces: Float64
    """(n, 3), m/s², along the IMU's axes."""


def write_imu(folder: Path, settings: Configuration, imu: Imu) -> None:
    """Write readings and poses of a sequence to a folder, all or nothing."""
    camera, path, poses = settings.camera, settings.trajectory, settings.trajectory.poses()
    readings = imu.read(path, generator(settings.seed, "imu", settings.name))
    truth, turn_first = readings.truth, (3, 0, 1, 2)
    turns = Rotation.from_matrix(truth.rotations).as_quat()[:, turn_first]
    biases = readings.gyroscope_biases, readings.accelerometer_biases
    sensed = np.column_stack([readings.angular_velocities, readings.specific_forces])
    states = np.column_stack([truth.positions, turns, truth.velocities, *biases])
    turns = Rotation.from_matrix(poses[:, :3, :3]).as_quat()
    tum = np.column_stack([path.times_s, poses[:, :3, 3], turns])
    with files.atomic_write(folder) as temporary:
        for name, header, rows in (
            ("imu0", _READING, sensed),
            ("state_groundtruth_estimate0", _STATE, states),
        ):
            lines = (
                ",".join([str(round(time_s * 1e9)), *map(repr, row)])
                for time_s, row in zip(truth.times_s, rows.tolist(), strict=True)
            )
            _write_lines(temporary / name / "data.csv", header, lines)
        times = enumerate(path.times_s, 1)
        frames = (f"{round(time_s * 1e9)},frame_{number:04d}.png" for number, time_s in times)
        _write_lines(temporary / "cam0/data.csv", "#timestamp [ns],filename", frames)
        _write_lines(
            temporary / "groundtruth.txt", _TUM, (" ".join(map(repr, r)) for r in tum.tolist())
        )
        camera_to_imu = np.linalg.inv(imu.mount.matrix) @ (
            path.mount.matrix if path.mount else np.eye(4)
        )
        of_imu = {"rate_hz": imu.rate_hz} | imu.model_dump(mode="json", exclude={"mount"})
        of_camera = {
            "rate_hz": path.frame_rate_hz,
            "resolution": [camera.width, camera.height],
            "camera": camera.model_dump(mode="json"),
        }
        for name, kind, place, fields in (
            ("imu0", "imu", np.eye(4), of_imu),
            ("cam0", "camera", camera_to_imu, of_camera),
        ):
            matrix = {"rows": 4, "cols": 4, "data": place.ravel().tolist()}
            text = strict_yaml.dump({"sensor_type": kind, "T_BS": matrix, **fields})
            files.write_text(temporary / name / "sensor.yaml", text)


def _write_lines(path: Path, header: str, lines: Iterable[str]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", encoding="utf-8") as file:
        file.write(f"{header}\n")
        file.writelines(f"{line}\n" for line in lines)


def read_imu(path: Path) -> ImuReadings:
    """Read EuRoC's data.csv of an IMU. Raises UserError if there is none, or it is damaged."""
    if not path.exists():
        raise UserError(f"{path}: no IMU; sense with `imu: {{}}`")
    with bounded.undamaged(path, "run megalopta sense again"):
        lines = bounded.read_text(path, bounded.ARRAY_BYTES).splitlines()
        rows = np.array([[float(cell) for cell in line.split(",")] for line in lines[1:]])
        times, turns, pushes = np.split(rows, (1, 4), axis=1)
        if pushes.shape[1] != 3:
            raise ValueError(f"{rows.shape[1]} columns instead of 7")
    return ImuReadings(times[:, 0] * 1e-9, turns, pushes)
